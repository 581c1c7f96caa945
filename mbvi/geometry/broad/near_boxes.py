"""Pairs of oriented boxes that are near each other, and the placements of many shapes."""

from __future__ import annotations

import numpy as np

from ...arguments import Array
from ...compiled import kernel
from .separating_axis import place_side


@kernel("void(f8[:,:,::1], i8[::1], f8[:,:,::1], f8[:,:,::1])")
def place_shapes(places: Array, frame: Array, fixed: Array, world: Array) -> None:
    """Write where all shapes are, shape (s, 4, 3); the other arguments are those of `separating_axis.place_side`."""
    for shape in range(len(frame)):
        place_side(places, frame, fixed, shape, shape, world)


@kernel("i8(f8[:,:,::1], f8[:,::1], f8[:,::1], i8[::1], f8, i8[::1])")
def near_boxes(world: Array, middle: Array, half: Array, pairs: Array, reach: float, near: Array) -> int:
    """List the pairs of boxes that no normal of a face separates by more than `reach`; return how many there are.

    Parameters
    ----------
    world : ndarray, shape (n, 4, 3)
        Placements: columns of the rotation, then the origin.
    middle, half : ndarray, shape (n, 3)
        Centres and half edges of the boxes along their axes [m].
    pairs : ndarray of int, shape (k,)
        Pairs i n + j.
    reach : float
        Greatest gap [m].
    near : ndarray of int, shape (k,)
        Receives the pairs that are near, in its first places.
    """
    n, count, between = len(world), 0, np.empty(3)
    for k in range(len(pairs)):
        i = pairs[k] // n
        j = pairs[k] - i * n
        for c in range(3):
            between[c] = world[j, 3, c] - world[i, 3, c]
            for axis in range(3):
                between[c] += middle[j, axis] * world[j, axis, c] - middle[i, axis] * world[i, axis, c]
        apart = -np.inf
        for side in range(2):
            a, b = (i, j) if side == 0 else (j, i)
            for axis in range(3):
                u, v, w = world[a, axis, 0], world[a, axis, 1], world[a, axis, 2]
                gap = abs(u * between[0] + v * between[1] + w * between[2]) - half[a, axis]
                for other in range(3):
                    along = u * world[b, other, 0] + v * world[b, other, 1] + w * world[b, other, 2]
                    gap -= half[b, other] * abs(along)
                apart = max(apart, gap)
        if apart <= reach:
            near[count] = pairs[k]
            count += 1
    return count

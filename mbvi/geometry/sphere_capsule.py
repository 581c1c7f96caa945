"""Distances between spheres and capsules in closed form, for many pairs at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..arguments import Array
from ..compiled import kernel
from .shapes import Capsule, PlacedShape, Sphere


@kernel("b1(f8[:,:,::1], i8[::1], f8[:,:,::1], f8[::1], i8[:,::1], i8[::1], f8[::1], f8[:,::1], f8[:,::1])")
def _ball_contacts(
    places: Array, frame: Array, ends: Array, radius: Array, sides: Array, pairs: Array, gap: Array, point: Array,
    normal: Array,
) -> bool:  # fmt: skip
    """Write the contacts of pairs with at least one sphere; return whether all have a normal.

    Concentric spheres have none: NaN is written.

    Parameters
    ----------
    places : ndarray, shape (b, 4, 3)
        Placements of the bodies: columns of the rotation, then the origin.
    frame : ndarray of int, shape (s,)
        The place of each shape's body in `places`; -1 for the world.
    ends : ndarray, shape (s, 2, 3)
        The two ends of a capsule's axis in its body; for a sphere both are its centre.
    radius : ndarray, shape (s,)
        Radii [m].
    sides : ndarray of int, shape (n, 2)
        The shapes of each pair.
    pairs : ndarray of int, shape (k,)
        The pairs to evaluate.
    gap, point, normal : ndarray, shapes (k,), (k, 3), (k, 3)
        Receive signed distances, points midway between the surfaces, and unit normals from the first to the second.
    """
    fine = True
    world = np.empty((2, 2, 3))
    for i in range(len(pairs)):
        for side in range(2):
            s = sides[pairs[i], side]
            f = frame[s]
            for end in range(2):
                for c in range(3):
                    x = ends[s, end, c]
                    if f >= 0:
                        x = places[f, 3, c]
                        for k in range(3):
                            x += ends[s, end, k] * places[f, k, c]
                    world[side, end, c] = x
        # where one is a sphere, the other's nearest point is that to its centre
        for side in range(2):
            square = along = 0.0
            for c in range(3):
                d = world[side, 1, c] - world[side, 0, c]
                square += d * d
                along += d * (world[1 - side, 0, c] - world[side, 0, c])
            if square > 0.0:
                share = min(max(along / square, 0.0), 1.0)
                for c in range(3):
                    world[side, 0, c] += share * (world[side, 1, c] - world[side, 0, c])
        length = 0.0
        for c in range(3):
            length += (world[1, 0, c] - world[0, 0, c]) ** 2
        length = np.sqrt(length)
        a, b = radius[sides[pairs[i], 0]], radius[sides[pairs[i], 1]]
        gap[i] = length - a - b
        for c in range(3):
            n = (world[1, 0, c] - world[0, 0, c]) / length if length > 0.0 else np.nan
            normal[i, c] = n
            point[i, c] = world[0, 0, c] + (a + 0.5 * gap[i]) * n
        fine = fine and length > 0.0
    return fine


def out_of_cylinder(centre: Array, radius: float, length: float) -> tuple[float, Array]:
    """Return the signed distance of a point from the surface of a solid cylinder, and the unit normal there.

    Parameters
    ----------
    centre : ndarray, shape (3,)
        The point, in the cylinder's frame.
    radius, length : float
        Of the cylinder [m].

    Notes
    -----
    It replaces Coal's distance of a ball whose centre is in a cylinder, which is wrong by up to the cylinder's radius.
    """
    across = float(np.hypot(centre[0], centre[1]))
    outward = np.array([centre[0], centre[1], 0.0]) / across if across > 0.0 else np.array([1.0, 0.0, 0.0])
    upward = np.array([0.0, 0.0, 1.0 if centre[2] >= 0.0 else -1.0])
    side, end = across - radius, abs(float(centre[2])) - 0.5 * length
    if side > 0.0 and end > 0.0:
        away = side * outward + end * upward
        distance = float(np.hypot(side, end))
        return distance, away / distance
    return (side, outward) if side > end else (end, upward)


class SphereCapsulePairs:
    """Closed-form contacts for those pairs of a list that have them.

    Parameters
    ----------
    shapes : sequence of PlacedShape
        The shapes.
    frame : ndarray of int, shape (s,)
        The place of each shape's body in the placements given to `contacts`; -1 for the world.
    sides : ndarray of int, shape (n, 2)
        The two shapes of each pair.

    Attributes
    ----------
    closed_form : ndarray of bool, shape (n,)
        Which pairs have a closed form: sphere and sphere, sphere and capsule.
    """

    def __init__(self, shapes: Sequence[PlacedShape], frame: Array, sides: Array) -> None:
        self._frame, self._sides = frame, sides
        self._ends, self._radius = np.zeros((len(shapes), 2, 3)), np.zeros(len(shapes))
        ball, round_ = np.zeros(len(shapes), bool), np.zeros(len(shapes), bool)
        for k, placed in enumerate(shapes):
            shape = placed.shape
            if isinstance(shape, Sphere | Capsule):
                half = 0.5 * shape.length if isinstance(shape, Capsule) else 0.0
                self._ends[k] = placed.position + np.array([[-half], [half]]) * placed.rotation[:, 2]
                self._radius[k] = shape.radius
                ball[k], round_[k] = isinstance(shape, Sphere), True
        first, second = sides.T
        self.closed_form = round_[first] & round_[second] & (ball[first] | ball[second])

    def contacts(self, places: Array, pairs: Array) -> tuple[Array, Array, Array] | None:
        """Return gaps, shape (k,), points and normals, shapes (k, 3), of such pairs; None if some centres coincide."""
        k = len(pairs)
        gap, point, normal = np.empty(k), np.empty((k, 3)), np.empty((k, 3))
        fine = _ball_contacts(places, self._frame, self._ends, self._radius, self._sides, pairs, gap, point, normal)
        return (gap, point, normal) if fine else None

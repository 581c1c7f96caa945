"""Contacts of a sphere with a sphere, capsule, box or cylinder in closed form; see `shape_cores`."""

from __future__ import annotations

import numpy as np

from ...arguments import Array
from ...compiled import kernel
from ..shapes.shape_cores import BALL, HALF, NEAREST, NORMAL, PLACE, write_normal


@kernel("f8(f8[:,:,::1], i8)")
def out_of_core(cores: Array, side: int) -> float:
    """Return the signed distance of a point, row NEAREST of a side in its frame, from the core of that side [m].

    Row NORMAL receives the unit normal where the core is nearest to a point outside, or of the face nearest to one
    inside.
    """
    square, deepest, k = 0.0, -np.inf, 0
    for c in range(3):
        at = cores[side, NEAREST, c]
        beyond = abs(at) - cores[side, HALF, c]
        cores[side, NORMAL, c] = 0.0
        # also if it is NaN
        if not beyond <= 0.0:
            cores[side, NORMAL, c] = beyond if at > 0.0 else -beyond
            square += beyond * beyond
        if beyond > deepest:
            deepest, k = beyond, c
    if square == 0.0:
        # also on the axis of a capsule or in the centre of a sphere, where any direction across is a normal
        cores[side, NORMAL, k] = 1.0 if cores[side, NEAREST, k] >= 0.0 else -1.0
        return deepest
    distance = np.sqrt(square)
    for c in range(3):
        cores[side, NORMAL, c] /= distance
    return distance


@kernel("f8(f8[:,:,::1], i8)")
def out_of_cylinder_core(cores: Array, side: int) -> float:
    """Return the signed distance of a point from a solid cylinder, and write the normal; as `out_of_core`."""
    x, y, z = cores[side, NEAREST, 0], cores[side, NEAREST, 1], cores[side, NEAREST, 2]
    across = np.sqrt(x * x + y * y)
    beside, above = across - cores[side, BALL, 1], abs(z) - cores[side, HALF, 2]
    distance = max(beside, above)
    # components of the normal away from the axis and along it
    outward, upward = 0.0, 1.0
    if beside > 0.0 and above > 0.0:
        distance = np.sqrt(beside * beside + above * above)
        outward, upward = beside / distance, above / distance
    elif beside > above:
        outward, upward = 1.0, 0.0
    cores[side, NORMAL, 0] = outward * (x / across if across > 0.0 else 1.0)
    cores[side, NORMAL, 1] = outward * (y / across if across > 0.0 else 0.0)
    cores[side, NORMAL, 2] = upward if z >= 0.0 else -upward
    return distance


@kernel("void(f8[:,:,::1], i8, f8[:,::1])")
def ball_contact(cores: Array, side: int, found: Array) -> None:
    """Write the contact of a sphere, which is one side of two, with the other shape.

    Parameters
    ----------
    cores : ndarray, shape (2, 12, 3)
        The shapes: rows HALF, BALL and PLACE are given.
    side : int
        Which shape is the sphere.
    found : ndarray, shape (k, 7)
        Receives gap, point and normal in its first row.
    """
    other = 1 - side
    for k in range(3):
        x = 0.0
        for c in range(3):
            x += cores[other, PLACE + k, c] * (cores[side, PLACE + 3, c] - cores[other, PLACE + 3, c])
        cores[other, NEAREST, k] = x
    distance = out_of_cylinder_core(cores, other) if cores[other, BALL, 1] > 0.0 else out_of_core(cores, other)
    write_normal(cores, other, found, 0)
    found[0, 0] = distance - cores[0, BALL, 0] - cores[1, BALL, 0]
    # from the centre of the sphere to the middle between the surfaces
    along = 0.5 * (distance + cores[side, BALL, 0] - cores[other, BALL, 0])
    for c in range(3):
        found[0, 1 + c] = cores[side, PLACE + 3, c] - (along if side == 1 else -along) * found[0, 4 + c]

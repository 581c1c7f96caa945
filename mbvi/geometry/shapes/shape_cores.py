"""Two shapes as cores with balls about them: what the closed forms of boxes, capsules, spheres and cylinders share.

The core of a shape is a box, whose edges may vanish: a box is one, a capsule is a segment and a ball about it, a sphere
a point and a ball. `cores`, shape (2, 12, 3), holds for each of two shapes, in these rows [m]:

0 to 2 : components of the other core's axes along the own ones; row i, column j is that of axis j along axis i.
SHIFT : origin of the other core, in the own frame.
HALF : half edges. A capsule has one that is not zero, along z.
NORMAL : unit vector towards the other shape, in the own frame.
NEAREST : a point of the core, in the frame of the first core.
BALL : radius of the ball, then that of a disk normal to z.
PLACE : placement in the world: the axes, then the origin, in four rows.
"""

from __future__ import annotations

import numpy as np

from ...arguments import Array
from ...compiled import kernel

SHIFT, HALF, NORMAL, NEAREST, BALL, PLACE = 3, 4, 5, 6, 7, 8


@kernel("void(f8[:,:,::1], i8[::1], f8[:,:,::1], f8[:,::1], i8[:,::1], i8, f8[:,:,::1])")
def place_cores(
    places: Array, frame: Array, fixed: Array, sizes: Array, sides: Array, number: int, cores: Array
) -> None:
    """Write placements and sizes of the shapes of one pair; arguments are those of `primitive_contacts`."""
    for side in range(2):
        s = sides[number, side]
        f = frame[s]
        for c in range(3):
            cores[side, HALF, c] = sizes[s, c]
            for k in range(4):
                x = fixed[s, k, c]
                if f >= 0:
                    x = places[f, 3, c] if k == 3 else 0.0
                    for i in range(3):
                        x += fixed[s, k, i] * places[f, i, c]
                cores[side, PLACE + k, c] = x
        cores[side, BALL, 0], cores[side, BALL, 1] = sizes[s, 3], sizes[s, 4]


@kernel("void(f8[:,:,::1])")
def relate(cores: Array) -> None:
    """Write where each core is in the frame of the other."""
    for i in range(3):
        cores[0, SHIFT, i] = cores[1, SHIFT, i] = 0.0
        for j in range(3):
            cores[0, i, j] = 0.0
    for c in range(3):
        between = cores[1, PLACE + 3, c] - cores[0, PLACE + 3, c]
        for i in range(3):
            cores[0, SHIFT, i] += cores[0, PLACE + i, c] * between
            cores[1, SHIFT, i] -= cores[1, PLACE + i, c] * between
            for j in range(3):
                cores[0, i, j] += cores[0, PLACE + i, c] * cores[1, PLACE + j, c]
    for i in range(3):
        for j in range(3):
            cores[1, j, i] = cores[0, i, j]


@kernel("void(f8[:,:,::1], i8)")
def complete_normal(cores: Array, side: int) -> None:
    """Write the normal of the other side, which is the opposite direction in its own frame."""
    for i in range(3):
        x = 0.0
        for j in range(3):
            x -= cores[1 - side, i, j] * cores[side, NORMAL, j]
        cores[1 - side, NORMAL, i] = x


@kernel("void(f8[:,:,::1], i8, i8, f8)")
def face_normal(cores: Array, side: int, k: int, sign: float) -> None:
    """Write as normal that of a face of one core, of axis k and a sign."""
    for i in range(3):
        cores[side, NORMAL, i] = sign if i == k else 0.0
    complete_normal(cores, side)


@kernel("i8(f8[:,:,::1], i8)")
def facing_axis(cores: Array, side: int) -> int:
    """Return the axis of one core whose face looks most along its normal."""
    x, y, z = abs(cores[side, NORMAL, 0]), abs(cores[side, NORMAL, 1]), abs(cores[side, NORMAL, 2])
    return 0 if x >= y and x >= z else (1 if y >= z else 2)


@kernel("f8(f8[:,:,::1], i8)")
def bounding_radius(cores: Array, side: int) -> float:
    """Return the radius of a ball about the origin of a shape that holds it [m]."""
    x, y, z = cores[side, HALF, 0], cores[side, HALF, 1], cores[side, HALF, 2]
    return np.sqrt(x * x + y * y + z * z) + cores[side, BALL, 0]


@kernel("void(f8[:,:,::1], i8, f8[:,::1], i8)")
def write_normal(cores: Array, side: int, found: Array, row: int) -> None:
    """Write the normal from first to second shape into a row of contacts, by its components in the frame of a side."""
    sign = 1.0 if side == 0 else -1.0
    for c in range(3):
        x = 0.0
        for i in range(3):
            x += sign * cores[side, NORMAL, i] * cores[side, PLACE + i, c]
        found[row, 4 + c] = x

"""The lowest points of shapes above half-spaces, and their gaps.

A support point is fixed in its body, or it is the lowest point of a rim or an ellipsoid. Each is a row of the array
`numbers`, shape (k, 17): 0-2 its position in the body, or the centre of the rim or ellipsoid [m]; 3-11 the three half
axes of that in the body, zero for a fixed point; 12-14 the normal of the half-space; 15 the radius of the ball around
the point; 16 that radius plus the offset of the half-space [m].
"""

from __future__ import annotations

import numpy as np

from ..arguments import Array
from ..compiled import kernel

# a rim tilted by less than this angle is level: all of its points are lowest, and the first axis gives one [rad]
_LEVEL = 1e-9


@kernel("void(f8[:,:,::1], i8, f8[:,::1], i8, f8[::1])")
def lowest(places: Array, body: int, numbers: Array, i: int, out: Array) -> None:
    """Write contact point and gap, shape (4,), of one point of a body above a half-space.

    Parameters
    ----------
    places : ndarray, shape (b, 4, 3)
        Placements of the bodies: columns of the rotation, then the origin.
    body : int
        The body of the point, as a place in `places`.
    numbers, i
        The array of all points, and the row of this one.
    """
    P, n = places, numbers
    x, y, z = n[i, 0], n[i, 1], n[i, 2]
    if n[i, 3] != 0.0 or n[i, 4] != 0.0 or n[i, 5] != 0.0:
        u = P[body, 0, 0] * n[i, 12] + P[body, 0, 1] * n[i, 13] + P[body, 0, 2] * n[i, 14]
        v = P[body, 1, 0] * n[i, 12] + P[body, 1, 1] * n[i, 13] + P[body, 1, 2] * n[i, 14]
        w = P[body, 2, 0] * n[i, 12] + P[body, 2, 1] * n[i, 13] + P[body, 2, 2] * n[i, 14]
        a = n[i, 3] * u + n[i, 4] * v + n[i, 5] * w
        b = n[i, 6] * u + n[i, 7] * v + n[i, 8] * w
        c = n[i, 9] * u + n[i, 10] * v + n[i, 11] * w
        length, largest = np.sqrt(a * a + b * b + c * c), 0.0
        for k in range(3, 12):
            largest = max(largest, abs(n[i, k]))
        if length > _LEVEL * largest:
            a, b, c = -a / length, -b / length, -c / length
        else:
            a, b, c = 1.0, 0.0, 0.0
        x += n[i, 3] * a + n[i, 6] * b + n[i, 9] * c
        y += n[i, 4] * a + n[i, 7] * b + n[i, 10] * c
        z += n[i, 5] * a + n[i, 8] * b + n[i, 11] * c
    out[3] = -n[i, 16]
    for k in range(3):
        where = x * P[body, 0, k] + y * P[body, 1, k] + z * P[body, 2, k] + P[body, 3, k]
        out[3] += where * n[i, 12 + k]
        out[k] = where - n[i, 15] * n[i, 12 + k]


@kernel("void(f8[:,:,::1], i8[:,::1], f8[:,::1], f8[::1], f8[:,::1])")
def stand(places: Array, owners: Array, numbers: Array, gap: Array, point: Array) -> None:
    """Write gaps, shape (k,), and contact points, shape (k, 3), of points of bodies above half-spaces.

    Parameters
    ----------
    places : ndarray, shape (b, 4, 3)
        Placements of the bodies: columns of the rotation, then the origin.
    owners : ndarray of int, shape (k, 2)
        The place of each point's body in `places`, and the point's pair.
    numbers
        As above.
    """
    out = np.empty(4)
    for i in range(len(owners)):
        lowest(places, owners[i, 0], numbers, i, out)
        point[i, 0], point[i, 1], point[i, 2], gap[i] = out[0], out[1], out[2], out[3]

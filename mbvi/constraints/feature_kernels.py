"""Kernels of rows that keep their features: a vertex or a rim on a face, or an edge across an edge."""

from __future__ import annotations

import numpy as np

from ..compiled import kernel
from ..system.mechanisms.frames import cross_product, turned

Array = np.ndarray

# which features touch: a vertex of the first shape and a face of the second, the reverse, or two edges
VERTEX_FACE, FACE_VERTEX, EDGES = range(3)
# a face of the first shape and the rim of a disc of the second; the kind between them is that of limits of joints
FACE_RIM = 4
# sine of the angle between a disc and a face below which any point of the rim counts as the lowest
_LEVEL = 1e-9


@kernel("UniTuple(f8, 3)(f8[::1], f8[::1])")
def lowest_of_rim(n: Array, axis: Array) -> tuple[float, float, float]:
    """Return the way from the centre of a disc to the lowest point of its rim along n; `axis` has its radius as length.

    Both have shape (3,).
    """
    square = axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2]
    radius, s = np.sqrt(square), (n[0] * axis[0] + n[1] * axis[1] + n[2] * axis[2]) / square
    x, y, z = n[0] - s * axis[0], n[1] - s * axis[1], n[2] - s * axis[2]
    size = np.sqrt(x * x + y * y + z * z)
    if size <= _LEVEL:
        x, y, z = cross_product(axis[0], axis[1], axis[2], 1.0, 0.0, 0.0)
        if x * x + y * y + z * z < 0.25 * square:
            x, y, z = cross_product(axis[0], axis[1], axis[2], 0.0, 1.0, 0.0)
        size = np.sqrt(x * x + y * y + z * z)
    share = -radius / size
    return share * x, share * y, share * z


@kernel("f8(f8[::1], f8[::1], f8[::1], f8[::1])")
def rolling_bias(n: Array, axis: Array, first: Array, second: Array) -> float:
    """Return what the way of the lowest point along a rim adds to (dJ/dt) v of its height.

    Parameters
    ----------
    n, axis : ndarray, shape (3,)
        See `lowest_of_rim`.
    first, second : ndarray, shape (6,)
        Twists of the bodies that have the face and the disc; the last three numbers are their turning.
    """
    radius = np.sqrt(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2])
    a, b, c = axis[0] / radius, axis[1] / radius, axis[2] / radius
    along = n[0] * a + n[1] * b + n[2] * c
    x, y, z = n[0] - along * a, n[1] - along * b, n[2] - along * c
    size = np.sqrt(x * x + y * y + z * z)
    if size <= _LEVEL:
        return 0.0
    x, y, z = x / size, y / size, z / size
    n0, n1, n2 = cross_product(first[3], first[4], first[5], n[0], n[1], n[2])
    a0, a1, a2 = cross_product(second[3], second[4], second[5], a, b, c)
    change = n0 * a + n1 * b + n2 * c + n[0] * a0 + n[1] * a1 + n[2] * a2
    # the rate of the direction from the lowest point to the centre, and that within the disc
    u, v, w = n0 - change * a - along * a0, n1 - change * b - along * a1, n2 - change * c - along * a2
    grows = u * x + v * y + w * z
    d0, d1, d2 = cross_product(second[3], second[4], second[5], x, y, z)
    u, v, w = (u - grows * x) / size - d0, (v - grows * y) / size - d1, (w - grows * z) / size - d2
    d0, d1, d2 = cross_product(second[3] - first[3], second[4] - first[4], second[5] - first[5], u, v, w)
    return -radius * (n[0] * d0 + n[1] * d1 + n[2] * d2)


@kernel("f8(i8, f8[:,:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1])")
def touch(
    kind: int, parts: Array, first: Array, second: Array, along: Array, point: Array, normal: Array
) -> float:  # fmt: skip
    """Write where two features touch; return their gap [m].

    Parameters
    ----------
    kind : int
        Which features touch.
    parts : ndarray, shape (2, 2, 3)
        A point and a direction on either body, in its frame; see `FeatureRows`. Of a disc they are its centre and its
        axis, whose length is the radius.
    first, second : ndarray, shape (4, 3)
        Placements of the bodies.
    along : ndarray, shape (2, 3)
        Receives the directions in the world.
    point, normal : ndarray, shape (3,)
        Receive the contact point, and the normal from the first to the second body.
    """
    along[0, 0], along[0, 1], along[0, 2] = turned(first, parts[0, 1, 0], parts[0, 1, 1], parts[0, 1, 2])
    along[1, 0], along[1, 1], along[1, 2] = turned(second, parts[1, 1, 0], parts[1, 1, 1], parts[1, 1, 2])
    a, b, c = turned(first, parts[0, 0, 0], parts[0, 0, 1], parts[0, 0, 2])
    x, y, z = turned(second, parts[1, 0, 0], parts[1, 0, 1], parts[1, 0, 2])
    a, b, c = a + first[3, 0], b + first[3, 1], c + first[3, 2]
    x, y, z = x + second[3, 0] - a, y + second[3, 1] - b, z + second[3, 2] - c
    if kind == EDGES:
        d, e = along[0], along[1]
        n0, n1, n2 = cross_product(d[0], d[1], d[2], e[0], e[1], e[2])
        square = n0 * n0 + n1 * n1 + n2 * n2
        s0, s1, s2 = cross_product(x, y, z, e[0], e[1], e[2])
        # the nearest point of the first line
        share, size = (s0 * n0 + s1 * n1 + s2 * n2) / square, np.sqrt(square)
        normal[0], normal[1], normal[2] = n0 / size, n1 / size, n2 / size
        point[0], point[1], point[2] = a + share * d[0], b + share * d[1], c + share * d[2]
    else:
        side, moved = (1, 0.0) if kind == VERTEX_FACE else (0, 1.0)
        normal[0], normal[1], normal[2] = along[side, 0], along[side, 1], along[side, 2]
        if kind == FACE_RIM:
            d0, d1, d2 = lowest_of_rim(normal, along[1])
            x, y, z = x + d0, y + d1, z + d2
        point[0], point[1], point[2] = a + moved * x, b + moved * y, c + moved * z
    return normal[0] * x + normal[1] * y + normal[2] * z


@kernel("void(i8[::1], f8[:,:,:,::1], f8[::1], f8[:,::1], f8[:,::1], i8[:,:,::1], f8[::1])")
def write_outside(
    kind: Array, places: Array, gap: Array, point: Array, planes: Array, faces: Array, outside: Array
) -> None:  # fmt: skip
    """Write how far the contact points of some rows are outside the faces that they are on, beyond their gaps.

    Parameters
    ----------
    kind, places, gap, point
        As of `touch_each`.
    planes : ndarray, shape (n, 4)
        Outward normals and offsets of faces, in frames of bodies.
    faces : ndarray of int, shape (k, 2, 2)
        Of each row where the faces of either shape begin and end.
    outside : ndarray, shape (k,)
        Receives the lengths [m].
    """
    for i in range(len(kind)):
        outside[i] = -np.inf
        for side in range(2):
            if kind[i] == (FACE_VERTEX if side == 1 else VERTEX_FACE):
                continue
            P = places[i, side]
            x, y, z = point[i, 0] - P[3, 0], point[i, 1] - P[3, 1], point[i, 2] - P[3, 2]
            u = P[0, 0] * x + P[0, 1] * y + P[0, 2] * z
            v = P[1, 0] * x + P[1, 1] * y + P[1, 2] * z
            w = P[2, 0] * x + P[2, 1] * y + P[2, 2] * z
            for f in range(faces[i, side, 0], faces[i, side, 1]):
                n = planes[f]
                outside[i] = max(outside[i], n[0] * u + n[1] * v + n[2] * w - n[3])
        outside[i] -= abs(gap[i])


@kernel("void(i8[::1], f8[:,:,:,::1], f8[:,:,:,::1], f8[:,:,::1], f8[::1], f8[:,::1], f8[:,::1])")
def touch_each(
    kind: Array, parts: Array, places: Array, along: Array, gap: Array, point: Array, normal: Array
) -> None:  # fmt: skip
    """Write `touch` of several rows: placements (k, 2, 4, 3), directions (k, 2, 3), gaps (k,), the others (k, 3)."""
    for i in range(len(kind)):
        gap[i] = touch(kind[i], parts[i], places[i, 0], places[i, 1], along[i], point[i], normal[i])


@kernel("f8(i8, f8[::1], f8[:,::1], f8[:,::1], f8, f8, f8)")
def turning_bias(kind: int, n: Array, along: Array, turning: Array, x: float, y: float, z: float) -> float:
    """Return what the turning of features adds to (dJ/dt) v of their distance.

    Parameters
    ----------
    kind : int
        Which features touch.
    n : ndarray, shape (3,)
        The normal.
    along, turning : ndarray, shape (2, 3)
        Directions of the features and their rates of change.
    x, y, z : float
        Velocity of the second body relative to the first where they touch.
    """
    if kind != EDGES:
        # the normal turns with the body that has the face
        change = turning[1 if kind == VERTEX_FACE else 0]
        return 2.0 * (change[0] * x + change[1] * y + change[2] * z)
    d, e, dd, de = along[0], along[1], turning[0], turning[1]
    a, b, c = cross_product(d[0], d[1], d[2], e[0], e[1], e[2])
    size = np.sqrt(a * a + b * b + c * c)
    r0, r1, r2 = cross_product(dd[0], dd[1], dd[2], e[0], e[1], e[2])
    a, b, c = cross_product(d[0], d[1], d[2], de[0], de[1], de[2])
    r0, r1, r2 = (r0 + a) / size, (r1 + b) / size, (r2 + c) / size
    a, b, c = cross_product(x, y, z, e[0], e[1], e[2])
    # the contact point moves along both edges
    first = (a * n[0] + b * n[1] + c * n[2]) / size
    a, b, c = cross_product(x, y, z, d[0], d[1], d[2])
    second = (a * n[0] + b * n[1] + c * n[2]) / size
    along_n = r0 * n[0] + r1 * n[1] + r2 * n[2]
    bias = (r0 - along_n * n[0]) * x + (r1 - along_n * n[1]) * y + (r2 - along_n * n[2]) * z
    for k in range(3):
        bias += n[k] * (second * de[k] - first * dd[k])
    return bias


@kernel("void(i8[::1], f8[:,::1], f8[:,:,::1], f8[:,:,::1], f8[:,::1], f8[::1])")
def add_turning_biases(kind: Array, n: Array, along: Array, turning: Array, sliding: Array, bias: Array) -> None:
    """Add `turning_bias` of several rows to `bias`, shape (k,); normals and velocities have shape (k, 3)."""
    for i in range(len(kind)):
        s = sliding[i]
        bias[i] += turning_bias(kind[i], n[i], along[i], turning[i], s[0], s[1], s[2])

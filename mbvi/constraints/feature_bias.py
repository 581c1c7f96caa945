"""(dJ/dt) v of rows that keep their features, beyond the accelerations of the bodies where they touch."""

from __future__ import annotations

import numpy as np

from ..compiled import kernel
from ..system.mechanisms.frames import cross_product
from .feature_kernels import EDGES, FACE_RIM, LEVEL, LINE_VERTEX, POINTS, RIM_FACE, VERTEX_FACE, VERTEX_LINE

Array = np.ndarray


@kernel("f8(f8[:,::1], i8, f8, f8, f8)")
def along_vector(vectors: Array, which: int, x: float, y: float, z: float) -> float:
    """Return the product of one of some vectors with another one."""
    return vectors[which, 0] * x + vectors[which, 1] * y + vectors[which, 2] * z


@kernel("f8(f8, f8[::1], f8[:,::1], f8[:,::1], f8[:,::1], f8, f8, f8)")
def edges_bias(
    distance: float, n: Array, along: Array, turning: Array, across: Array, x: float, y: float, z: float
) -> float:  # fmt: skip
    """Return `turning_bias` of two lines at a distance [m]."""
    d, e, dd, de = along[0], along[1], turning[0], turning[1]
    a, b, c = cross_product(d[0], d[1], d[2], e[0], e[1], e[2])
    size = np.sqrt(a * a + b * b + c * c)
    r0, r1, r2 = cross_product(dd[0], dd[1], dd[2], e[0], e[1], e[2])
    a, b, c = cross_product(d[0], d[1], d[2], de[0], de[1], de[2])
    r0, r1, r2 = (r0 + a) / size, (r1 + b) / size, (r2 + c) / size
    along_n = r0 * n[0] + r1 * n[1] + r2 * n[2]
    # how the normal turns
    r0, r1, r2 = r0 - along_n * n[0], r1 - along_n * n[1], r2 - along_n * n[2]
    # the velocity of the nearest point of the second line relative to that of the first
    s = across[1]
    x, y, z = x + distance * s[0], y + distance * s[1], z + distance * s[2]
    bias = r0 * x + r1 * y + r2 * z - distance * (s[0] * s[0] + s[1] * s[1] + s[2] * s[2])
    # the nearest points move along both lines
    x, y, z = x - distance * r0, y - distance * r1, z - distance * r2
    a, b, c = cross_product(x, y, z, e[0], e[1], e[2])
    first = (a * n[0] + b * n[1] + c * n[2]) / size
    a, b, c = cross_product(x, y, z, d[0], d[1], d[2])
    second = (a * n[0] + b * n[1] + c * n[2]) / size
    for k in range(3):
        bias += n[k] * (second * de[k] - first * dd[k])
    return bias


@kernel("UniTuple(f8, 3)(i8, f8[::1], f8[:,::1], f8[:,::1], f8[:,::1])")
def way_along_rim(
    disc: int, n: Array, along: Array, turning: Array, across: Array
) -> tuple[float, float, float]:  # fmt: skip
    """Return the velocity of the lowest point of a rim relative to its body; `disc` is the side that has it.

    Zero where the disc lies flat, so that any point may be the lowest. The other arguments are those of `turning_bias`.
    """
    axis, sign = along[disc], 1.0 if disc == 1 else -1.0
    radius = np.sqrt(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2])
    up, rate = np.empty(3), np.empty(3)
    size = share = change = grows = 0.0
    for k in range(3):
        share += sign * n[k] * axis[k] / radius
        change += sign * (across[1 - disc, k] * axis[k] + n[k] * turning[disc, k]) / radius
    for k in range(3):
        up[k] = sign * n[k] - share * axis[k] / radius
        rate[k] = sign * across[1 - disc, k] - (change * axis[k] + share * turning[disc, k]) / radius
        size += up[k] * up[k]
    size = np.sqrt(size)
    if size <= LEVEL:
        return 0.0, 0.0, 0.0
    for k in range(3):
        grows += up[k] * rate[k] / size
    for k in range(3):
        # the rate of the direction from the lowest point to the centre, less that within the disc
        within = sign * across[disc, k] - share * turning[disc, k] / radius
        rate[k] = -radius * (rate[k] - grows * up[k] / size - within) / size
    return rate[0], rate[1], rate[2]


@kernel("f8(i8, f8, f8[::1], f8[:,::1], f8[:,::1], f8[:,::1], f8, f8, f8)")
def turning_bias(
    kind: int, radius: float, n: Array, along: Array, turning: Array, across: Array, x: float, y: float, z: float
) -> float:  # fmt: skip
    """Return what the turning of features adds to (dJ/dt) v of their distance, where the gap is zero.

    Parameters
    ----------
    kind, radius
        See `touch`.
    n : ndarray, shape (3,)
        The normal.
    along, turning, across : ndarray, shape (2, 3)
        Directions of the features, their rates of change, and those of the normal where it turns with either body.
    x, y, z : float
        Velocity of the second body relative to the first at the contact point.
    """
    if kind == EDGES:
        return edges_bias(radius, n, along, turning, across, x, y, z)
    if kind == POINTS:
        s = across[1]
        x, y, z = x + radius * s[0], y + radius * s[1], z + radius * s[2]
        normal = n[0] * x + n[1] * y + n[2] * z
        size = s[0] * s[0] + s[1] * s[1] + s[2] * s[2]
        return (x * x + y * y + z * z - normal * normal) / radius - radius * size
    if kind == LINE_VERTEX or kind == VERTEX_LINE:
        side = 0 if kind == LINE_VERTEX else 1
        d = along[side]
        a, b, c = cross_product(d[0], d[1], d[2], n[0], n[1], n[2])
        slip = a * x + b * y + c * z
        return 2.0 * along_vector(across, side, x, y, z) + slip * slip / radius
    # the normal turns with the body that has the face
    bias = 2.0 * along_vector(across, 1 if kind == VERTEX_FACE or kind == RIM_FACE else 0, x, y, z)
    if kind == FACE_RIM or kind == RIM_FACE:
        disc = 1 if kind == FACE_RIM else 0
        u, v, w = way_along_rim(disc, n, along, turning, across)
        bias += along_vector(across, 0, u, v, w) - along_vector(across, 1, u, v, w)
    return bias


@kernel("void(i8[::1], f8[::1], f8[:,::1], f8[:,:,::1], f8[:,:,::1], f8[:,:,::1], f8[:,::1], f8[::1])")
def add_turning_biases(
    kind: Array, radius: Array, n: Array, along: Array, turning: Array, across: Array, sliding: Array, bias: Array
) -> None:  # fmt: skip
    """Add `turning_bias` of several rows to `bias`, shape (k,); normals and velocities have shape (k, 3)."""
    for i in range(len(kind)):
        s = sliding[i]
        bias[i] += turning_bias(kind[i], radius[i], n[i], along[i], turning[i], across[i], s[0], s[1], s[2])

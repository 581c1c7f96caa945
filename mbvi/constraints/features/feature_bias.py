"""(dJ/dt) v of rows that keep their features, and (dT/dt) v of their tangents T."""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ...system.mechanisms.frames import cross_product
from ..tangents import write_tangents_of
from .feature_kernels import (
    EDGES,
    FACE_RIM,
    FACE_VERTEX,
    LEVEL,
    LINE_VERTEX,
    POINTS,
    RIM_FACE,
    VERTEX_FACE,
    VERTEX_LINE,
)

Array = np.ndarray


@kernel("f8(f8[:,::1], i8, f8, f8, f8)")
def along_vector(vectors: Array, which: int, x: float, y: float, z: float) -> float:
    """Return the product of one of some vectors with another one."""
    return vectors[which, 0] * x + vectors[which, 1] * y + vectors[which, 2] * z


@kernel("void(f8[:,::1], f8[:,::1], f8[::1], f8[:,::1], f8[:,::1])")
def turn_with_bodies(spin: Array, along: Array, n: Array, turning: Array, across: Array) -> None:
    """Write the rates of directions of either body and of the normal, where these turn with the bodies, shape (2, 3).

    `spin`, shape (2, 3), are angular velocities [rad/s].
    """
    for side in range(2):
        s, d, t, r = spin[side], along[side], turning[side], across[side]
        t[0], t[1], t[2] = cross_product(s[0], s[1], s[2], d[0], d[1], d[2])
        r[0], r[1], r[2] = cross_product(s[0], s[1], s[2], n[0], n[1], n[2])


@kernel("UniTuple(f8, 5)(f8, f8[::1], f8[:,::1], f8[:,::1], f8[:,::1], f8, f8, f8)")
def way_along_edges(
    distance: float, n: Array, along: Array, turning: Array, across: Array, x: float, y: float, z: float
) -> tuple[float, float, float, float, float]:  # fmt: skip
    """Return how the normal of two lines turns, and how fast the nearest points move along either line."""
    d, e, dd, de = along[0], along[1], turning[0], turning[1]
    a, b, c = cross_product(d[0], d[1], d[2], e[0], e[1], e[2])
    size = np.sqrt(a * a + b * b + c * c)
    r0, r1, r2 = cross_product(dd[0], dd[1], dd[2], e[0], e[1], e[2])
    a, b, c = cross_product(d[0], d[1], d[2], de[0], de[1], de[2])
    r0, r1, r2 = (r0 + a) / size, (r1 + b) / size, (r2 + c) / size
    along_n = r0 * n[0] + r1 * n[1] + r2 * n[2]
    r0, r1, r2 = r0 - along_n * n[0], r1 - along_n * n[1], r2 - along_n * n[2]
    # the velocity of the nearest point of the second line relative to that of the first, less what the normal takes
    s = across[1]
    x, y, z = x + distance * (s[0] - r0), y + distance * (s[1] - r1), z + distance * (s[2] - r2)
    a, b, c = cross_product(x, y, z, e[0], e[1], e[2])
    first = (a * n[0] + b * n[1] + c * n[2]) / size
    a, b, c = cross_product(x, y, z, d[0], d[1], d[2])
    return r0, r1, r2, first, (a * n[0] + b * n[1] + c * n[2]) / size


@kernel("f8(f8, f8[::1], f8[:,::1], f8[:,::1], f8[:,::1], f8, f8, f8)")
def edges_bias(
    distance: float, n: Array, along: Array, turning: Array, across: Array, x: float, y: float, z: float
) -> float:  # fmt: skip
    """Return `turning_bias` of two lines at a distance [m]."""
    r0, r1, r2, first, second = way_along_edges(distance, n, along, turning, across, x, y, z)
    s = across[1]
    bias = r0 * (x + distance * s[0]) + r1 * (y + distance * s[1]) + r2 * (z + distance * s[2])
    bias -= distance * (s[0] * s[0] + s[1] * s[1] + s[2] * s[2])
    for k in range(3):
        bias += n[k] * (second * turning[1, k] - first * turning[0, k])
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


@kernel("void(i8, f8, f8[::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8[::1])")
def way_of_contact(
    kind: int, radius: float, n: Array, along: Array, turning: Array, across: Array, w: Array, turn: Array, way: Array
) -> None:  # fmt: skip
    """Write how fast the normal turns, and the velocity of the contact point on the feature relative to the first body.

    `w`, shape (3,), is the velocity of the second body relative to the first at that point; the results have the same
    shape, and the other arguments are those of `turning_bias`.
    """
    if kind == EDGES:
        turn[0], turn[1], turn[2], first, _ = way_along_edges(radius, n, along, turning, across, w[0], w[1], w[2])
        for k in range(3):
            way[k] = first * along[0, k]
        return
    # the contact point belongs to the second body, or else to the first
    moves = 1.0 if kind == FACE_VERTEX or kind == FACE_RIM or kind == LINE_VERTEX else 0.0
    for k in range(3):
        way[k] = moves * w[k]
    if kind == FACE_RIM or kind == RIM_FACE:
        u, v, x = way_along_rim(1 if kind == FACE_RIM else 0, n, along, turning, across)
        way[0], way[1], way[2] = way[0] + u, way[1] + v, way[2] + x
    if kind == POINTS:
        normal = n[0] * w[0] + n[1] * w[1] + n[2] * w[2]
        for k in range(3):
            turn[k] = (w[k] - normal * n[k]) / radius + across[1, k]
    elif kind == LINE_VERTEX or kind == VERTEX_LINE:
        side = 0 if kind == LINE_VERTEX else 1
        d = along[side]
        a, b, c = cross_product(d[0], d[1], d[2], n[0], n[1], n[2])
        slip = (a * w[0] + b * w[1] + c * w[2]) / radius
        turn[0], turn[1], turn[2] = across[side, 0] + slip * a, across[side, 1] + slip * b, across[side, 2] + slip * c
    else:
        side = 1 if kind == VERTEX_FACE or kind == RIM_FACE else 0
        turn[0], turn[1], turn[2] = across[side, 0], across[side, 1], across[side, 2]


@kernel("void(f8[::1], f8[::1], f8[:,::1])")
def write_tangent_rates(n: Array, turn: Array, rates: Array) -> None:
    """Write the rates of `write_tangents_of` a unit normal that has the rate `turn`, shape (2, 3)."""
    x, y = n[0], n[1]
    sign = np.copysign(1.0, n[2])
    c = -1.0 / (sign + n[2])
    dc = c * c * turn[2]
    b = (turn[0] * y + x * turn[1]) * c + x * y * dc
    rates[0, 0], rates[0, 1], rates[0, 2] = sign * x * (2.0 * turn[0] * c + x * dc), sign * b, -sign * turn[0]
    rates[1, 0], rates[1, 1], rates[1, 2] = b, y * (2.0 * turn[1] * c + y * dc), -turn[1]


@kernel("void(i8, f8, f8, f8[::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8[::1])")
def slip_bias(
    kind: int, radius: float, shift: float, n: Array, along: Array, spin: Array, turning: Array, across: Array,
    axes: Array, w: Array, change: Array, bias: Array,
) -> None:  # fmt: skip
    """Write (dT/dt) v of the tangents T of a row where its gap is zero, shape (2,).

    Parameters
    ----------
    kind, radius, n, along, turning, across
        See `turning_bias`.
    shift : float
        How far along n the contact point is from the one that `touch` returns [m].
    spin : ndarray, shape (2, 3)
        Angular velocities of both bodies [rad/s].
    axes : ndarray, shape (2, 3)
        The tangents.
    w, change : ndarray, shape (3,)
        Velocity and acceleration of the second body relative to the first at the contact point, where no joint
        accelerates.
    bias : ndarray, shape (2,)
        Receives the rates [m/s^2].
    """
    on, turn, way, rates = np.empty(3), np.empty(3), np.empty(3), np.empty((2, 3))
    for k in range(3):
        on[k] = w[k] - shift * (across[1, k] - across[0, k])
    way_of_contact(kind, radius, n, along, turning, across, on, turn, way)
    write_tangent_rates(n, turn, rates)
    for k in range(3):
        way[k] += shift * (turn[k] - across[0, k])
    s, r = spin[1], spin[0]
    # the contact point moves along the bodies, which turn
    a, b, c = cross_product(s[0], s[1], s[2], way[0] - w[0], way[1] - w[1], way[2] - w[2])
    x, y, z = cross_product(r[0], r[1], r[2], way[0], way[1], way[2])
    a, b, c = change[0] + a - x, change[1] + b - y, change[2] + c - z
    for i in range(2):
        bias[i] = axes[i, 0] * a + axes[i, 1] * b + axes[i, 2] * c
        for k in range(3):
            bias[i] += rates[i, k] * w[k]


@kernel("void(i8[::1], f8[::1], f8[:,::1], f8[:,:,::1], f8[:,:,::1], f8[:,:,::1], f8[:,:,::1], f8[::1])")
def write_biases(
    kind: Array, radius: Array, n: Array, along: Array, velocity: Array, acceleration: Array, spin: Array, bias: Array
) -> None:  # fmt: skip
    """Write (dJ/dt) v of several rows, shape (k,).

    Parameters
    ----------
    kind, radius : ndarray, shape (k,)
        See `touch`.
    n : ndarray, shape (k, 3)
        Normals.
    along : ndarray, shape (k, 2, 3)
        Directions on either body.
    velocity, acceleration, spin : ndarray, shape (k, 2, 3)
        See `Motion`, at the points that `touch` returns.
    bias : ndarray, shape (k,)
        Receives the rates.
    """
    turning, across = np.empty((2, 3)), np.empty((2, 3))
    for i in range(len(kind)):
        turn_with_bodies(spin[i], along[i], n[i], turning, across)
        V, A, normal = velocity[i], acceleration[i], 0.0
        for k in range(3):
            normal += n[i, k] * (A[1, k] - A[0, k])
        x, y, z = V[1, 0] - V[0, 0], V[1, 1] - V[0, 1], V[1, 2] - V[0, 2]
        bias[i] = normal + turning_bias(kind[i], radius[i], n[i], along[i], turning, across, x, y, z)


@kernel("void(i8[::1], f8[::1], f8[::1], f8[:,::1], f8[:,:,::1], f8[:,:,::1], f8[:,:,::1], f8[:,:,::1], f8[:,::1])")
def write_slip_biases(
    kind: Array, radius: Array, shift: Array, n: Array, along: Array, velocity: Array, acceleration: Array,
    spin: Array, bias: Array,
) -> None:  # fmt: skip
    """Write `slip_bias` of several rows, shape (k, 2); the motion is that at the contact points."""
    turning, across, axes = np.empty((2, 3)), np.empty((2, 3)), np.empty((2, 3))
    w, change = np.empty(3), np.empty(3)
    for i in range(len(kind)):
        turn_with_bodies(spin[i], along[i], n[i], turning, across)
        write_tangents_of(n[i], axes)
        for k in range(3):
            w[k] = velocity[i, 1, k] - velocity[i, 0, k]
            change[k] = acceleration[i, 1, k] - acceleration[i, 0, k]
        slip_bias(kind[i], radius[i], shift[i], n[i], along[i], spin[i], turning, across, axes, w, change, bias[i])

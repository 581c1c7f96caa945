"""Kernels of free bodies in flat arrays: retraction, chart rates, accelerations, placements and gradients of gaps.

q has 7 numbers for each body and v has 6, as in `FreeBodies`.
"""

from __future__ import annotations

import numpy as np

from ...compiled import kernel

Array = np.ndarray

# half the angle below which a series replaces a difference with cancellation
_SMALL = 0.05
# sine of half an angle below which that is its sine
_TINY = 1e-8


@kernel("void(f8[::1], f8[::1], f8[::1])")
def integrate(q: Array, dv: Array, new: Array) -> None:
    """Write the configuration that a tangent vector leads to: centres along lines, rotations about fixed axes.

    Parameters
    ----------
    q, dv : ndarray, shapes (7 n,) and (6 n,)
        Centres and quaternions; the tangent vector.
    new : ndarray, shape (7 n,)
        Receives the configuration, with quaternions of unit length.
    """
    for body in range(len(q) // 7):
        i, j = 7 * body, 6 * body
        for c in range(3):
            new[i + c] = q[i + c] + dv[j + c]
        u, v, w = dv[j + 3], dv[j + 4], dv[j + 5]
        angle = np.sqrt(u * u + v * v + w * w)
        share = np.sin(0.5 * angle) / angle if angle > 0.0 else 0.5
        u, v, w, r = share * u, share * v, share * w, np.cos(0.5 * angle)
        x, y, z, s = q[i + 3], q[i + 4], q[i + 5], q[i + 6]
        a, b = s * u + r * x + y * w - z * v, s * v + r * y + z * u - x * w
        c, d = s * w + r * z + x * v - y * u, s * r - (x * u + y * v + z * w)
        length = np.sqrt(a * a + b * b + c * c + d * d)
        new[i + 3], new[i + 4], new[i + 5], new[i + 6] = a / length, b / length, c / length, d / length


@kernel("void(f8[::1], f8[::1], f8[::1])")
def differences(q: Array, new: Array, dv: Array) -> None:
    """Write the tangent vector from a configuration to another one, which `integrate` follows.

    Parameters
    ----------
    q, new : ndarray, shape (7 n,)
        Centres and quaternions.
    dv : ndarray, shape (6 n,)
        Receives the tangent vector; its rotations are of at most pi.
    """
    for body in range(len(q) // 7):
        i, j = 7 * body, 6 * body
        for c in range(3):
            dv[j + c] = new[i + c] - q[i + c]
        x, y, z, s = q[i + 3], q[i + 4], q[i + 5], q[i + 6]
        a, b, c, d = new[i + 3], new[i + 4], new[i + 5], new[i + 6]
        u, v, w = s * a - d * x - (y * c - z * b), s * b - d * y - (z * a - x * c), s * c - d * z - (x * b - y * a)
        cosine, sine = s * d + x * a + y * b + z * c, np.sqrt(u * u + v * v + w * w)
        # of the two quaternions of one rotation that of the smaller angle
        sign = -1.0 if cosine < 0.0 else 1.0
        factor = sign * (2.0 * np.arctan2(sine, sign * cosine) / sine if sine >= _TINY else 2.0)
        dv[j + 3], dv[j + 4], dv[j + 5] = factor * u, factor * v, factor * w


@kernel("void(f8[::1], f8[::1], f8[::1])")
def chart_rates(dv: Array, v: Array, rate: Array) -> None:
    """Write the rates of tangent vectors along a motion.

    Parameters
    ----------
    dv, v : ndarray, shape (6 n,)
        The present configuration as a tangent vector from a fixed configuration, and the velocity.
    rate : ndarray, shape (6 n,)
        Receives d(dv)/dt.
    """
    for j in range(0, len(dv), 6):
        for c in range(3):
            rate[j + c] = v[j + c]
        x, y, z, a, b, c = dv[j + 3], dv[j + 4], dv[j + 5], v[j + 3], v[j + 4], v[j + 5]
        half = 0.5 * np.sqrt(x * x + y * y + z * z)
        square = half * half
        if half < _SMALL:
            bend = (1.0 + square / 15.0 * (1.0 + square * 2.0 / 21.0)) / 3.0
        else:
            bend = (1.0 - half / np.tan(half)) / square
        d, e, f = y * c - z * b, z * a - x * c, x * b - y * a
        rate[j + 3] = a + 0.5 * d + 0.25 * bend * (y * f - z * e)
        rate[j + 4] = b + 0.5 * e + 0.25 * bend * (z * d - x * f)
        rate[j + 5] = c + 0.5 * f + 0.25 * bend * (x * e - y * d)


@kernel("void(f8[::1], f8[:,::1], f8[:,:,::1], f8[:,:,::1], f8[::1])")
def accelerations(v: Array, pull: Array, inertias: Array, inverses: Array, out: Array) -> None:
    """Write the accelerations of bodies without contacts.

    Parameters
    ----------
    v : ndarray, shape (6 n,)
        Velocities of the centres in the world, angular velocities in the bodies' axes.
    pull : ndarray, shape (n, 3)
        Accelerations of the centres [m/s^2].
    inertias, inverses : ndarray, shape (n, 3, 3)
        Inertias in the bodies' axes [kg m^2], and their inverses.
    out : ndarray, shape (6 n,)
        Receives dv/dt.
    """
    for body in range(len(pull)):
        j, J, A = 6 * body, inertias[body], inverses[body]
        for c in range(3):
            out[j + c] = pull[body, c]
        a, b, c = v[j + 3], v[j + 4], v[j + 5]
        x = J[0, 0] * a + J[0, 1] * b + J[0, 2] * c
        y = J[1, 0] * a + J[1, 1] * b + J[1, 2] * c
        z = J[2, 0] * a + J[2, 1] * b + J[2, 2] * c
        x, y, z = y * c - z * b, z * a - x * c, x * b - y * a
        for k in range(3):
            out[j + 3 + k] = A[k, 0] * x + A[k, 1] * y + A[k, 2] * z


@kernel("void(f8[::1], i8, f8[:,::1])")
def write_rotation(q: Array, i: int, axes: Array) -> None:
    """Write the columns of the rotation of the quaternion (x, y, z, w) in q from entry i on: each a row of `axes`."""
    x, y, z, w = q[i], q[i + 1], q[i + 2], q[i + 3]
    axes[0, 0], axes[1, 1] = 1.0 - 2.0 * (y * y + z * z), 1.0 - 2.0 * (x * x + z * z)
    axes[2, 2] = 1.0 - 2.0 * (x * x + y * y)
    axes[0, 1], axes[1, 0] = 2.0 * (x * y + z * w), 2.0 * (x * y - z * w)
    axes[0, 2], axes[2, 0] = 2.0 * (x * z - y * w), 2.0 * (x * z + y * w)
    axes[1, 2], axes[2, 1] = 2.0 * (y * z + x * w), 2.0 * (y * z - x * w)


@kernel("void(f8[::1], i8[::1], f8[:,:,::1])")
def placements(q: Array, bodies: Array, places: Array) -> None:
    """Write the poses of bodies.

    Parameters
    ----------
    q : ndarray, shape (7 n,)
        Centres and quaternions.
    bodies : ndarray of int, shape (k,)
        Numbers of bodies, from 1 on.
    places : ndarray, shape (k, 4, 3)
        Receives the columns of the rotation, then the centre.
    """
    for k in range(len(bodies)):
        i = 7 * (bodies[k] - 1)
        write_rotation(q, i + 3, places[k])
        for c in range(3):
            places[k, 3, c] = q[i + c]


@kernel("void(f8[::1], i8, f8, f8[:,::1], f8[:,::1], i8, f8[::1], i8)")
def _write_row(q: Array, body: int, sign: float, points: Array, normals: Array, k: int, out: Array, at: int) -> None:
    """Write the rate of point k of a body along normal k, per velocity, into six entries of `out` from `at` on."""
    i = 7 * (body - 1)
    a, b, c = sign * normals[k, 0], sign * normals[k, 1], sign * normals[k, 2]
    x, y, z, w = points[k, 0] - q[i], points[k, 1] - q[i + 1], points[k, 2] - q[i + 2], q[i + 6]
    out[at], out[at + 1], out[at + 2] = a, b, c
    a, b, c = y * c - z * b, z * a - x * c, x * b - y * a
    # rotated into the body's axes
    x, y, z = -q[i + 3], -q[i + 4], -q[i + 5]
    d, e, f = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    out[at + 3] = a + w * d + y * f - z * e
    out[at + 4] = b + w * e + z * d - x * f
    out[at + 5] = c + w * f + x * e - y * d


@kernel("i8(f8[::1], i8[::1], i8[::1], f8[:,::1], f8[:,::1], f8[::1], u4[::1], u4[::1])")
def sparse_separation_rows(
    q: Array, first: Array, second: Array, points: Array, normals: Array, data: Array, columns: Array, starts: Array
) -> int:
    """Write the gradients of the separation of pairs of bodies, as sparse rows; return how many entries there are.

    Parameters
    ----------
    q : ndarray, shape (7 n,)
        Centres and quaternions.
    first, second : ndarray of int, shape (k,)
        Numbers of bodies, from 1 on; 0 is the world, which has no entries.
    points, normals : ndarray, shape (k, 3)
        In the world; normals lead from the first bodies to the second.
    data, columns, starts : ndarray, shapes (12 k,), (12 k,), (k + 1,)
        Receive the entries, their columns, and where each row begins.
    """
    count = 0
    for k in range(len(first)):
        starts[k] = count
        for side in range(2):
            body = first[k] if side == 0 else second[k]
            if body > 0:
                _write_row(q, body, -1.0 if side == 0 else 1.0, points, normals, k, data, count)
                for c in range(6):
                    columns[count + c] = 6 * (body - 1) + c
                count += 6
    starts[len(first)] = count
    return count


@kernel("void(f8[::1], i8[::1], f8, f8[:,::1], f8[:,::1], f8[:,::1])")
def separation_rows(q: Array, bodies: Array, sign: float, points: Array, normals: Array, rows: Array) -> None:
    """Write the rates of points of bodies along normals, per velocity.

    Parameters
    ----------
    q : ndarray, shape (7 n,)
        Centres and quaternions.
    bodies : ndarray of int, shape (k,)
        Numbers of bodies, from 1 on; 0 is the world, whose rows are zero.
    sign : float
        Factor of all rows.
    points, normals : ndarray, shape (k, 3)
        In the world.
    rows : ndarray, shape (k, 6)
        Receives the rows.
    """
    out = rows.reshape(-1)
    for k in range(len(bodies)):
        if bodies[k] == 0:
            for c in range(6):
                rows[k, c] = 0.0
        else:
            _write_row(q, bodies[k], sign, points, normals, k, out, 6 * k)


@kernel("void(f8[::1], i8[::1], f8, f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1])")
def planar_separation_rows(
    q: Array, bodies: Array, sign: float, axes: Array, points: Array, normals: Array, rows: Array
) -> None:
    """Write the rows of `separation_rows` for bodies that move in a plane.

    Parameters
    ----------
    q, bodies, sign, points, normals
        As `separation_rows`.
    axes : ndarray, shape (3, 3)
        In its rows the two directions of the velocities, and the rotation axis.
    rows : ndarray, shape (k, 3)
        Receives the rows.
    """
    for k in range(len(bodies)):
        if bodies[k] == 0:
            rows[k, 0] = rows[k, 1] = rows[k, 2] = 0.0
            continue
        i = 7 * (bodies[k] - 1)
        a, b, c = sign * normals[k, 0], sign * normals[k, 1], sign * normals[k, 2]
        x, y, z = points[k, 0] - q[i], points[k, 1] - q[i + 1], points[k, 2] - q[i + 2]
        for row in range(2):
            rows[k, row] = axes[row, 0] * a + axes[row, 1] * b + axes[row, 2] * c
        a, b, c = y * c - z * b, z * a - x * c, x * b - y * a
        rows[k, 2] = axes[2, 0] * a + axes[2, 1] * b + axes[2, 2] * c

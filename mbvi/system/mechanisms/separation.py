"""Kernels of points of bodies: gradients of separations, and accelerations that velocities alone cause."""

from __future__ import annotations

from ...compiled import kernel
from ..system import Array


@kernel("void(f8[:,::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1])")
def row(columns: Array, first: Array, second: Array, point: Array, normal: Array, row: Array) -> None:
    """Write the gradient of the separation of two bodies at a point.

    Parameters
    ----------
    columns : ndarray, shape (nv, 6)
        Jacobian columns in the world, one in each row.
    first, second : ndarray, shape (nv,)
        1 where a velocity moves the body, else 0.
    point, normal : ndarray, shape (3,) or longer, of which the first three entries count
        Contact point and normal from the first to the second body, in the world.
    row : ndarray, shape (nv,)
        Receives [n, p x n]' columns, signed by which of the two bodies a velocity moves.
    """
    x, y, z = normal[0], normal[1], normal[2]
    u, v, w = point[1] * z - point[2] * y, point[2] * x - point[0] * z, point[0] * y - point[1] * x
    for k in range(len(row)):
        sign = second[k] - first[k]
        row[k] = 0.0
        if sign != 0.0:
            c = columns[k]
            row[k] = sign * (x * c[0] + y * c[1] + z * c[2] + u * c[3] + v * c[4] + w * c[5])


@kernel("void(f8[:,::1], f8[::1], f8[::1], f8[::1], f8[::1])")
def turning_row(columns: Array, first: Array, second: Array, axis: Array, row: Array) -> None:
    """Write the gradient of the angular velocity of the second body relative to the first about an axis; see `row`."""
    for k in range(len(row)):
        c = columns[k]
        row[k] = (second[k] - first[k]) * (axis[0] * c[3] + axis[1] * c[4] + axis[2] * c[5])


@kernel("void(f8[:,::1], f8[:,::1], i8[::1], i8[::1], f8[:,::1], f8[:,::1], f8[:,::1])")
def separation(
    columns: Array, support: Array, first: Array, second: Array, point: Array, normal: Array, rows: Array
) -> None:
    """Write `row` of several contacts: bodies of shape (m,), points and normals (m, 3), rows (m, nv)."""
    for a in range(len(rows)):
        row(columns, support[first[a]], support[second[a]], point[a], normal[a], rows[a])


@kernel("void(f8[:,:,::1], i8[::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1])")
def write_bias(poses: Array, bodies: Array, points: Array, twists: Array, rates: Array, bias: Array) -> None:
    """Write the accelerations of points of moving bodies, shape (k, 3), in the world.

    Parameters
    ----------
    poses : ndarray, shape (njoints, 4, 3)
        Columns of each body's rotation, then its origin.
    bodies : ndarray of int, shape (k,)
        The body of each point.
    points : ndarray, shape (k, 3)
        In the bodies' frames.
    twists, rates : ndarray, shape (k, 6)
        Spatial velocities and accelerations of the bodies, linear parts first, in their frames.
    """
    for k in range(len(bodies)):
        P, p, w, r = poses[bodies[k]], points[k], twists[k], rates[k]
        x = w[0] + w[4] * p[2] - w[5] * p[1]
        y = w[1] + w[5] * p[0] - w[3] * p[2]
        z = w[2] + w[3] * p[1] - w[4] * p[0]
        a = r[0] + r[4] * p[2] - r[5] * p[1] + w[4] * z - w[5] * y
        b = r[1] + r[5] * p[0] - r[3] * p[2] + w[5] * x - w[3] * z
        c = r[2] + r[3] * p[1] - r[4] * p[0] + w[3] * y - w[4] * x
        for i in range(3):
            bias[k, i] = a * P[0, i] + b * P[1, i] + c * P[2, i]

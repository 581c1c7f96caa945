"""Plain numpy forms of the kernels in mbvi/system/articulated.py."""

from __future__ import annotations

import numpy as np

from mbvi.arguments import Array


def row_plain(columns: Array, first: Array, second: Array, point: Array, normal: Array, row: Array) -> None:
    """Write the gradient of the separation of two bodies at a point.

    Parameters
    ----------
    columns : ndarray, shape (nv, 6)
        Jacobian columns in the world, one a row.
    first, second : ndarray, shape (nv,)
        1 where a velocity moves the body, else 0.
    point, normal : ndarray, shape (3,) or more, of which the first three count
        Contact point and normal from the first to the second body, in the world.
    row : ndarray, shape (nv,)
        Receives [n, p x n]' columns, signed by which of the two bodies a velocity moves.
    """
    row[:] = columns @ np.concatenate([normal, np.cross(point[:3], normal)]) * (second - first)


def separation_plain(
    columns: Array, support: Array, first: Array, second: Array, point: Array, normal: Array, rows: Array
) -> None:
    """Write `row_plain` of several contacts: bodies of shape (m,), points and normals (m, 3), rows (m, nv)."""
    for a in range(len(rows)):
        row_plain(columns, support[first[a]], support[second[a]], point[a], normal[a], rows[a])


def _add_scaled_plain(v: Array, h: float, a: Array) -> None:
    """Overwrite a by v + h a, both of shape (nv,)."""
    a[:] = v + h * a


def _bias_plain(poses: Array, bodies: Array, points: Array, twists: Array, rates: Array, bias: Array) -> None:
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
    spin = twists[:, 3:]
    speed = twists[:, :3] + np.cross(spin, points)
    bias[:] = np.vecmat(rates[:, :3] + np.cross(rates[:, 3:], points) + np.cross(spin, speed), poses[bodies, :3])

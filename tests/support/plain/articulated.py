"""Plain numpy forms of the kernels in mbvi/system/mechanisms/articulated.py."""

from __future__ import annotations

import numpy as np

from mbvi.arguments import Array


def row_plain(columns: Array, first: Array, second: Array, point: Array, normal: Array, row: Array) -> None:
    """Write the gradient of the separation of two bodies at a point."""
    row[:] = columns @ np.concatenate([normal, np.cross(point[:3], normal)]) * (second - first)


def separation_plain(
    columns: Array, support: Array, first: Array, second: Array, point: Array, normal: Array, rows: Array
) -> None:
    """Write `row_plain` of several contacts: bodies of shape (m,), points and normals (m, 3), rows (m, nv)."""
    for a in range(len(rows)):
        row_plain(columns, support[first[a]], support[second[a]], point[a], normal[a], rows[a])


def write_bias_plain(poses: Array, bodies: Array, points: Array, twists: Array, rates: Array, bias: Array) -> None:
    """Write the accelerations of points of moving bodies, shape (k, 3), in the world."""
    spin = twists[:, 3:]
    speed = twists[:, :3] + np.cross(spin, points)
    bias[:] = np.vecmat(rates[:, :3] + np.cross(rates[:, 3:], points) + np.cross(spin, speed), poses[bodies, :3])

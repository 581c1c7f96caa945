"""Plain numpy forms of the kernels in mbvi/geometry/narrow/support_points.py."""

from __future__ import annotations

import numpy as np

from mbvi.arguments import Array
from mbvi.geometry.narrow.support_points import _LEVEL


def lowest_plain(places: Array, body: int, numbers: Array, i: int, out: Array) -> None:
    """Write contact point and gap, shape (4,), of one point of a body above a half-space."""
    P, number = places[body], numbers[i]
    swell, up = number[3:12].reshape(3, 3), number[12:15]
    toward = swell @ (P[:3] @ up)
    length = np.linalg.norm(toward)
    lowest = -toward / length if length > _LEVEL * np.abs(swell).max() else np.array([1.0, 0.0, 0.0])
    world = (number[:3] + lowest @ swell) @ P[:3] + P[3]
    out[:3], out[3] = world - number[15] * up, world @ up - number[16]


def stand_plain(places: Array, owners: Array, numbers: Array, gap: Array, point: Array) -> None:
    """Write gaps, shape (k,), and contact points, shape (k, 3), of points of bodies above half-spaces."""
    local, swell, up = numbers[:, :3], numbers[:, 3:12].reshape(-1, 3, 3), numbers[:, 12:15]
    R, origin = places[owners[:, 0], :3], places[owners[:, 0], 3]
    toward = np.matvec(swell, np.matvec(R, up))
    length = np.sqrt(np.vecdot(toward, toward))[:, None]
    tilted = length > _LEVEL * np.abs(swell).max(axis=(1, 2), initial=0.0)[:, None]
    lowest = np.where(tilted, -toward / np.where(tilted, length, 1.0), np.array([1.0, 0.0, 0.0]))
    world = np.vecmat(local + np.vecmat(lowest, swell), R) + origin
    gap[:], point[:] = np.vecdot(world, up) - numbers[:, 16], world - numbers[:, 15:16] * up

"""Unit quaternions (x, y, z, w), one in each row, and the maps on them that free bodies need, for all rows at once."""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def matrices(a: Array) -> Array:
    """Return the rotation matrices, shape (n, 3, 3)."""
    x, y, z, w = a.T
    R = np.empty((len(a), 3, 3))
    R[:, 0, 0], R[:, 1, 1], R[:, 2, 2] = 1 - 2 * (y * y + z * z), 1 - 2 * (x * x + z * z), 1 - 2 * (x * x + y * y)
    R[:, 0, 1], R[:, 1, 0] = 2 * (x * y - z * w), 2 * (x * y + z * w)
    R[:, 0, 2], R[:, 2, 0] = 2 * (x * z + y * w), 2 * (x * z - y * w)
    R[:, 1, 2], R[:, 2, 1] = 2 * (y * z - x * w), 2 * (y * z + x * w)
    return R


def compose(a: Array, b: Array) -> Array:
    """Return the products a b, shape (n, 4)."""
    product = np.empty_like(a)
    u, v, s, t = a[:, :3], b[:, :3], a[:, 3:], b[:, 3:]
    product[:, :3] = s * v + t * u
    product[:, 0] += u[:, 1] * v[:, 2] - u[:, 2] * v[:, 1]
    product[:, 1] += u[:, 2] * v[:, 0] - u[:, 0] * v[:, 2]
    product[:, 2] += u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    product[:, 3] = s[:, 0] * t[:, 0] - np.einsum("ij,ij->i", u, v)
    return product

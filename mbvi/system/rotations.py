"""Unit quaternions (x, y, z, w) in rows, and the few maps on them that free bodies need in bulk."""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def cross(a: Array, b: Array) -> Array:
    """Return a x b of two vectors, shape (3,); numpy's own costs ten times as much on one pair."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def matrix(quaternion: Array) -> Array:
    """Return the rotation matrix, shape (3, 3), of a unit quaternion."""
    x, y, z, w = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


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


def conjugate(a: Array) -> Array:
    """Return the inverses, shape (n, 4)."""
    return a * np.array([-1.0, -1.0, -1.0, 1.0])


def exp(w: Array) -> Array:
    """Return the rotations by the vectors w, shape (n, 3) [rad]."""
    angle = np.sqrt(np.einsum("ij,ij->i", w, w))
    # sinc(x) = sin(pi x) / (pi x) is exact at zero
    return np.concatenate([0.5 * np.sinc(angle / (2 * np.pi))[:, None] * w, np.cos(angle / 2)[:, None]], axis=1)


def log(a: Array) -> Array:
    """Return the rotation vectors, shape (n, 3) [rad], of norm at most pi."""
    a = np.where(a[:, 3:] < 0.0, -a, a)
    sine = np.sqrt(np.einsum("ij,ij->i", a[:, :3], a[:, :3]))
    half = np.arctan2(sine, a[:, 3])
    small = sine < 1e-8
    factor = np.where(small, 2.0, 2.0 * half / np.where(small, 1.0, sine))
    return factor[:, None] * a[:, :3]

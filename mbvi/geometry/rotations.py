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


def chart_rate(w: Array, spin: Array) -> Array:
    """Return dw/dt, shape (n, 3), of bodies with rotation exp(w) and angular velocity `spin` in the body."""
    angle = np.sqrt(np.einsum("ij,ij->i", w, w))
    half = 0.5 * angle
    # (1 - x cot x) / x^2 at x = half the angle; for small x by its series, because the difference loses digits
    small = half < 0.05
    x = np.where(small, 1.0, half)
    c = np.where(small, (1 + half**2 / 15 * (1 + half**2 * 2 / 21)) / 3, (1 - x / np.tan(x)) / x**2)
    once = np.cross(w, spin)
    return spin + 0.5 * once + 0.25 * c[:, None] * np.cross(w, once)

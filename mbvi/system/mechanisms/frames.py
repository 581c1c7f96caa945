"""Kernels that turn frames, of shape (4, 3): the three columns of the rotation, then the origin."""

from __future__ import annotations

import numpy as np

from ...compiled import kernel

Array = np.ndarray


@kernel("UniTuple(f8, 3)(f8, f8, f8, f8, f8, f8)")
def cross_product(a: float, b: float, c: float, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return (a, b, c) x (x, y, z)."""
    return b * z - c * y, c * x - a * z, a * y - b * x


@kernel("UniTuple(f8, 3)(f8[:,::1], f8, f8, f8)")
def turned(pose: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return a vector of a frame in the world's axes."""
    return (
        pose[0, 0] * x + pose[1, 0] * y + pose[2, 0] * z,
        pose[0, 1] * x + pose[1, 1] * y + pose[2, 1] * z,
        pose[0, 2] * x + pose[1, 2] * y + pose[2, 2] * z,
    )


@kernel("void(f8[:,::1], f8[::1], f8, f8)")
def turn_about(pose: Array, axis: Array, sine: float, cosine: float) -> None:
    """Turn a frame about an axis of its own, a unit vector (Rodrigues' formula)."""
    a, b, c = turned(pose, axis[0], axis[1], axis[2])
    for k in range(3):
        x, y, z, along = pose[k, 0], pose[k, 1], pose[k, 2], (1.0 - cosine) * axis[k]
        d, e, f = cross_product(a, b, c, x, y, z)
        pose[k, 0] = cosine * x + sine * d + along * a
        pose[k, 1] = cosine * y + sine * e + along * b
        pose[k, 2] = cosine * z + sine * f + along * c


@kernel("void(f8[:,::1], f8, f8, f8, f8)")
def turn_by(pose: Array, x: float, y: float, z: float, w: float) -> None:
    """Turn a frame by a unit quaternion."""
    a, b, c = turned(pose, 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w), 2.0 * (x * z - y * w))
    d, e, f = turned(pose, 2.0 * (x * y - z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + x * w))
    g, h, k = turned(pose, 2.0 * (x * z + y * w), 2.0 * (y * z - x * w), 1.0 - 2.0 * (x * x + y * y))
    pose[0, 0], pose[0, 1], pose[0, 2], pose[1, 0], pose[1, 1], pose[1, 2] = a, b, c, d, e, f
    pose[2, 0], pose[2, 1], pose[2, 2] = g, h, k

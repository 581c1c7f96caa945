"""Kernels on vectors of three components."""

from __future__ import annotations

import numpy as np

from ..arguments import Array
from ..compiled import kernel


@kernel("f8(f8[::1], f8[::1])")
def dot(a: Array, b: Array) -> float:
    """Return the scalar product of two vectors, shape (3,)."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel("void(f8[::1], f8[::1], f8[::1])")
def cross(a: Array, b: Array, c: Array) -> None:
    """Write the cross product of two vectors into a third."""
    for i in range(3):
        c[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3]


@kernel("f8(f8[::1])")
def normalise(a: Array) -> float:
    """Divide a vector by its length; return the length."""
    length = np.sqrt(dot(a, a))
    for i in range(3):
        a[i] /= length
    return length


@kernel("void(f8[::1], f8[::1], f8[::1])")
def within_plane(normal: Array, along: Array, across: Array) -> None:
    """Write two unit vectors, shape (3,), normal to a unit vector and to each other."""
    least = 0
    for c in range(1, 3):
        if abs(normal[c]) < abs(normal[least]):
            least = c
    size = np.sqrt(1.0 - normal[least] ** 2)
    for c in range(3):
        along[c] = ((1.0 if c == least else 0.0) - normal[least] * normal[c]) / size
    cross(normal, along, across)

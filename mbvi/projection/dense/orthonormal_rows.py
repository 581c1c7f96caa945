"""Kernels for an orthonormal basis of active rows: W_S = L Q, with L lower triangular, changed row by row."""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ..metric import Array
from ..tree_factor import remove_four, remove_one, squared


@kernel("f8(f8[::1], f8[::1])")
def inner(x: Array, y: Array) -> float:
    """Return the scalar product of two vectors."""
    total = 0.0
    for k in range(len(x)):
        total += x[k] * y[k]
    return total


@kernel("f8(f8[::1], i8, f8, f8[:,::1], f8[:,::1])")
def append_row(row: Array, size: int, least: float, L: Array, Q: Array) -> float:
    """Write the factors with one more row; return the length of its part across the others.

    Parameters
    ----------
    row : ndarray, shape (n,)
        The new row.
    size : int
        Number of rows so far. Entry `size` of L and Q is written.
    least : float
        Where the part across is shorter than this, its direction is not computed.
    L, Q : ndarray, shapes (k, k), (k, n), k > size
        The factors.
    """
    n, new, fours = len(row), Q[size], size - size % 4
    for k in range(n):
        new[k] = row[k]
    for j in range(size):
        L[size, j] = 0.0
    before, after = squared(new), 0.0
    for _ in range(3):
        for j in range(0, fours, 4):
            a, b, c, d = remove_four(Q, j, new)
            L[size, j], L[size, j + 1] = L[size, j] + a, L[size, j + 1] + b
            L[size, j + 2], L[size, j + 3] = L[size, j + 2] + c, L[size, j + 3] + d
        for j in range(fours, size):
            L[size, j] += remove_one(Q, j, new)
        after = squared(new)
        # what remains of a much longer vector is not orthogonal to rounding: once more
        if after > 0.5 * before or after < least * least:
            break
        before = after
    length = np.sqrt(after)
    L[size, size] = length
    if length > 0.0:
        for k in range(n):
            Q[size, k] /= length
    return length


@kernel("void(i8, i8, f8[:,::1], f8[:,::1])")
def remove_row(size: int, place: int, L: Array, Q: Array) -> None:
    """Write the factors of `size` rows without the one at a place, by plane rotations."""
    n = Q.shape[1]
    for i in range(place, size - 1):
        for j in range(i + 2):
            L[i, j] = L[i + 1, j]
        a, b = L[i, i], L[i, i + 1]
        length = np.sqrt(a * a + b * b)
        c, s = a / length, b / length
        L[i, i] = length
        for t in range(i + 2, size):
            a, b = L[t, i], L[t, i + 1]
            L[t, i], L[t, i + 1] = c * a + s * b, c * b - s * a
        for k in range(n):
            a, b = Q[i, k], Q[i + 1, k]
            Q[i, k], Q[i + 1, k] = c * a + s * b, c * b - s * a


@kernel("void(f8[:,::1], i8, f8[::1])")
def solve_lower(L: Array, size: int, y: Array) -> None:
    """Overwrite the first entries of y by L^-1 y."""
    for i in range(size):
        for j in range(i):
            y[i] -= L[i, j] * y[j]
        y[i] /= L[i, i]


@kernel("void(f8[:,::1], i8, f8[::1])")
def solve_upper(L: Array, size: int, y: Array) -> None:
    """Overwrite the first entries of y by L'^-1 y."""
    for i in range(size - 1, -1, -1):
        y[i] /= L[i, i]
        for j in range(i):
            y[j] -= L[i, j] * y[i]

"""Incomplete Cholesky factors of sparse Delassus matrices, as preconditioners."""

from __future__ import annotations

import numpy as np

from ..compiled import kernel
from .metric import Array

# pivots are above this
_LEAST = 1e-3


@kernel("b1(u4[::1], u4[::1], f8[::1], f8, u4[::1], u4[::1], f8[::1])")
def incomplete_cholesky(
    starts: Array, columns: Array, G: Array, shift: float, rows: Array, places: Array, L: Array
) -> bool:
    """Write a lower triangular L with L L' near G + shift, where G has entries; or return False at a lost pivot.

    Parameters
    ----------
    starts, columns, G : ndarray, shapes (n + 1,), (k,), (k,)
        A symmetric matrix with unit diagonal, row after row, columns ascending.
    shift : float
        Added to the diagonal.
    rows : ndarray of int, shape (n + 1,)
        Receives where the rows of L start; the diagonal comes last in each.
    places, L : ndarray, shape (c,), c >= (k + n) / 2
        Receive columns and values.
    """
    n, count = len(starts) - 1, 0
    # the row that is made, in full
    row = np.zeros(n)
    rows[0] = 0
    for i in range(n):
        first, pivot = count, 1.0 + shift
        for k in range(starts[i], starts[i + 1]):
            j = columns[k]
            if j >= i:
                break
            value, last = G[k], rows[j + 1] - 1
            for entry in range(rows[j], last):
                value -= L[entry] * row[places[entry]]
            value /= L[last]
            row[j], places[count], L[count] = value, j, value
            pivot -= value * value
            count += 1
        for entry in range(first, count):
            row[places[entry]] = 0.0
        # what comes after a small pivot grows
        if not pivot > _LEAST:
            return False
        places[count], L[count] = i, np.sqrt(pivot)
        count += 1
        rows[i + 1] = count
    return True


@kernel("void(u4[::1], u4[::1], f8[::1], f8[::1], f8[::1])")
def solve_factor(rows: Array, places: Array, L: Array, right: Array, out: Array) -> None:
    """Write (L L')^-1 right for a factor as `incomplete_cholesky` writes it."""
    n = len(right)
    for i in range(n):
        value, last = right[i], rows[i + 1] - 1
        for k in range(rows[i], last):
            value -= L[k] * out[places[k]]
        out[i] = value / L[last]
    for i in range(n - 1, -1, -1):
        last = rows[i + 1] - 1
        value = out[i] / L[last]
        out[i] = value
        for k in range(rows[i], last):
            out[places[k]] -= L[k] * value

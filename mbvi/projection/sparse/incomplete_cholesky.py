"""Incomplete Cholesky factors of sparse Delassus matrices, as preconditioners."""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ..metric import Array

# least pivot, relative to the unit diagonal: below it the rows that follow would grow without bound
_LEAST = 1e-3


@kernel("b1(u4[::1], u4[::1], f8[::1], f8, u4[::1], u4[::1], f8[::1])")
def incomplete_cholesky(
    starts: Array, columns: Array, G: Array, shift: float, rows: Array, places: Array, L: Array
) -> bool:
    """Write a lower triangular L, with the entries of G only, so that L L' is near G + shift I.

    Return False if a pivot is too small: call again with a larger shift.

    Parameters
    ----------
    starts, columns, G : ndarray, shapes (n + 1,), (k,), (k,)
        A symmetric matrix with unit diagonal, row after row, columns ascending.
    shift : float
        Added to the diagonal.
    rows : ndarray of int, shape (n + 1,)
        Receives the start of each row of L; the diagonal entry is the last of its row.
    places, L : ndarray, shape (c,), c >= (k + n) / 2
        Receive the columns and values of L.
    """
    n, count = len(starts) - 1, 0
    # the current row of L, as a full vector
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
        # dividing by a small pivot would make later rows huge
        if not pivot > _LEAST:
            return False
        places[count], L[count] = i, np.sqrt(pivot)
        count += 1
        rows[i + 1] = count
    return True


@kernel("void(u4[::1], u4[::1], f8[::1], f8[::1], f8[::1])")
def solve_factor(rows: Array, places: Array, L: Array, right: Array, out: Array) -> None:
    """Write (L L')^-1 right, for the factor L of `incomplete_cholesky`."""
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

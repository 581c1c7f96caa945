"""Incomplete Cholesky factors of sparse Delassus matrices, as preconditioners."""

from __future__ import annotations

import numpy as np

from ..compiled import kernel
from .metric import Array

# the share of what is dropped that is added to the diagonal; products smaller than the second make no new entry; pivots
# are above the third
_KEPT, _FILL, _LEAST = 0.2, 0.02, 0.02


def incomplete_cholesky_plain(
    starts: Array, columns: Array, G: Array, shift: float, drop: float, rows: Array, places: Array, L: Array
) -> bool:
    """Write a lower triangular L with L L' near G + shift; or return False at a pivot that what is dropped has spoilt.

    Parameters
    ----------
    starts, columns, G : ndarray, shapes (n + 1,), (k,), (k,)
        A symmetric matrix with unit diagonal, row after row, columns ascending.
    shift : float
        Added to the diagonal.
    drop : float
        Entries below this share of the root of their pivot are left out.
    rows : ndarray of int, shape (n + 1,)
        Receives where the rows of L start; the diagonal comes last in each.
    places, L : ndarray, shape (c,), c >= n
        Receive columns and values; what finds no place is dropped.
    """
    n = len(starts) - 1
    full, count = np.zeros((n, n)), 0
    rows[0] = 0
    for i in range(n):
        w, there = np.zeros(n), np.zeros(n, bool)
        here = slice(starts[i], starts[i + 1])
        w[columns[here]], there[columns[here]] = G[here], True
        diagonal = 1.0 + shift
        for k in range(i):
            if not there[k]:
                continue
            if abs(w[k]) < drop * full[k, k] or count >= len(L) - (n - i):
                diagonal += _KEPT * abs(w[k])
                continue
            full[i, k] = w[k] / full[k, k]
            change = full[i, k] * full[k + 1 : i, k]
            taken = there[k + 1 : i] | (np.abs(change) > _FILL)
            w[k + 1 : i] -= np.where(taken, change, 0.0)
            there[k + 1 : i] |= taken
            places[count], L[count] = k, full[i, k]
            count += 1
        pivot = diagonal - full[i, :i] @ full[i, :i]
        if not pivot > _LEAST:
            return False
        full[i, i] = np.sqrt(pivot)
        places[count], L[count] = i, full[i, i]
        count += 1
        rows[i + 1] = count
    return True


@kernel("b1(i4[::1], i4[::1], f8[::1], f8, f8, i4[::1], i4[::1], f8[::1])", plain=incomplete_cholesky_plain)
def incomplete_cholesky(
    starts: Array, columns: Array, G: Array, shift: float, drop: float, rows: Array, places: Array, L: Array
) -> bool:
    """Loops of `incomplete_cholesky_plain`."""
    n, room = len(starts) - 1, len(L)
    # the entries of each column so far, linked
    head, following, owner = np.full(n, -1, np.int32), np.empty(room, np.int32), np.empty(room, np.int32)
    w, mark, pattern = np.zeros(n), np.full(n, -1, np.int32), np.empty(n, np.int32)
    count = 0
    rows[0] = 0
    for i in range(n):
        size, first, diagonal, turn = 0, count, 1.0 + shift, 0
        for k in range(starts[i], starts[i + 1]):
            j = columns[k]
            if j < i:
                pattern[size] = j
                w[j] = G[k]
                mark[j] = i
                size += 1
        while turn < size:
            k = pattern[turn]
            turn += 1
            pivot = L[rows[k + 1] - 1]
            if abs(w[k]) < drop * pivot or count >= room - (n - i):
                diagonal += _KEPT * abs(w[k])
                continue
            value = w[k] / pivot
            places[count], L[count] = k, value
            entry = head[k]
            while entry >= 0:
                j, change = owner[entry], L[entry] * value
                if mark[j] == i:
                    w[j] -= change
                elif abs(change) > _FILL:
                    mark[j] = i
                    w[j] = -change
                    place = size
                    while place > turn and pattern[place - 1] > j:
                        pattern[place] = pattern[place - 1]
                        place -= 1
                    pattern[place] = j
                    size += 1
                entry = following[entry]
            count += 1
        for k in range(first, count):
            diagonal -= L[k] * L[k]
            owner[k] = i
            following[k] = head[places[k]]
            head[places[k]] = k
        # what comes after a small pivot grows, and fills the factor
        if not diagonal > _LEAST:
            return False
        places[count], L[count] = i, np.sqrt(diagonal)
        count += 1
        rows[i + 1] = count
    return True


def solve_factor_plain(rows: Array, places: Array, L: Array, right: Array, out: Array) -> None:
    """Write (L L')^-1 right for a factor as `incomplete_cholesky` writes it."""
    n = len(right)
    full = np.zeros((n, n))
    for i in range(n):
        full[i, places[rows[i] : rows[i + 1]]] = L[rows[i] : rows[i + 1]]
    out[:] = np.linalg.solve(full @ full.T, right)


@kernel("void(i4[::1], i4[::1], f8[::1], f8[::1], f8[::1])", plain=solve_factor_plain)
def solve_factor(rows: Array, places: Array, L: Array, right: Array, out: Array) -> None:
    """Loops of `solve_factor_plain`."""
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

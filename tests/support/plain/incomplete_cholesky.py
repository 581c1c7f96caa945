"""Plain numpy forms of the kernels in mbvi/projection/sparse/incomplete_cholesky.py."""

from __future__ import annotations

import numpy as np

from mbvi.arguments import Array
from mbvi.projection.sparse.incomplete_cholesky import _LEAST


def incomplete_cholesky_plain(
    starts: Array, columns: Array, G: Array, shift: float, rows: Array, places: Array, L: Array
) -> bool:
    """Write a lower triangular L with L L' near G + shift, where G has entries; or return False at a lost pivot."""
    n = len(starts) - 1
    full, count = np.zeros((n, n)), 0
    rows[0] = 0
    for i in range(n):
        for k in range(starts[i], starts[i + 1]):
            j = columns[k]
            if j < i:
                full[i, j] = (G[k] - full[i, :j] @ full[j, :j]) / full[j, j]
                places[count], L[count] = j, full[i, j]
                count += 1
        pivot = 1.0 + shift - full[i, :i] @ full[i, :i]
        if not pivot > _LEAST:
            return False
        full[i, i] = np.sqrt(pivot)
        places[count], L[count] = i, full[i, i]
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

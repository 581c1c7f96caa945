"""Kernel that factors a dense Delassus matrix, singular where rows depend on each other."""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ..metric import Array

# a pivot below this belongs to a row that depends on the others
_DEPENDENT = 1e-13


@kernel("i8(f8[:,::1], f8[:,::1])")
def pivoted_cholesky(G: Array, C: Array) -> int:
    """Write C with G = C C', and as many columns that are not zero as G's rank, which is returned.

    Parameters
    ----------
    G, C : ndarray, shape (m, m)
        A positive semidefinite matrix with unit diagonal; receives the factor.
    """
    m = len(G)
    rest, order = np.empty(m), np.empty(m, np.int64)
    for a in range(m):
        rest[a], order[a] = G[a, a], a
        for k in range(m):
            C[a, k] = 0.0
    for k in range(m):
        best = k
        for i in range(k + 1, m):
            if rest[order[i]] > rest[order[best]]:
                best = i
        order[k], order[best] = order[best], order[k]
        a = order[k]
        if not rest[a] > _DEPENDENT:
            return k
        C[a, k] = np.sqrt(rest[a])
        for i in range(k + 1, m):
            b = order[i]
            g = G[b, a]
            for j in range(k):
                g -= C[b, j] * C[a, j]
            C[b, k] = g / C[a, k]
            rest[b] -= C[b, k] * C[b, k]
    return m

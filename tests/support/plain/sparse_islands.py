"""Plain numpy forms of the kernels in mbvi/projection/sparse/sparse_islands.py."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from mbvi.arguments import Array
from mbvi.projection.sparse.sparse_islands import _ROUNDING, _SMALL
from support.plain.goldfarb_idnani import goldfarb_idnani_plain
from support.plain.refinement import solve_island_plain


def solve_islands_plain(
    starts: Array, columns: Array, G: Array, d: Array, label: Array, count: int, target: float, u: Array
) -> float:
    """Solve min u' G u / 2 - d' u over u >= 0 island by island; return the largest natural residual."""
    A, worst = csr_array((G, columns, starts), shape=(len(d), len(d))), 0.0
    u[label < 0] = 0.0
    for island in range(count):
        here = np.flatnonzero(label == island)
        inner = csr_array(A[here][:, here])
        inner.sort_indices()
        part = u[here]
        if len(here) <= _SMALL:
            n, own = len(here), d[here]
            values, vectors = np.linalg.eigh(inner.toarray())
            W = vectors * np.sqrt(np.maximum(values, 0.0))
            S, z, slack, solution = np.zeros(n + 1, int), np.zeros(n), np.zeros(n), np.zeros(n + 1)
            factors = np.zeros((n + 1, n + 1)), np.zeros((n + 1, n))
            size, _ = goldfarb_idnani_plain(W, own, _ROUNDING * own.max(), 0, S, *factors, solution, z, slack)
            if size >= 0:
                part[:] = 0.0
                part[S[:size]] = solution[:size]
        residual = float(np.abs(np.minimum(part, inner @ part - d[here])).max())
        if residual > target:
            residual = solve_island_plain(
                inner.indptr.astype(np.uint32), inner.indices.astype(np.uint32), inner.data, d[here], target, part
            )
        u[here], worst = part, max(worst, residual)
    return worst

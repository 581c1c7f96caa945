"""Plain numpy forms of the kernels in mbvi/projection/sparse/refinement.py."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from mbvi.arguments import Array
from mbvi.projection.sparse.refinement import _LEFT, _MOST_ROUNDS, _MOST_ROWS, _OFF, _ROUNDS
from support.plain.projected_pcg import projected_pcg_plain


def refine_subset_plain(starts: Array, columns: Array, G: Array, target: float, g: Array, u: Array) -> bool:
    """Settle the rows that are off, and those by them, while the others stay; return False where they are too many."""
    A = csr_array((G, columns, starts), shape=(len(u), len(u)))
    off = np.abs(np.minimum(u, g)) > _OFF * target
    here = np.unique(A[np.flatnonzero(off)].indices)
    if not 0 < len(here) <= _MOST_ROWS:
        return False
    part, inner = u[here], csr_array(A[here][:, here])
    inner.sort_indices()
    projected_pcg_plain(
        inner.indptr.astype(np.uint32), inner.indices.astype(np.uint32), inner.data, inner @ part - g[here],
        _LEFT * target, 0.0, _MOST_ROUNDS, np.zeros(6), np.empty(len(here)), part,
    )  # fmt: skip
    u[here] = part
    return True


def solve_island_plain(starts: Array, columns: Array, G: Array, d: Array, target: float, u: Array) -> float:
    """Bring the natural residual max |min(u, G u - d)| below a target, from where u is; return what was reached."""
    return projected_pcg_plain(starts, columns, G, d, target, 0.0, _ROUNDS, np.zeros(6), np.empty(len(d)), u)

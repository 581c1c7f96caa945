"""Plain numpy forms of the kernels in mbvi/projection/sparse/gram.py."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from mbvi.arguments import Array


def gram_plain(
    data: Array, columns: Array, starts: Array, n: int, out_starts: Array, out_columns: Array, out: Array
) -> int:
    """Write U U' of sparse rows U, row after row with columns ascending; return how many entries it has."""
    U = csr_array((data, columns, starts), shape=(len(starts) - 1, n))
    # by what is stored, zeros among it
    full, stored = (U @ U.T).toarray(), abs(U).sign()
    stored.data[:] = 1.0
    where = np.nonzero((stored @ stored.T).toarray())
    count = len(where[0])
    if count <= len(out):
        out_starts[:] = np.searchsorted(where[0], np.arange(len(out_starts)))
        out_columns[:count], out[:count] = where[1], full[where]
    return count


def islands_plain(columns: Array, starts: Array, n: int, kept: Array, label: Array) -> int:
    """Write which island each row is in, of rows that share columns, numbered by first rows; return how many."""
    there = csr_array((np.ones(len(columns)), columns, starts), shape=(len(kept), n))[kept]
    found = connected_components(there @ there.T, directed=False)[1]
    _, first, inverse = np.unique(found, return_index=True, return_inverse=True)
    rank = np.empty(len(first), np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    label[:] = -1
    label[kept] = rank[inverse]
    return len(first)

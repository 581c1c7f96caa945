"""Kernel that solves the sparse dual island by island, started from the percussions of the last projection.

Rows are scaled to unit length in the metric. A small island is solved to rounding by the dual
active-set method. A large one whose percussions of the last step still fit is left alone; others are solved by
`solve_island` to the target residual.
"""

from __future__ import annotations

import numpy as np

from ..compiled import kernel
from .metric import Array
from .nonnegative import dual_active_set, solve_equalities
from .refinement import solve_island

# rows up to which an island is solved to rounding
_SMALL = 48


@kernel("f8(u4[::1], u4[::1], f8[::1], f8[::1], i8[::1], i8, f8, f8, f8[::1])")
def _solve_islands(
    starts: Array, columns: Array, G: Array, d: Array, label: Array, count: int, target: float, carried: float, u: Array
) -> float:
    """Solve min u' G u / 2 - d' u over u >= 0 island by island; return the largest natural residual.

    Parameters
    ----------
    starts, columns, G : ndarray, shapes (m + 1,), (k,), (k,)
        Scaled Delassus matrix, row after row, columns ascending.
    d, u : ndarray, shape (m,)
        Missing rates; percussions to start from, which are written over.
    label : ndarray of int, shape (m,)
        The island of each row; -1 of one that is left out, and gets none.
    count : int
        How many islands there are.
    target : float
        The residual that is enough.
    carried : float
        The part of u that a large island is started from where all of it does not fit.
    """
    m, worst = len(d), 0.0
    # rows sorted by island
    first, order, local = np.zeros(count + 1, np.int64), np.empty(m, np.int64), np.empty(m, np.uint32)
    for a in range(m):
        if label[a] >= 0:
            first[label[a] + 1] += 1
        else:
            u[a] = 0.0
    for island in range(count):
        first[island + 1] += first[island]
    fill = first[:count].copy()
    for a in range(m):
        if label[a] >= 0:
            local[a] = fill[label[a]] - first[label[a]]
            order[fill[label[a]]] = a
            fill[label[a]] += 1
    chosen, nothing, full_d, part = np.empty(_SMALL, np.bool_), np.zeros(_SMALL), np.empty(_SMALL), np.empty(_SMALL)
    for island in range(count):
        size, begin = first[island + 1] - first[island], first[island]
        residual, entries = 0.0, 0
        for i in range(size):
            a = order[begin + i]
            value = -d[a]
            for k in range(starts[a], starts[a + 1]):
                if label[columns[k]] >= 0:
                    value += G[k] * u[columns[k]]
                    entries += 1
            residual = max(residual, abs(min(u[a], value)))
        if size <= _SMALL:
            full = np.zeros((size, size))
            for i in range(size):
                a = order[begin + i]
                full_d[i] = d[a]
                for k in range(starts[a], starts[a + 1]):
                    if label[columns[k]] >= 0:
                        full[i, local[columns[k]]] = G[k]
            if dual_active_set(full, full_d[:size], chosen[:size]) and solve_equalities(
                full, full_d[:size], chosen[:size], nothing[:size], part[:size]
            ):
                residual = 0.0
                for i in range(size):
                    part[i] = max(part[i], 0.0)
                for i in range(size):
                    value = -full_d[i]
                    for j in range(size):
                        value += full[i, j] * part[j]
                    residual = max(residual, abs(min(part[i], value)))
                    u[order[begin + i]] = part[i]
        if residual > target:
            own_starts, own_columns = np.empty(size + 1, np.uint32), np.empty(entries, np.uint32)
            own, own_d, own_u, entry = np.empty(entries), np.empty(size), np.empty(size), 0
            own_starts[0] = 0
            for i in range(size):
                a = order[begin + i]
                own_d[i], own_u[i] = d[a], carried * u[a]
                for k in range(starts[a], starts[a + 1]):
                    if label[columns[k]] >= 0:
                        own_columns[entry], own[entry] = local[columns[k]], G[k]
                        entry += 1
                own_starts[i + 1] = entry
            residual = solve_island(own_starts, own_columns, own, own_d, target, own_u)
            for i in range(size):
                u[order[begin + i]] = own_u[i]
        worst = max(worst, residual)
    return worst

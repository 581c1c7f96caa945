"""Kernel that solves the sparse dual island by island by its Delassus matrix.

Rows are scaled to unit length in the metric. A small island is solved to rounding by the dual active-set method. A
large one whose percussions already fit is left alone; others are solved by `solve_island` to the target residual.
"""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ..dense.goldfarb_idnani import goldfarb_idnani
from ..dense.pivoted_cholesky import pivoted_cholesky
from ..metric import Array
from .projected_pcg import dual_residual
from .refinement import solve_island

# share of the largest violation that is rounding
_ROUNDING = 1e-13
# rows up to which an island is solved to rounding
_SMALL = 48


@kernel("void(i8[::1], i8[::1], i8[::1], u4[::1])")
def sort_by_island(label: Array, first: Array, order: Array, local: Array) -> None:
    """Write the rows sorted by island, where each island begins among them, and the place of each row in its island.

    Parameters
    ----------
    label : ndarray of int, shape (m,)
        The island of each row; -1 of one that is left out.
    first, order, local : ndarray of int, shapes (count + 1,), (m,), (m,)
        Receive beginnings, rows and places; places of rows that are left out mean nothing.
    """
    first[:] = 0
    for a in range(len(label)):
        if label[a] >= 0:
            first[label[a] + 1] += 1
    for island in range(len(first) - 1):
        first[island + 1] += first[island]
    fill = first[:-1].copy()
    for a in range(len(label)):
        if label[a] >= 0:
            local[a] = fill[label[a]] - first[label[a]]
            order[fill[label[a]]] = a
            fill[label[a]] += 1


@kernel("i8(u4[::1], u4[::1], f8[::1], i8[::1], i8[::1], u4[::1], u4[::1], u4[::1], f8[::1])")
def extract_island(
    starts: Array, columns: Array, G: Array, label: Array, rows: Array, local: Array,
    own_starts: Array, own_columns: Array, own_G: Array,
) -> int:  # fmt: skip
    """Write the part of G on the rows of one island, row after row; return how many entries it has.

    Parameters
    ----------
    starts, columns, G, label, local
        See `_solve_islands` and `sort_by_island`.
    rows : ndarray of int, shape (n,)
        Rows of the island.
    own_starts, own_columns, own_G : ndarray, shapes (n + 1,), (k,), (k,)
        Receive starts, columns and values.
    """
    count = 0
    own_starts[0] = 0
    for i in range(len(rows)):
        for k in range(starts[rows[i]], starts[rows[i] + 1]):
            if label[columns[k]] >= 0:
                own_columns[count], own_G[count] = local[columns[k]], G[k]
                count += 1
        own_starts[i + 1] = count
    return count


@kernel("f8(u4[::1], u4[::1], f8[::1], f8[::1], f8[::1])")
def solve_small_island(starts: Array, columns: Array, G: Array, d: Array, u: Array) -> float:
    """Solve an island to rounding by the dual active-set method; return its natural residual, inf if it is not solved.

    Parameters
    ----------
    starts, columns, G : ndarray, shapes (n + 1,), (k,), (k,)
        Matrix of the island.
    d, u : ndarray, shape (n,)
        Violations; receives percussions, unless the island is not solved.
    """
    n = len(d)
    full, W, part, slack = np.empty((n, n)), np.empty((n, n)), np.empty(n + 1), np.empty(n)
    S, L, Q, z, largest = np.empty(n + 1, np.int64), np.empty((n + 1, n + 1)), np.empty((n + 1, n)), np.empty(n), 0.0
    for i in range(n):
        largest = max(largest, d[i])
        for k in range(n):
            full[i, k] = 0.0
        for k in range(starts[i], starts[i + 1]):
            full[i, columns[k]] = G[k]
    pivoted_cholesky(full, W)
    size, _ = goldfarb_idnani(W, d, _ROUNDING * largest, 0, S, L, Q, part, z, slack)
    if size < 0:
        return np.inf
    for i in range(n):
        u[i] = 0.0
    for i in range(size):
        u[S[i]] = part[i]
    residual = 0.0
    for i in range(n):
        value = -d[i]
        for j in range(n):
            value += full[i, j] * u[j]
        residual = max(residual, abs(min(u[i], value)))
    return residual


@kernel("f8(u4[::1], u4[::1], f8[::1], f8[::1], f8, f8, f8[::1])")
def scale_percussions(
    starts: Array, columns: Array, G: Array, d: Array, target: float, residual: float, u: Array
) -> float:
    """Scale u so that u' (G u - d) = 0 where the target residual is kept; return the residual. See `scaled_residual`.

    Parameters
    ----------
    starts, columns, G, d, target, u
        See `_solve_islands`.
    residual : float
        The natural residual of u.
    """
    g, scaled, off, size = np.empty(len(u)), np.empty(len(u)), 0.0, 0.0
    dual_residual(starts, columns, G, d, g, u)
    for a in range(len(u)):
        off += u[a] * g[a]
        size += u[a] * (g[a] + d[a])
    if not abs(off) < size:
        return residual
    for a in range(len(u)):
        scaled[a] = (1.0 - off / size) * u[a]
    after = dual_residual(starts, columns, G, d, g, scaled)
    if after <= target:
        for a in range(len(u)):
            u[a] = scaled[a]
        return after
    return residual


@kernel("f8(u4[::1], u4[::1], f8[::1], f8[::1], i8[::1], i8, f8, f8[::1])")
def _solve_islands(
    starts: Array, columns: Array, G: Array, d: Array, label: Array, count: int, target: float, u: Array
) -> float:
    """Solve min u' G u / 2 - d' u over u >= 0 island by island; return the largest natural residual.

    Parameters
    ----------
    starts, columns, G : ndarray, shapes (m + 1,), (k,), (k,)
        Scaled Delassus matrix, row after row, columns ascending.
    d, u : ndarray, shape (m,)
        Violations; percussions to start from, which are written over.
    label : ndarray of int, shape (m,)
        The island of each row; -1 of one that is left out, and gets none.
    count : int
        How many islands there are.
    target : float
        The residual that is small enough.
    """
    m, worst = len(d), 0.0
    first, order, local = np.empty(count + 1, np.int64), np.empty(m, np.int64), np.empty(m, np.uint32)
    sort_by_island(label, first, order, local)
    own_starts, own_columns, own_G = np.empty(m + 1, np.uint32), np.empty(len(G), np.uint32), np.empty(len(G))
    for a in range(m):
        if label[a] < 0:
            u[a] = 0.0
    for island in range(count):
        rows = order[first[island] : first[island + 1]]
        n = len(rows)
        entries = extract_island(starts, columns, G, label, rows, local, own_starts, own_columns, own_G)
        matrix = own_starts[: n + 1], own_columns[:entries], own_G[:entries]
        own_d, own_u, own_g = d[rows], u[rows], np.empty(n)
        residual = dual_residual(matrix[0], matrix[1], matrix[2], own_d, own_g, own_u)
        if n <= _SMALL:
            solved = solve_small_island(matrix[0], matrix[1], matrix[2], own_d, own_u)
            residual = solved if solved < np.inf else residual
        if residual > target:
            residual = solve_island(matrix[0], matrix[1], matrix[2], own_d, target, own_u)
            residual = scale_percussions(matrix[0], matrix[1], matrix[2], own_d, target, residual, own_u)
        for i in range(n):
            u[rows[i]] = own_u[i]
        worst = max(worst, residual)
    return worst

"""Kernels that solve some rows of the sparse dual: sweeps for large islands, the Delassus matrix for what is left."""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ..metric import Array
from .accelerated_sweeps import sweep_islands
from .gram import gram, islands
from .sparse_islands import _solve_islands

# two unit rows with a product above this are equal
_SAME = 1.0 - 1e-13
# room for entries of the Delassus matrix at first, for each row
_ROOM = 128


@kernel("void(u4[::1], u4[::1], f8[::1], f8[::1], b1[::1], f8[::1])")
def merge_repeated(starts: Array, columns: Array, G: Array, d: Array, kept: Array, u: Array) -> None:
    """Find the rows that equal no other row with a d as large or larger, which gets their u.

    Parameters
    ----------
    starts, columns, G : ndarray, shapes (m + 1,), (k,), (k,)
        Delassus matrix of rows of unit length.
    d, u : ndarray, shape (m,)
        Violations and percussions, of which those of repeated rows become zero.
    kept : ndarray of bool, shape (m,)
        Receives which rows are not repeated.
    """
    m = len(d)
    for a in range(m):
        kept[a] = True
        for k in range(starts[a], starts[a + 1]):
            b = columns[k]
            if b != a and G[k] >= _SAME:
                kept[a] = kept[a] and not (d[b] > d[a] or (d[b] == d[a] and b < a))
    for a in range(m):
        for k in range(starts[a], starts[a + 1] if not kept[a] else starts[a]):
            b = columns[k]
            if b != a and G[k] >= _SAME and kept[b]:
                u[b] += u[a]
    for a in range(m):
        u[a] = u[a] if kept[a] else 0.0


@kernel("void(f8[::1], u4[::1], u4[::1], i8, f8[::1], f8, i8[::1], f8[::1])")
def solve_left(
    data: Array, columns: Array, starts: Array, n: int, d: Array, target: float, label: Array, u: Array
) -> None:
    """Solve rows by their Delassus matrix, island by island.

    Parameters
    ----------
    data, columns, starts, n, d, target
        See `solve_working_set`.
    label : ndarray of int, shape (m,)
        Receives the island of each row, -1 of one that repeats another.
    u : ndarray, shape (m,)
        The start, which receives percussions.
    """
    m = len(d)
    rows, others, G = np.empty(m + 1, np.uint32), np.empty(min(m, _ROOM) * m, np.uint32), np.empty(min(m, _ROOM) * m)
    count = gram(data, columns, starts, n, rows, others, G)
    if count > len(G):
        others, G = np.empty(count, np.uint32), np.empty(count)
        gram(data, columns, starts, n, rows, others, G)
    others, G, kept = others[:count], G[:count], np.empty(m, np.bool_)
    merge_repeated(rows, others, G, d, kept, u)
    found = islands(columns, starts, n, kept, label)
    _solve_islands(rows, others, G, d, label, found, target, u)


@kernel("void(f8[::1], u4[::1], u4[::1], i8, f8[::1], b1[::1], f8, i8[::1], f8[::1])")
def solve_working_set(
    data: Array, columns: Array, starts: Array, n: int, d: Array, working: Array, target: float, label: Array, u: Array
) -> None:
    """Solve min u' G u / 2 - d' u over u >= 0 for some rows, while the others have none.

    Parameters
    ----------
    data, columns, starts : ndarray, shapes (k,), (k,), (m + 1,)
        All rows, scaled to unit length.
    n : int
        Columns in all.
    d : ndarray, shape (m,)
        Violations.
    working : ndarray of bool, shape (m,)
        The rows to solve.
    target : float
        The residual that is small enough.
    label : ndarray of int, shape (m,)
        Receives the island of each row, -1 of rows that are not solved or repeat another.
    u : ndarray, shape (m,)
        Percussions to start from, which are written over.
    """
    m, count = len(d), islands(columns, starts, n, working, label)
    reached, here, size, entries = np.empty(count, np.bool_), np.empty(m, np.int64), 0, 0
    sweep_islands(data, columns, starts, n, d, label, target, reached, u)
    for a in range(m):
        if label[a] < 0:
            u[a] = 0.0
        elif not reached[label[a]]:
            here[size], size, entries = a, size + 1, entries + starts[a + 1] - starts[a]
    if size == 0:
        return
    own_data, own_columns, own_starts = np.empty(entries), np.empty(entries, np.uint32), np.empty(size + 1, np.uint32)
    own_d, own_u, own_label, place = np.empty(size), np.empty(size), np.empty(size, np.int64), 0
    own_starts[0] = 0
    for i in range(size):
        a = here[i]
        own_d[i], own_u[i] = d[a], u[a]
        for k in range(starts[a], starts[a + 1]):
            own_data[place], own_columns[place] = data[k], columns[k]
            place += 1
        own_starts[i + 1] = place
    solve_left(own_data, own_columns, own_starts, n, own_d, target, own_label, own_u)
    for i in range(size):
        u[here[i]], label[here[i]] = own_u[i], -1 if own_label[i] < 0 else count + own_label[i]

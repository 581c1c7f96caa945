"""The Delassus matrix of sparse rows, and the islands of rows that see each other."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from ..compiled import kernel
from .metric import Array


def gram_plain(
    data: Array, columns: Array, starts: Array, n: int, out_starts: Array, out_columns: Array, out: Array
) -> int:
    """Write U U' of sparse rows U, row after row with columns ascending; return how many entries it has.

    Parameters
    ----------
    data, columns, starts : ndarray, shapes (k,), (k,), (m + 1,)
        U, shape (m, n), row after row.
    n : int
        Columns of U.
    out_starts, out_columns, out : ndarray, shapes (m + 1,), (c,), (c,)
        Receive U U', unless it has more than c entries.
    """
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


@kernel("i8(f8[::1], i4[::1], i4[::1], i8, i4[::1], i4[::1], f8[::1])", plain=gram_plain)
def gram(
    data: Array, columns: Array, starts: Array, n: int, out_starts: Array, out_columns: Array, out: Array
) -> int:
    """Loops of `gram_plain`."""
    m, room = len(starts) - 1, len(out)
    # U column after column
    first = np.zeros(n + 1, np.int32)
    for k in range(len(columns)):
        first[columns[k] + 1] += 1
    for j in range(n):
        first[j + 1] += first[j]
    fill, row, value = first[:n].copy(), np.empty(len(columns), np.int32), np.empty(len(columns))
    for a in range(m):
        for k in range(starts[a], starts[a + 1]):
            place = fill[columns[k]]
            row[place], value[place] = a, data[k]
            fill[columns[k]] += 1
    place_of, count = np.full(m, -1, np.int32), 0
    out_starts[0] = 0
    for a in range(m):
        begin = count
        for k in range(starts[a], starts[a + 1]):
            j, u = columns[k], data[k]
            for c in range(first[j], first[j + 1]):
                b = row[c]
                place = place_of[b]
                if place >= begin:
                    if place < room:
                        out[place] += u * value[c]
                else:
                    place_of[b] = count
                    if count < room:
                        out_columns[count], out[count] = b, u * value[c]
                    count += 1
        if count <= room:
            for k in range(begin + 1, count):
                b, g, place = out_columns[k], out[k], k
                while place > begin and out_columns[place - 1] > b:
                    out_columns[place], out[place] = out_columns[place - 1], out[place - 1]
                    place -= 1
                out_columns[place], out[place] = b, g
        out_starts[a + 1] = count
    return count


def islands_plain(starts: Array, columns: Array, kept: Array, label: Array) -> int:
    """Number the islands of a symmetric sparse matrix in the order of their first rows; return how many there are.

    Parameters
    ----------
    starts, columns : ndarray, shapes (m + 1,), (k,)
        Where it has entries.
    kept : ndarray of bool, shape (m,)
        The rows to look at.
    label : ndarray of int, shape (m,)
        Receives the island of each row, -1 where it is not kept.
    """
    m = len(kept)
    graph = csr_array((np.ones(len(columns)), columns, starts), shape=(m, m)).tocoo()
    both = kept[graph.coords[0]] & kept[graph.coords[1]]
    inner = csr_array((graph.data[both], (graph.coords[0][both], graph.coords[1][both])), shape=(m, m))
    found = connected_components(inner, directed=False)[1][kept]
    label[:] = -1
    label[kept] = np.unique(found, return_inverse=True)[1] if not len(found) else _in_order(found)
    return int(label.max(initial=-1)) + 1


def _in_order(labels: Array) -> Array:
    """Return labels renumbered by their first appearance."""
    _, first, inverse = np.unique(labels, return_index=True, return_inverse=True)
    rank = np.empty(len(first), np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    return rank[inverse]


@kernel("i8(i4[::1], i4[::1], b1[::1], i8[::1])", plain=islands_plain)
def islands(starts: Array, columns: Array, kept: Array, label: Array) -> int:
    """Loops of `islands_plain`."""
    m, count = len(kept), 0
    stack = np.empty(m, np.int64)
    for a in range(m):
        label[a] = -1
    for a in range(m):
        if label[a] >= 0 or not kept[a]:
            continue
        label[a], stack[0], size = count, a, 1
        while size:
            size -= 1
            b = stack[size]
            for k in range(starts[b], starts[b + 1]):
                c = columns[k]
                if kept[c] and label[c] < 0:
                    label[c] = count
                    stack[size] = c
                    size += 1
        count += 1
    return count

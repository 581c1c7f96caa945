"""The Delassus matrix of sparse rows, and the islands of rows that see each other."""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ..metric import Array


@kernel("void(f8[::1], u4[::1], u4[::1], i8[::1], u4[::1], f8[::1], b1[::1])")
def sort_by_column(
    data: Array, columns: Array, starts: Array, first: Array, row: Array, value: Array, same: Array
) -> None:
    """Write sparse rows column after column.

    Parameters
    ----------
    data, columns, starts
        See `gram`.
    first, row, value : ndarray, shapes (n + 1,), (k,), (k,)
        Receive where each column begins, and the rows and values of its entries.
    same : ndarray of bool, shape (n + 1,)
        Receives which columns have the rows of the one before: those of one body.
    """
    n = len(first) - 1
    for j in range(n + 1):
        first[j], same[j] = 0, False
    for k in range(len(columns)):
        first[columns[k] + 1] += 1
    for j in range(n):
        first[j + 1] += first[j]
    fill = first.copy()
    for a in range(len(starts) - 1):
        for k in range(starts[a], starts[a + 1]):
            place = fill[columns[k]]
            row[place], value[place] = a, data[k]
            fill[columns[k]] += 1
    for j in range(1, n):
        size = first[j + 1] - first[j]
        alike = size > 0 and first[j] - first[j - 1] == size
        for c in range(size if alike else 0):
            alike = alike and row[first[j] + c] == row[first[j - 1] + c]
        same[j] = alike


@kernel("i8(f8[::1], u4[::1], u4[::1], i8, u4[::1], u4[::1], f8[::1])")
def gram(data: Array, columns: Array, starts: Array, n: int, out_starts: Array, out_columns: Array, out: Array) -> int:
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
    m, room = len(starts) - 1, len(out)
    first, same = np.empty(n + 1, np.int64), np.empty(n + 1, np.bool_)
    row, value = np.empty(len(columns), np.uint32), np.empty(len(columns))
    sort_by_column(data, columns, starts, first, row, value, same)
    place_of, count = np.full(m, -1, np.int32), 0
    out_starts[0] = 0
    for a in range(m):
        begin, k = count, starts[a]
        while k < starts[a + 1]:
            j, width = columns[k], 1
            while k + width < starts[a + 1] and columns[k + width] == j + width and same[j + width]:
                width += 1
            size = first[j + 1] - first[j]
            for c in range(first[j], first[j + 1]):
                product = 0.0
                for t in range(width):
                    product += data[k + t] * value[c + t * size]
                b = row[c]
                place = place_of[b]
                if place >= begin:
                    if place < room:
                        out[place] += product
                else:
                    place_of[b] = count
                    if count < room:
                        out_columns[count], out[count] = b, product
                    count += 1
            k += width
        if count <= room:
            for k in range(begin + 1, count):
                b, g, place = out_columns[k], out[k], k
                while place > begin and out_columns[place - 1] > b:
                    out_columns[place], out[place] = out_columns[place - 1], out[place - 1]
                    place -= 1
                out_columns[place], out[place] = b, g
        out_starts[a + 1] = count
    return count


@kernel("i8(u4[::1], u4[::1], i8, b1[::1], i8[::1])")
def islands(columns: Array, starts: Array, n: int, kept: Array, label: Array) -> int:
    """Write which island each row is in, of rows that share columns, numbered by first rows; return how many.

    Parameters
    ----------
    columns, starts : ndarray, shapes (k,), (m + 1,)
        Where the rows have entries.
    n : int
        Columns in all.
    kept : ndarray of bool, shape (m,)
        The rows to look at; they have entries.
    label : ndarray of int, shape (m,)
        Receives the island of each row, -1 where it is not kept.
    """
    parent, number = np.arange(n), np.full(n, -1)
    for a in range(len(kept)):
        if not kept[a]:
            continue
        root = columns[starts[a]]
        while parent[root] != root:
            parent[root] = parent[parent[root]]
            root = parent[root]
        for k in range(starts[a] + 1, starts[a + 1]):
            other = columns[k]
            while parent[other] != other:
                parent[other] = parent[parent[other]]
                other = parent[other]
            if other < root:
                root, other = other, root
            parent[other] = root
    count = 0
    for a in range(len(kept)):
        label[a] = -1
        if kept[a]:
            root = columns[starts[a]]
            while parent[root] != root:
                root = parent[root]
            if number[root] < 0:
                number[root] = count
                count += 1
            label[a] = number[root]
    return count

"""Blocks of columns of sparse rows: cut out and put side by side without scipy's general conversions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.sparse import csr_array

Array = np.ndarray


def cut(rows: csr_array, columns: slice) -> csr_array:
    """Return the entries of sparse rows in some columns, counted from the first of these."""
    here = (rows.indices >= columns.start) & (rows.indices < columns.stop)
    sums = np.concatenate([[0], np.cumsum(here)])
    starts = sums[rows.indptr].astype(np.int32)
    own = rows.indices[here] - np.int32(columns.start)
    return csr_array((rows.data[here], own, starts), shape=(rows.shape[0], columns.stop - columns.start))


def touched_columns(rows: csr_array) -> tuple[Array, Array]:
    """Return the columns in which sparse rows have entries, ascending, and the rows there as a full array."""
    part = np.unique(rows.indices)
    full = np.zeros((rows.shape[0], len(part)))
    full[np.arange(len(full)).repeat(rows.indptr[1:] - rows.indptr[:-1]), part.searchsorted(rows.indices)] = rows.data
    return part, full


def compose(
    parts: Sequence[tuple[Array, int, Array | csr_array]], shape: tuple[int, int]
) -> tuple[Array, Array, Array]:
    """Return values, columns and starts of sparse rows composed of blocks that follow each other in their columns.

    Parameters
    ----------
    parts : sequence of (ndarray, int, ndarray or csr_array)
        Of each block the indices of its rows among all rows, its first column, and its entries; zeros of a full array
        are left out.
    shape : (int, int)
        Number of rows and columns.
    """
    starts, pieces = np.zeros(shape[0] + 1, np.int64), []
    for here, first, part in parts:
        if isinstance(part, np.ndarray):
            there = part != 0.0
            counts, columns, values = there.sum(axis=1), np.nonzero(there)[1], part[there]
        else:
            counts, columns, values = np.diff(part.indptr), part.indices, part.data
        starts[here + 1] += counts
        pieces.append((here, first, counts, columns, values))
    starts = np.cumsum(starts)
    data, indices, place = np.empty(starts[-1]), np.empty(starts[-1], np.int32), starts[:-1].copy()
    for here, first, counts, columns, values in pieces:
        # the place of a block's row among all entries, less its place within the block
        offset = place[here] - (np.cumsum(counts) - counts)
        target = np.repeat(offset, counts) + np.arange(len(values))
        data[target], indices[target] = values, columns + first
        place[here] += counts
    return data, indices, starts.astype(np.int32)

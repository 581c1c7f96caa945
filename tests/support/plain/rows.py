"""Plain numpy forms of the kernels in mbvi/constraints/rows.py."""

from __future__ import annotations

import numpy as np

from mbvi.arguments import Array


def mutual_nearest_plain(number: Array, point: Array, others: Array, places: Array, order: Array, owner: Array) -> None:
    """List all pairs of one number, in order of falling distance, so that the nearest one is written last."""
    owner[:] = -1
    first, end = (np.searchsorted(others[order], number, side) for side in ("left", "right"))
    count = end - first
    row = np.repeat(np.arange(len(count)), count)
    other = order[np.arange(len(row)) + np.repeat(first - np.cumsum(count) + count, count)]
    shift = point[row] - places[other]
    apart = np.nan_to_num((shift**2).sum(axis=1))
    nearest_last = np.argsort(-apart, kind="stable")
    row, other = row[nearest_last], other[nearest_last]
    back = np.full(len(others), -1)
    owner[row], back[other] = other, row
    matched = np.flatnonzero(owner >= 0)
    owner[matched[back[owner[matched]] != matched]] = -1

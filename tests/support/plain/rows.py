"""Plain numpy forms of the kernels in mbvi/constraints/rows.py."""

from __future__ import annotations

import numpy as np

from mbvi.arguments import Array


def mutual_nearest_plain(number: Array, point: Array, others: Array, places: Array, order: Array, owner: Array) -> None:
    """Mark in a table of all pairs those that are nearest to each other, and let each row take one that is left."""
    owner[:] = -1
    if not len(number) or not len(others):
        return
    ends = point[:, None], places[order][None]
    apart = np.nan_to_num(np.linalg.norm(ends[0] - ends[1], axis=2))
    rounding = 1e-9 * np.nan_to_num((abs(ends[0]) + abs(ends[1])).max(axis=2))
    apart[number[:, None] != others[order]] = np.inf
    least = np.minimum(apart.min(axis=1)[:, None], apart.min(axis=0))
    mutual = (apart <= least + rounding) & (apart < np.inf)
    for i, row in enumerate(mutual):
        if row.any():
            owner[i] = order[row.argmax()]
            mutual[:, row.argmax()] = False

"""Plain numpy forms of the kernels in mbvi/constraints/half_space.py."""

from __future__ import annotations

import numpy as np

from mbvi.arguments import Array
from support.plain.articulated import separation_plain
from support.plain.support_points import stand_plain


def half_space_rows_plain(
    poses: Array, columns: Array, support: Array, owners: Array, numbers: Array, tolerance: float,
    clearance: Array, index: Array, gap: Array, point: Array, rows: Array,
) -> tuple[int, bool, bool]:  # fmt: skip
    """Write gaps, points and gradients of the points within the tolerance, if they are the points of the last call."""
    gaps, points = np.empty(len(owners)), np.empty((len(owners), 3))
    stand_plain(poses, owners, numbers, gaps, points)
    found, pair = np.flatnonzero(gaps <= tolerance), owners[:, 1]
    clearance[pair] = np.inf
    np.minimum.at(clearance, pair, gaps)
    same = np.array_equal(index[1 : 1 + index[0]], found)
    index[0], index[1 : 1 + len(found)] = len(found), found
    if same:
        gap[:], point[:] = gaps[found], points[found]
        world = np.zeros(len(found), np.int64)
        up = numbers[found, 12:15]
        separation_plain(columns, support, world, owners[found, 0], point, up, rows)
    return len(found), bool((clearance[pair] > tolerance).any()), same

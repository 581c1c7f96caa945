"""Plain numpy forms of the kernels in mbvi/constraints/half_space.py."""

from __future__ import annotations

import numpy as np

from mbvi.arguments import Array
from mbvi.constraints.half_space import Points
from mbvi.geometry.hull_graph import outermost
from mbvi.geometry.support_points import spread_below
from support.plain.articulated import separation_plain
from support.plain.support_points import stand_plain


def points_below_plain(
    places: Array, body: int, numbers: Array, begin: int, end: int, first: Array, neighbour: Array,
    start: Array, pair: int, tolerance: float, found: Array, at: int, taken: Array,
) -> tuple[int, float]:  # fmt: skip
    """List the points of one shape whose gap is within a tolerance, ascending."""
    gap, point = np.empty(end - begin), np.empty((end - begin, 3))
    owners = np.tile([body, pair], (end - begin, 1))
    stand_plain(places, owners, numbers[begin:end], gap, point)
    near = begin + np.flatnonzero(gap <= tolerance)
    found[at : at + len(near)] = near
    if first[begin + 1] > first[begin]:
        # of points equally low it is the one that the climb reaches
        x, y, z = -(places[body, :3] @ numbers[begin, 12:15])
        start[pair] = outermost.loops(numbers, begin, end, first, neighbour, x, y, z, start[pair])
    return len(near), float(gap.min())


def half_space_rows_plain(
    poses: Array, columns: Array, support: Array, table: tuple[Array, ...], pairs: Array, tolerance: float,
    clearance: Array, index: Array, owner: Array, gap: Array, point: Array, rows: Array,
) -> tuple[int, bool, bool]:  # fmt: skip
    """Write gaps, points and gradients of the points within the tolerance, if they are the points of the last call."""
    p, count, any_empty = Points(*table), 0, False
    for pair in pairs.tolist():
        body = p.body[pair]
        number, clearance[pair] = points_below_plain(
            poses, body, p.numbers, p.begin[pair], p.begin[pair + 1], p.first, p.neighbour, p.start, pair, tolerance,
            p.found, count, p.taken,
        )  # fmt: skip
        any_empty |= number == 0
        count += spread_below.loops(poses, body, p.numbers, p.size[pair], p.found, count, number)
    if not np.array_equal(p.found[:count], index):
        return count, bool(any_empty), False
    owners = np.array([p.body[owner], owner]).T
    stand_plain(poses, owners, p.numbers[index], gap, point)
    up = np.ascontiguousarray(p.numbers[index, 12:15])
    separation_plain(columns, support, np.zeros(count, np.int64), p.body[owner], point, up, rows)
    return count, bool(any_empty), True

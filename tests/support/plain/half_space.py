"""Plain numpy forms of the kernels in mbvi/constraints/families/half_space.py."""

from __future__ import annotations

import numpy as np

from mbvi.arguments import Array
from mbvi.geometry.narrow.support_points import Points, spread_below
from mbvi.geometry.shapes.hull_graph import outermost
from mbvi.geometry.shapes.shapes import TILTED
from support.plain.articulated import separation_plain
from support.plain.support_points import stand_plain


def points_below_plain(places: Array, points: Points, pair: int, tolerance: float, at: int) -> tuple[int, float]:
    """List the points of the shape of a pair whose gap is within a tolerance, ascending."""
    begin, end = points.begin[pair], points.begin[pair + 1]
    body, numbers = points.body[pair], points.numbers[begin:end]
    gap, point = np.empty(end - begin), np.empty((end - begin, 3))
    stand_plain(places, np.tile([body, pair], (end - begin, 1)), numbers, gap, point)
    wanted, rim = gap <= tolerance, numbers[-1, 3:12].reshape(3, 3)
    if rim[0].any() and not rim[2].any():
        # the sine of the tilt of a rim: of a tilted one the fixed points do not count
        tilt = np.linalg.norm(rim @ (places[body, :3] @ numbers[-1, 12:15])) / np.linalg.norm(rim[0])
        wanted &= (tilt <= TILTED) | numbers[:, 3:12].any(axis=1)
    near = begin + np.flatnonzero(wanted)
    points.found[at : at + len(near)] = near
    if points.first[begin + 1] > points.first[begin]:
        # of points equally low it is the one that the climb reaches
        down, graph = -(places[body, :3] @ numbers[0, 12:15]), (points.first, points.neighbour)
        points.start[pair] = outermost.loops(points.numbers, begin, end, *graph, *down, points.start[pair])
    return len(near), float(gap.min())


def half_space_rows_plain(
    poses: Array, columns: Array, support: Array, table: tuple[Array, ...], pairs: Array, tolerance: float,
    clearance: Array, index: Array, owner: Array, gap: Array, point: Array, rows: Array,
) -> tuple[int, bool, bool]:  # fmt: skip
    """Write gaps, points and gradients of the points within the tolerance, if they are the points of the last call."""
    p, count, any_empty = Points(*table), 0, False
    for pair in pairs.tolist():
        number, clearance[pair] = points_below_plain(poses, p, pair, tolerance, count)
        any_empty |= number == 0
        count += spread_below.loops(poses, p, pair, tolerance, count, number)
    if not np.array_equal(p.found[:count], index):
        return count, bool(any_empty), False
    owners = np.array([p.body[owner], owner]).T
    stand_plain(poses, owners, p.numbers[index], gap, point)
    up = np.ascontiguousarray(p.numbers[index, 12:15])
    separation_plain(columns, support, np.zeros(count, np.int64), p.body[owner], point, up, rows)
    return count, bool(any_empty), True

"""Kernels that find where gaps of rows of one mechanism first fall through zero within a step."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ....compiled import kernel, record
from ....constraints.mechanism.held_rows import RowParts, write_gaps_of
from ....constraints.mechanism.pairs import PairShapes, place_bodies
from ....geometry.shapes.shape_table import Shapes  # noqa: F401  (a signature names it)
from ....system.mechanisms.mechanism import place
from ....system.system import Array
from ..rows.known_pairs import write_placed_distances
from ..stages import SmoothMotion, state_at
from .interpolants import Interpolant, interpolation_error, root_on_grid, write_soonest
from .root_finding import KINKED, MOST_STEPS, NOISE, RESOLVED, TOUCHING, ZERO

# in the place of a row where none closes
NONE_CLOSES = -1


@record("i8[::1], b1[::1], f8[::1], f8[::1], f8[:,::1], i8[::1], f8[::1], f8[::1], f8[::1], i8[::1], f8[:,::1]")
class ClosingRows(NamedTuple):
    """Rows that may close, m of them, with room for results; for one thread at a time.

    Attributes
    ----------
    pair : ndarray of int, shape (m,)
        The pair of shapes whose distance a row is, `NO_PAIR` or `UNKNOWN_ROW`.
    smooth, thickness, rounding : ndarray, shape (m,)
        See `SmoothRows`.
    reach, which
        See `write_candidates`.
    bounds, fall, after : ndarray, shape (m,)
        Lower bounds of the gaps at the end of the last step, bounds of by how much gaps fall within this one, and room.
    candidates : ndarray of int, shape (m,)
        The rows that may close within the step, in the first places.
    ends : ndarray, shape (2, m)
        Lower bounds of their gaps at the end of the step, in the first places, and room.
    """

    pair: Array
    smooth: Array
    thickness: Array
    rounding: Array
    reach: Array
    which: Array
    bounds: Array
    fall: Array
    after: Array
    candidates: Array
    ends: Array


@kernel(
    "void(SmoothMotion, RowParts, Tuple(Shapes), PairShapes, ClosingRows, f8[:,:,::1], f8, "
    "Array(f8, 1, 'C', True), Array(f8, 1, 'C', True), f8, i8[::1], f8, f8[::1])"
)
def gaps_at_share(
    s: SmoothMotion, parts: RowParts, tables: tuple[Array, ...], shapes: PairShapes, rows: ClosingRows,
    dense: Array, h: float, q: Array, v: Array, share: float, index: Array, near: float, gap: Array,
) -> None:  # fmt: skip
    """Write gaps of some rows, shape (k,), or lower bounds of those above `near`, at a share of a step of length h."""
    state_at(s, dense, h, share, q, v)
    place(s.mechanism, s.q)
    own, placed, begin = np.empty(len(index), np.int64), False, 0
    while begin < len(index):
        # rows of one kind follow each other
        of_pairs, end = rows.pair[index[begin]] >= 0, begin
        while end < len(index) and (rows.pair[index[end]] >= 0) == of_pairs:
            own[end] = rows.pair[index[end]] if of_pairs else index[end]
            end += 1
        if of_pairs:
            if not placed:
                place_bodies(s.mechanism, shapes)
            placed = True
            write_placed_distances(tables, shapes, own[begin:end], near, gap[begin:end])
        else:
            write_gaps_of(s.mechanism, parts, own[begin:end], s.q, gap[begin:end])
        begin = end


@kernel(
    "f8(SmoothMotion, RowParts, Tuple(Shapes), PairShapes, ClosingRows, f8[:,:,::1], f8,"
    " Array(f8, 1, 'C', True), Array(f8, 1, 'C', True), Interpolant, i8[::1], f8, f8[::1])"
)
def smooth_root(
    s: SmoothMotion, parts: RowParts, tables: tuple[Array, ...], shapes: PairShapes, rows: ClosingRows,
    dense: Array, h: float, q: Array, v: Array, fine: Interpolant, row: Array, margin: float, known: Array,
) -> float:  # fmt: skip
    """Return the first share of a step at which a gap and its margin fall through zero, -1 without one.

    Parameters
    ----------
    s, parts, tables, shapes, rows, dense, h, q, v
        See `gaps_at_share`.
    fine : Interpolant
        The one of many nodes.
    row : ndarray of int, shape (1,)
        The row.
    margin : float
        What is added to its gap.
    known : ndarray, shape (9,)
        Their sum at the nodes.
    """
    # intervals that are left, of which the first is last: both ends, and how often the step was halved for it
    left, count, soonest = np.empty((TOUCHING + 2, 3)), 1, np.empty(1)
    values, polynomial = np.empty((len(known), 1)), np.empty(len(fine.fine_grid))
    left[0, 0], left[0, 1], left[0, 2] = 0.0, 1.0, 0.0
    while count > 0:
        count -= 1
        low, high, halved = left[count, 0], left[count, 1], left[count, 2]
        for i in range(len(known)):
            if halved == 0.0:
                values[i, 0] = known[i]
            else:
                share = low + (high - low) * fine.nodes[i]
                gaps_at_share(s, parts, tables, shapes, rows, dense, h, q, v, share, row, np.inf, values[i])
                values[i, 0] += margin
        if halved > 0.0:
            write_soonest(fine.last, fine.grid, values, soonest)
            if soonest[0] == np.inf:
                continue
        error, size = interpolation_error(fine.last, values, 0), 0.0
        for i in range(len(values)):
            size = max(size, abs(values[i, 0]))
        for i in range(len(polynomial)):
            polynomial[i] = 0.0
            for j in range(len(values)):
                polynomial[i] += fine.fine_grid[i, j] * values[j, 0]
        smooth = error <= max(RESOLVED * size, NOISE)
        share, sure = root_on_grid(polynomial, error)
        if (smooth and sure) or halved >= (TOUCHING if smooth else KINKED):
            if share >= 0.0:
                return low + share * (high - low)
            continue
        middle = 0.5 * (low + high)
        left[count, 0], left[count, 1], left[count, 2] = middle, high, halved + 1.0
        left[count + 1, 0], left[count + 1, 1], left[count + 1, 2] = low, middle, halved + 1.0
        count += 2
    return -1.0


@kernel(
    "f8(SmoothMotion, RowParts, Tuple(Shapes), PairShapes, ClosingRows, f8[:,:,::1], f8,"
    " Array(f8, 1, 'C', True), Array(f8, 1, 'C', True), i8[::1], f8, f8, f8)"
)
def root_by_slope(
    s: SmoothMotion, parts: RowParts, tables: tuple[Array, ...], shapes: PairShapes, rows: ClosingRows,
    dense: Array, h: float, q: Array, v: Array, row: Array, margin: float, end: float, steepest: float,
) -> float:  # fmt: skip
    """Return what `first_root_by_slope` does, of the gap of a row and its margin; see `smooth_root`."""
    x, found, zero, last = 0.0, np.empty(1), ZERO * steepest, np.inf
    gaps_at_share(s, parts, tables, shapes, rows, dense, h, q, v, x, row, np.inf, found)
    found[0] += margin
    for _ in range(MOST_STEPS):
        # a gap that is zero at the start may rise from there
        if found[0] <= zero and x > 0.0 and found[0] <= last:
            break
        x += max(found[0], zero) / steepest
        if x >= end:
            return end
        last = found[0]
        gaps_at_share(s, parts, tables, shapes, rows, dense, h, q, v, x, row, np.inf, found)
        found[0] += margin
    return x


@kernel(
    "Tuple((f8, i8))(SmoothMotion, RowParts, Tuple(Shapes), PairShapes, ClosingRows, f8[:,:,::1], f8,"
    " Array(f8, 1, 'C', True), Array(f8, 1, 'C', True), Interpolant, Interpolant, i8[::1], f8[::1], f8[:,::1])"
)
def first_smooth_root(
    s: SmoothMotion, parts: RowParts, tables: tuple[Array, ...], shapes: PairShapes, rows: ClosingRows,
    dense: Array, h: float, q: Array, v: Array, coarse: Interpolant, fine: Interpolant, index: Array, margin: Array,
    known: Array,
) -> tuple[float, int]:  # fmt: skip
    """Return the earliest share of a step at which one of some gaps and its margin fall through zero, and its place.

    1 and -1 without one. The arguments are those of `smooth_root`, of some rows.

    Parameters
    ----------
    coarse : Interpolant
        The one of few nodes.
    known : ndarray, shape (5, k)
        The sums at these; NaN where they are not known.
    """
    count, rest, values = len(index), np.empty(len(index), np.int64), np.empty(len(index))
    soonest, place_of, unknown = np.empty(count), np.empty(count, np.int64), 0
    for i in range(count):
        if np.isnan(known[0, i]):
            rest[unknown], place_of[unknown] = index[i], i
            unknown += 1
    for k in range(len(known) if unknown else 0):
        share = coarse.nodes[k]
        gaps_at_share(s, parts, tables, shapes, rows, dense, h, q, v, share, rest[:unknown], np.inf, values[:unknown])
        for i in range(unknown):
            known[k, place_of[i]] = values[i] + margin[place_of[i]]
    write_soonest(coarse.last, coarse.grid, known, soonest)
    suspects = 0
    for i in range(count):
        if soonest[i] < np.inf:
            rest[suspects], place_of[suspects] = index[i], i
            suspects += 1
    best, which = 1.0, -1
    if suspects == 0:
        return best, which
    # every other node is a node of the coarser interpolant
    all_known, order = np.empty((len(fine.nodes), suspects)), np.empty(suspects, np.int64)
    for k in range(len(fine.nodes)):
        if k % 2 == 1:
            share = fine.nodes[k]
            gaps_at_share(
                s, parts, tables, shapes, rows, dense, h, q, v, share, rest[:suspects], np.inf, values[:suspects]
            )
        for i in range(suspects):
            all_known[k, i] = values[i] + margin[place_of[i]] if k % 2 == 1 else known[k // 2, place_of[i]]
    write_soonest(fine.last, fine.grid, all_known, soonest[:suspects])
    for i in range(suspects):
        k = i
        while k > 0 and soonest[order[k - 1]] > soonest[i]:
            order[k] = order[k - 1]
            k -= 1
        order[k] = i
    one = np.empty(len(fine.nodes))
    for r in range(suspects):
        i = int(order[r])
        if soonest[i] >= best:
            break
        for k in range(len(one)):
            one[k] = all_known[k, i]
        x = smooth_root(
            s, parts, tables, shapes, rows, dense, h, q, v, fine, rest[i : i + 1], margin[place_of[i]], one
        )  # fmt: skip
        if 0.0 <= x < best:
            best, which = x, int(place_of[i])
    return best, which


@kernel(
    "Tuple((f8, i8))(SmoothMotion, RowParts, Tuple(Shapes), PairShapes, ClosingRows, f8[:,:,::1], f8,"
    " Array(f8, 1, 'C', True), Array(f8, 1, 'C', True), Interpolant, Interpolant, i8[::1], f8[::1])"
)
def earliest_root(
    s: SmoothMotion, parts: RowParts, tables: tuple[Array, ...], shapes: PairShapes, rows: ClosingRows,
    dense: Array, h: float, q: Array, v: Array, coarse: Interpolant, fine: Interpolant, suspects: Array, end: Array,
) -> tuple[float, int]:  # fmt: skip
    """Return the share of a step at which the first of some rows closes, and which; 1 and `NONE_CLOSES` without one.

    Parameters
    ----------
    s, parts, tables, shapes, rows, dense, h, q, v, coarse, fine
        See `first_smooth_root`.
    suspects : ndarray of int, shape (k,)
        Rows that may close within the step.
    end : ndarray, shape (k,)
        Lower bounds of their gaps at its end.
    """
    nodes, m, count = coarse.nodes, len(suspects), 0
    bounds = np.empty((len(nodes), m))
    for k in range(len(nodes)):
        if k < len(nodes) - 1:
            gaps_at_share(s, parts, tables, shapes, rows, dense, h, q, v, nodes[k], suspects, 0.0, bounds[k])
        else:
            for i in range(m):
                bounds[k, i] = end[i]
    by_slope, smooth, slopes = np.empty(m, np.int64), np.empty(m, np.int64), 0
    margin, steep = np.empty(m), np.empty(m)
    known = np.empty((len(nodes), m))
    for i in range(m):
        row, near = suspects[i], False
        fall = rows.fall[row]
        # a gap that reaches zero between two nodes changes by at least the sum of its values at both
        for k in range(len(nodes) - 1):
            near = near or not bounds[k + 1, i] + bounds[k, i] > (nodes[k + 1] - nodes[k]) * fall
        if not near:
            continue
        # the gap of a touching contact is zero to within rounding, or to what the drift of others has left: a row
        # closes where its gap falls below that
        least = rows.rounding[row] + max(-bounds[0, i], 0.0)
        # values at a few nodes may not show that a body passes through another within the step
        if fall > rows.thickness[row] and fall < np.inf:
            by_slope[slopes], steep[slopes] = row, least
            slopes += 1
            continue
        smooth[count], margin[count] = row, least
        for k in range(len(nodes)):
            # lower bounds are values of the gaps only where no separating axis is used, as for smooth rows
            known[k, count] = bounds[k, i] + least if rows.smooth[row] else np.nan
        count += 1
    best, which = 1.0, NONE_CLOSES
    if count > 0:
        some = np.empty((len(nodes), count))
        for k in range(len(nodes)):
            for i in range(count):
                some[k, i] = known[k, i]
        best, first = first_smooth_root(
            s, parts, tables, shapes, rows, dense, h, q, v, coarse, fine, smooth[:count], margin[:count], some
        )  # fmt: skip
        which = smooth[first] if first >= 0 else NONE_CLOSES
    for i in range(slopes):
        row = by_slope[i]
        x = root_by_slope(
            s, parts, tables, shapes, rows, dense, h, q, v, by_slope[i : i + 1], steep[i], best, rows.fall[row]
        )  # fmt: skip
        if x < best:
            best, which = x, row
    return best, which

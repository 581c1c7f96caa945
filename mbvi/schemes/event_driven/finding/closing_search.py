"""Finds the first gap of one mechanism that closes within a step in one kernel; see `ClosingEvents`."""

from __future__ import annotations

import numpy as np

from ....compiled import kernel
from ....constraints.mechanism.held_rows import RowParts
from ....constraints.mechanism.pairs import PairShapes
from ....geometry.shapes.shape_table import Shapes  # noqa: F401  (a signature names it)
from ....system.system import Array
from ..rows.known_pairs import UNKNOWN_ROW
from ..stages import SmoothMotion
from .closing_roots import NONE_CLOSES, ClosingRows, earliest_root, gaps_at_share
from .interpolants import Interpolant

# in the place of the row that closes first: kernels do not know a row that may
NOT_KNOWN = -2


@kernel("i8(f8[:,::1], i8[::1], f8[::1], f8[::1], i8[::1], f8[::1], f8[::1], i8[::1])")
def write_candidates(
    reach: Array, which: Array, travel: Array, bounds: Array, closed: Array, fall: Array, after: Array,
    candidates: Array,
) -> int:  # fmt: skip
    """Write which gaps may reach zero within a step; return how many.

    Parameters
    ----------
    reach : ndarray, shape (r, nv)
        How fast each velocity can change a gap; infinite where that is not known.
    which : ndarray of int, shape (m,)
        Of each row its reach.
    travel : ndarray, shape (nv,)
        Bound of the travel of each coordinate.
    bounds : ndarray, shape (m,)
        Lower bounds of the gaps at the start of the step.
    closed : ndarray of int
        Rows that cannot close.
    fall, after : ndarray, shape (m,)
        Receive bounds of by how much gaps fall, and lower bounds of the gaps after the step.
    candidates : ndarray of int, shape (m,)
        Receives the rows.
    """
    count, each = 0, np.zeros(len(reach))
    for r in range(len(reach)):
        for k in range(len(travel)):
            each[r] += reach[r, k] * travel[k] if reach[r, k] < np.inf else np.inf
    for i in range(len(which)):
        fall[i] = each[which[i]]
        after[i] = bounds[i] - fall[i]
        if not after[i] > 0.0:
            open_row = True
            for c in closed:
                open_row = open_row and c != i
            if open_row:
                candidates[count] = i
                count += 1
    return count


@kernel(
    "Tuple((f8, i8, i8))(SmoothMotion, RowParts, Tuple(Shapes), PairShapes, ClosingRows, f8[:,:,::1], f8,"
    " Array(f8, 1, 'C', True), Array(f8, 1, 'C', True), f8[::1], Interpolant, Interpolant, i8[::1])"
)
def first_closing(
    s: SmoothMotion, parts: RowParts, tables: tuple[Array, ...], shapes: PairShapes, rows: ClosingRows, dense: Array,
    h: float, q: Array, v: Array, travel: Array, coarse: Interpolant, fine: Interpolant, closed: Array,
) -> tuple[float, int, int]:  # fmt: skip
    """Return the share of a step at which the first row closes, which, and how many may; the bounds become new ones.

    1 and `NONE_CLOSES` where none closes; with `NOT_KNOWN` nothing was done.

    Parameters
    ----------
    s, parts, tables, shapes, rows, coarse, fine
        See `earliest_root`.
    dense, h, q, v, travel
        The dense output, the length, the first state and the travel of the step; see `RungeKuttaStep`.
    closed : ndarray of int
        Rows that cannot close.
    """
    bounds, fall, after = rows.bounds, rows.fall, rows.after
    count = write_candidates(rows.reach, rows.which, travel, bounds, closed, fall, after, rows.candidates)
    candidates, end, share, first = rows.candidates[:count], rows.ends[0, :count], 1.0, NONE_CLOSES
    for row in candidates:
        if rows.pair[row] == UNKNOWN_ROW or bounds[row] == -np.inf:
            return share, NOT_KNOWN, count
    if count > 0:
        gaps_at_share(s, parts, tables, shapes, rows, dense, h, q, v, 1.0, candidates, 0.0, end)
        suspects, last, near = np.empty(count, np.int64), rows.ends[1], 0
        for i in range(count):
            row = candidates[i]
            after[row] = end[i]
            # a gap that reaches zero within the step changes by at least the sum of its values at both ends
            if not bounds[row] + end[i] > fall[row]:
                suspects[near], last[near] = row, end[i]
                near += 1
        if near > 0:
            share, first = earliest_root(
                s, parts, tables, shapes, rows, dense, h, q, v, coarse, fine, suspects[:near], last[:near]
            )  # fmt: skip
    for i in range(len(bounds)):
        if share == 1.0:
            bounds[i] = after[i]
        elif share > 0.0:
            # the step will end at the event
            bounds[i] -= share * fall[i]
    return share, first, count

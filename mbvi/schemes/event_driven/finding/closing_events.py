"""Finds the first gap that closes within a step of the smooth motion; the bounds are rigorous, so none is missed."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from ....compiled import held
from ....system import System
from ....system.system import Array
from ..rows.contact_rows import SmoothRows, measured_by
from ..rows.known_pairs import UNKNOWN_ROW, KnownPairs
from ..runge_kutta import RungeKuttaStep
from ..stages import MechanismStages
from .closing_roots import ClosingRows
from .closing_search import NOT_KNOWN, first_closing, write_candidates
from .crossing import crossing_share
from .dips import first_dip
from .interpolants import COARSE, FEW_NODES, FINE
from .root_finding import first_root

_END, _LENGTHS = np.ones(1), np.diff(FEW_NODES)[:, None]
NO_ROWS = np.zeros(0, np.int64)


class ClosingEvents:
    """Keeps a lower bound of the gap of each open row; a row whose bound stays positive within a step is not evaluated.

    Parameters
    ----------
    system : System
        The system that moves.
    rows : SmoothRows
        The rows of its constraints.
    kernels : MechanismStages or None
        What measures many of them at many places, if the system is one mechanism.

    Attributes
    ----------
    depth : ndarray, shape (2,)
        Greatest depths of open contacts and limits at the end of the last step [m, and m or rad].
    """

    def __init__(self, system: System, rows: SmoothRows, kernels: MechanismStages | None) -> None:
        self._system, self._rows, self._kernels = system, rows, kernels
        m = len(rows.all)
        # all points of a shape have the same reach, and follow each other
        first = np.append(True, (rows.reach[1:] != rows.reach[:-1]).any(axis=1))[:m]
        self._reach, self._which = rows.reach[first], np.cumsum(first) - 1
        # a lower bound of each gap at the end of the last step; -inf where it is unknown
        self._bounds = np.full(m, -np.inf)
        self.depth = np.zeros(2)
        # the bounds at the start of a step that may still be shortened, and bounds of by how much gaps fall within it
        self._before: tuple[Array, Array] | None = None
        self._search: Callable[[RungeKuttaStep, Array], tuple[float, int, int]] | None = None
        if kernels is not None and rows.searched is not None:
            columns = rows.searched_pair, rows.smooth[:m], rows.thickness, rows.rounding[:m]
            room = np.empty(m), np.empty(m), np.empty(m, np.int64), np.empty((2, m))
            self._found = ClosingRows(*columns, self._reach, self._which, self._bounds, *room)
            self._kept = held(self._found), held(COARSE), held(FINE)
            self._search = partial(self._by_kernel, kernels, rows.searched)

    def first(self, step: RungeKuttaStep, closed: Array) -> tuple[float, Array]:
        """Return the share of a step at which the first open row closes, and which: 1 and none if none does."""
        self.depth, before = np.zeros(2), self._bounds.copy()
        if self._search is not None:
            share, row, count = self._search(step, closed)
            if row != NOT_KNOWN:
                self._before = before, self._found.fall
                if share == 1.0 and count:
                    candidates = self._found.candidates[:count].copy()
                    self.depth = self._rows.depths(candidates, self._found.ends[0, :count])
                return share, np.array([row]) if share < 1.0 else NO_ROWS
        fall, bounds = np.empty((2, len(self._bounds)))
        candidates = np.empty(len(fall), np.int64)
        count = write_candidates(self._reach, self._which, step.travel, self._bounds, closed, fall, bounds, candidates)
        candidates, self._before = candidates[:count].copy(), (before, fall)
        if not candidates.size:
            self._bounds[:] = bounds
            return 1.0, candidates
        start = self._start(step, candidates)
        before[candidates] = start
        end = self._along(step, _END, candidates, 0.0)[0]
        bounds[candidates] = end
        self.depth = self._rows.depths(candidates, end)
        # a gap that reaches zero within the step changes by at least the sum of its values at both ends
        near = ~(start + end > fall[candidates])
        share, first = 1.0, candidates[:0]
        if near.any():
            share, first = self._earliest(step, candidates[near], end[near], fall[candidates[near]])
        if share < 1.0:
            # the step will end at the event; 0 times an infinite bound counts as 0
            spent = share * fall if share > 0.0 else np.zeros_like(fall)
            bounds, self.depth = self._bounds - spent, np.zeros(2)
            bounds[candidates] = start - spent[candidates]
        self._bounds[:] = bounds
        return share, first

    def _by_kernel(
        self, kernels: MechanismStages, pairs: KnownPairs, step: RungeKuttaStep, closed: Array
    ) -> tuple[float, int, int]:
        """Return what `first_closing` does."""
        rows, coarse, fine = self._kept
        return first_closing(
            kernels.motion, kernels.rows.parts, pairs.tables, pairs.shapes, rows, step.dense, step.h, step.q0, step.v0,
            step.travel, coarse, fine, closed,
        )  # fmt: skip

    def take(self, share: float) -> None:
        """Let the bounds be those at a share of the step that was searched last; of a step that is not taken 0.

        What was measured at its end, or at a later event, is then not valid.
        """
        if self._before is not None and share < 1.0:
            before, fall = self._before
            # 0 times an infinite bound counts as 0
            self._bounds[:] = np.minimum(self._bounds, before - share * fall) if share > 0.0 else before
        self._before = None

    def crossing(self, step: RungeKuttaStep, share: float, row: int, most: float, turns: int) -> float | None:
        """Return the share of a step at which the gap of an open row falls through zero; None where kernels do not.

        Newton's method begins at the given share, ends at most at that of `most`, and takes so many turns at most.
        """
        kernels, pairs, rows = self._kernels, self._rows.searched, self._rows
        if kernels is None or pairs is None or rows.searched_pair[row] == UNKNOWN_ROW:
            return None
        known = kernels.rows.parts, kernels.rows.room, pairs.tables, pairs.shapes, pairs.bodies
        way, least = (step.dense, step.h, share, step.q0, step.v0), 0.1 * rows.rounding[row]
        return float(crossing_share(kernels.motion, *known, row, rows.searched_pair[row], *way, least, most, turns))

    def gap_and_rate(self, first: Array, t: float, q: Array, v: Array) -> tuple[float, float, float]:
        """Return the gap of a row, its rate, and a tenth of its rounding."""
        gap, rate = self._rows.gaps(t, q, first)[0], (self._rows.gradients(t, q, first) @ v)[0]
        return float(gap), float(rate), 0.1 * float(self._rows.rounding[first[0]])

    def misses(self, first: Array, step: RungeKuttaStep, most: float) -> bool:
        """Return whether the gap of a row that should close at the end of a step is not zero there but above `most`."""
        rows = self._rows
        lever, reach = float(rows.lever[first[0]]), rows.reach[first[0]]
        after = abs(lever * float(rows.gaps(step.t + step.h, step.q, first)[0]))
        # where it is not known how far bodies move, interpolants are all there is
        if after <= most or not np.isfinite(reach).all():
            return False
        before = abs(lever * float(rows.gaps(step.t, step.q0, first)[0]))
        # distances that are searched have errors, by which they may change more than bodies move
        moved = lever * float(reach @ step.travel)
        return max(most, 2.0 * before) < after <= 2.0 * before + moved

    def within(self, t: float, q: Array, gap: float) -> Array:
        """Return the rows whose gap may be at most `gap` [m] at (t, q), the end of the last step or its event."""
        lever = self._rows.lever
        near = (self._bounds * lever[: len(self._bounds)] <= gap).nonzero()[0]
        if near.size:
            self._bounds[near] = least = self._rows.lower_bounds(t, q, near)
            near = near[least * lever[near] <= gap]
        return near

    def forget(self) -> None:
        """Discard all lower bounds, so that every row is evaluated at the next step."""
        self._bounds[:], self._before = -np.inf, None

    def _start(self, step: RungeKuttaStep, candidates: Array) -> Array:
        """Return lower bounds of the gaps of some rows at the start of a step."""
        least = self._bounds[candidates]
        unknown = candidates[least == -np.inf]
        if unknown.size:
            least[least == -np.inf] = self._bounds[unknown] = self._rows.lower_bounds(step.t, step.q0, unknown)
        return least

    def _earliest(self, step: RungeKuttaStep, suspects: Array, end: Array, fall: Array) -> tuple[float, Array]:
        """Return the share of the step at which the first of some rows closes, and which.

        Parameters
        ----------
        step : RungeKuttaStep
            The step.
        suspects : ndarray of int, shape (k,)
            Rows that may close within it.
        end, fall : ndarray, shape (k,)
            Lower bounds of their gaps at its end, and bounds of by how much their gaps fall within it.
        """
        bounds = np.empty((len(FEW_NODES), len(suspects)))
        bounds[:-1], bounds[-1] = self._along(step, FEW_NODES[:-1], suspects, 0.0), end
        # the same test between every two neighbouring nodes
        near = ~(bounds[1:] + bounds[:-1] > _LENGTHS * fall).all(axis=0)
        suspects = suspects[near]
        if not suspects.size:
            return 1.0, suspects

        # the gap of a touching contact is zero to within rounding, or to what the drift of others has left: a row
        # closes where its gap falls below that
        margin = self._rows.rounding[suspects] + np.maximum(-bounds[0, near], 0.0)

        def gaps(x: Array, of: Array) -> Array:
            return self._along(step, x, suspects[of], np.inf) + margin[of]

        # the lower bounds are values of the gaps only where no separating axis is used, as for smooth rows
        known = np.where(self._rows.smooth[suspects], bounds[:, near] + margin, np.nan)
        # values at a few nodes may not show that a body passes through another within the step
        steepest = np.where(fall[near] > self._rows.thickness[suspects], fall[near], np.inf)
        share, k = first_root(gaps, steepest, known)
        given = np.isinf(fall[near]).nonzero()[0]
        if given.size:
            # how far bodies move such a gap is not known: it may reach zero between nodes, too
            slopes = partial(self._slopes, step, suspects[given])
            dip, i = first_dip(lambda x, of: gaps(x, given[of]), slopes, known[:, given], share)
            share, k = (dip, int(given[i])) if i >= 0 else (share, k)
        return share, suspects[k : k + 1] if share < 1.0 else suspects[:0]

    def _slopes(self, step: RungeKuttaStep, index: Array) -> Array:
        """Return the largest rates of some gaps at a few places of a step, times its length, shape (k,)."""
        states = ((x, *step.at(self._system, x)) for x in FEW_NODES.tolist())
        rates = [self._rows.gradients(step.t + x * step.h, q, index) @ v for x, q, v in states]
        return np.asarray(step.h * np.abs(rates).max(axis=0))

    def _along(self, step: RungeKuttaStep, shares: Array, index: Array, near: float) -> Array:
        """Return gaps of some rows, or lower bounds of those above `near`, at n shares of the step, shape (n, k)."""
        if self._kernels is None:
            return self._in_turn(step, shares, lambda t, q: self._rows.measured(t, q, index, near))
        kernels, known = self._kernels, self._kernels.rows.known[index]
        way = step.dense, step.h, shares, step.q0, step.v0
        if known.all():
            return kernels.gaps_along(way, index)
        found = np.empty((len(shares), len(index)))
        if known.any():
            found[:, known] = kernels.gaps_along(way, index[known])
        found[:, ~known] = np.hstack(
            [
                self._in_turn(step, shares, partial(measured_by, family, rows=own, near=near))
                if pairs is None
                else kernels.distances_along(way, pairs, own, near)
                for family, own, pairs in self._rows.with_kernels(index[~known])
            ]
        )
        return found

    def _in_turn(self, step: RungeKuttaStep, shares: Array, measure: Callable[[float, Array], Array]) -> Array:
        """Return what `measure` returns of time and configuration at n shares of the step, shape (n, k)."""
        states = ((share, step.at(self._system, share)[0] if share < 1.0 else step.q) for share in shares.tolist())
        return np.array([measure(step.t + share * step.h, q) for share, q in states])

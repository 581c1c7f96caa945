"""Finds the first gap that closes within a step of the smooth motion; the bounds are rigorous, so none is missed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ....system import System
from ....system.system import Array
from ..contact_rows import SmoothRows
from ..row_sets import without
from ..runge_kutta import RungeKuttaStep
from ..stages import MechanismStages, gaps_along
from .root_finding import FEW_NODES, first_root

_END = np.ones(1)
GapFunction = Callable[[float, Array, Array], Array]


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
        # all points of a shape have the same reach
        self._reach, self._which = np.unique(rows.reach, axis=0, return_inverse=True)
        # a lower bound of each gap at the end of the last step; -inf where it is unknown
        self._bounds = np.full(len(rows.all), -np.inf)
        self.depth = np.zeros(2)

    def first(self, step: RungeKuttaStep, closed: Array) -> tuple[float, Array]:
        """Return the share of a step at which the first open row closes, and which: 1 and none if none does."""
        fall = _largest_fall(self._reach, step.travel)[self._which]
        bounds = self._bounds - fall
        candidates = (~(bounds > 0.0)).nonzero()[0]
        if closed.size:
            candidates = without(candidates, closed)
        self.depth = np.zeros(2)
        if not candidates.size:
            self._bounds = bounds
            return 1.0, candidates
        start = self._start(step, candidates)
        end = self._along(step, _END, candidates, self._rows.lower_bounds)[0]
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
        self._bounds = bounds
        return share, first

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
        self._bounds[:] = -np.inf

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
        bounds = np.vstack([self._along(step, FEW_NODES[:-1], suspects, self._rows.lower_bounds), end])
        # the same test between every two neighbouring nodes
        part = np.diff(FEW_NODES)[:, None] * fall
        near = ~(bounds[1:] + bounds[:-1] > part).all(axis=0)
        suspects = suspects[near]
        if not suspects.size:
            return 1.0, suspects

        # the gap of a touching contact is zero to within rounding, or to what the drift of others has left: a row
        # closes where its gap falls below that
        margin = self._rows.rounding[suspects] + np.maximum(-bounds[0, near], 0.0)

        def gaps(x: Array, of: Array) -> Array:
            return self._along(step, x, suspects[of], self._rows.gaps) + margin[of]

        # the lower bounds are values of the gaps only where no separating axis is used, as for smooth rows
        known = np.where(self._rows.smooth[suspects], bounds[:, near] + margin, np.nan)
        # values at a few nodes may not show that a body passes through another within the step
        steepest = np.where(fall[near] > self._rows.thickness[suspects], fall[near], np.inf)
        share, k = first_root(gaps, steepest, known)
        return share, suspects[k : k + 1] if share < 1.0 else suspects[:0]

    def _along(self, step: RungeKuttaStep, shares: Array, index: Array, gaps: GapFunction) -> Array:
        """Return gaps, or lower bounds, of some rows at n shares of the step, shape (n, k)."""
        found, known, rest = np.empty((len(shares), len(index))), np.zeros(len(index), bool), index
        if self._kernels is not None and (known := self._kernels.rows.known[index]).any():
            measured = np.empty((len(shares), np.count_nonzero(known)))
            of = self._kernels.motion, self._kernels.rows.parts, index[known]
            gaps_along(*of, step.dense, step.h, shares, step.q0, step.v0, measured)
            if known.all():
                return measured
            found[:, known], rest = measured, index[~known]
        for i, share in enumerate(shares.tolist()):
            q = step.at(self._system, share)[0] if share < 1.0 else step.q
            found[i, ~known] = gaps(step.t + share * step.h, q, rest)
        return found


def _largest_fall(reach: Array, travel: Array) -> Array:
    """Return bounds of by how much gaps fall within a step; infinite where the reach of a row is unknown."""
    with np.errstate(invalid="ignore"):
        fall: Array = reach @ travel
    fall[np.isnan(fall)] = np.inf
    return fall

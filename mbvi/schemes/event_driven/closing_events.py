"""Finds where the first gap closes along a step of the smooth motion, without missing one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...system import System
from ...system.system import Array
from .contact_rows import SmoothRows
from .root_finding import FEW_NODES, first_root
from .runge_kutta import RungeKuttaStep

GapFunction = Callable[[float, Array, Array], Array]


class ClosingEvents:
    """Follows lower bounds of the gaps of open rows; rows too far away to close within a step are not evaluated.

    Parameters
    ----------
    system : System
        The system that moves.
    rows : SmoothRows
        The rows of its constraints.

    Attributes
    ----------
    depth : float
        Deepest penetration of an open row at the end of the last step [m or rad].
    """

    def __init__(self, system: System, rows: SmoothRows) -> None:
        self._system, self._rows = system, rows
        # a lower bound of each gap
        self._least = np.full(len(rows.all), -np.inf)
        self.depth = 0.0

    def first(self, step: RungeKuttaStep, closed: Array) -> tuple[float, Array]:
        """Return the share of a step at which the first open row closes, and which: 1 and none if none does."""
        used = _largest_closing(self._rows.reach, step.travel)
        far = self._least - used
        candidates = (~(far > 0.0)).nonzero()[0]
        if closed.size:
            candidates = candidates[~np.isin(candidates, closed)]
        self.depth = 0.0
        if not candidates.size:
            self._least = far
            return 1.0, candidates
        start = self._start(step, candidates)
        end = self._rows.lower_bounds(step.t + step.h, step.q, candidates)
        far[candidates] = end
        self.depth = max(0.0, -float(end.min()))
        # from either end no gap closes faster than its bodies travel
        near = ~(start + end > used[candidates])
        share, first = 1.0, candidates[:0]
        if near.any():
            share, first = self._earliest(step, candidates[near], end[near], used[candidates[near]])
        if share < 1.0:
            # the step will end at the event; a zero share of infinite travel counts as zero
            spent = share * used if share > 0.0 else np.zeros_like(used)
            far, self.depth = self._least - spent, 0.0
            far[candidates] = start - spent[candidates]
        self._least = far
        return share, first

    def within(self, t: float, q: Array, gap: float) -> Array:
        """Return the rows whose gap may be below a length at the end of the last step or its event."""
        lever = self._rows.lever
        near = (self._least * lever <= gap).nonzero()[0]
        if near.size:
            self._least[near] = least = self._rows.lower_bounds(t, q, near)
            near = near[least * lever[near] <= gap]
        return near

    def forget(self) -> None:
        """Discard all lower bounds, so that every row is evaluated at the next step."""
        self._least[:] = -np.inf

    def _start(self, step: RungeKuttaStep, candidates: Array) -> Array:
        """Return lower bounds of the gaps of some rows at the start of a step."""
        least = self._least[candidates]
        unknown = candidates[least == -np.inf]
        if unknown.size:
            least[least == -np.inf] = self._least[unknown] = self._rows.lower_bounds(step.t, step.q0, unknown)
        return least

    def _earliest(self, step: RungeKuttaStep, suspects: Array, end: Array, used: Array) -> tuple[float, Array]:
        """Return the share of the step at which the first of some rows closes, and which.

        Parameters
        ----------
        step : RungeKuttaStep
            The step.
        suspects : ndarray of int, shape (k,)
            Rows that may close within it.
        end, used : ndarray, shape (k,)
            Lower bounds of their gaps at its end, and by how much their gaps may close within it.
        """
        bounds = np.array([*(self._at(step, x, suspects, self._rows.lower_bounds) for x in FEW_NODES[:-1]), end])
        # between two nodes no gap closes faster than its bodies travel
        part = np.diff(FEW_NODES)[:, None] * used
        near = ~(bounds[1:] + bounds[:-1] > part).all(axis=0)
        suspects = suspects[near]
        if not suspects.size:
            return 1.0, suspects

        def gaps(x: float, of: Array) -> Array:
            # the gap of a touching contact is zero to within rounding: a row closes where it falls below minus that
            return self._at(step, x, suspects[of], self._rows.gaps) + self._rows.rounding[suspects[of]]

        # a lower bound by a separating axis is no value of the gap
        known = bounds[:, near] + self._rows.rounding[suspects] if self._rows.smooth[suspects].all() else None
        # a body that passes through another within the step may not show in a few values
        steepest = np.where(used[near] > self._rows.thickness[suspects], used[near], np.inf)
        share, k = first_root(gaps, steepest, known)
        return share, suspects[k : k + 1] if share < 1.0 else suspects[:0]

    def _at(self, step: RungeKuttaStep, share: float, index: Array, gaps: GapFunction) -> Array:
        q = step.at(self._system, share)[0] if share < 1.0 else step.q
        return gaps(step.t + share * step.h, q, index)


def _largest_closing(reach: Array, travel: Array) -> Array:
    """Return by how much gaps may close at most; infinite where the reach of a row is unknown."""
    with np.errstate(invalid="ignore"):
        used: Array = reach @ travel
    used[np.isnan(used)] = np.inf
    return used

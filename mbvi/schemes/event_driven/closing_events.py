"""Where gaps first fall to zero along a step of the smooth motion, none missed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...system import System
from ...system.system import Array
from .contact_rows import SmoothRows
from .root_finding import FEW_NODES, first_root
from .runge_kutta import RungeKuttaStep

Ask = Callable[[float, Array, Array], Array]


class Crossings:
    """Watches the gaps of open rows along a motion; rows too far to close within a step are not asked.

    Parameters
    ----------
    system, rows
        What moves, and the rows.
    """

    def __init__(self, system: System, rows: SmoothRows) -> None:
        self._system, self._rows = system, rows
        # what each gap is at least
        self._least = np.full(len(rows.all), -np.inf)
        # the deepest that open rows were at the end of the last step [m or rad]
        self.depth = 0.0

    def first(self, stride: RungeKuttaStep, closed: Array) -> tuple[float, Array]:
        """Return the share of a step at which the first open row closes, and which: 1 and none if none does."""
        used = _used_up(self._rows.reach, stride.travel)
        far = self._least - used
        due = (~(far > 0.0)).nonzero()[0]
        if closed.size:
            due = due[~np.isin(due, closed)]
        self.depth = 0.0
        if not due.size:
            self._least = far
            return 1.0, due
        start, end = self._start(stride, due), self._rows.lower_bounds(stride.t + stride.h, stride.q, due)
        far[due] = end
        self.depth = max(0.0, -float(end.min()))
        # from either end no gap falls faster than its bodies travel
        near = ~(start + end > used[due])
        share, first = self._earliest(stride, due[near], end[near], used[due[near]]) if near.any() else (1.0, due[:0])
        if share < 1.0:
            # the step will be cut: its end is not where they will be; of infinite travel no share is none
            spent = share * used if share > 0.0 else np.zeros_like(used)
            far, self.depth = self._least - spent, 0.0
            far[due] = start - spent[due]
        self._least = far
        return share, first

    def within(self, t: float, q: Array, gap: float) -> Array:
        """Return the rows that may be as near as that length where the last step was cut or ended."""
        lever = self._rows.lever
        near = (self._least * lever <= gap).nonzero()[0]
        if near.size:
            self._least[near] = least = self._rows.lower_bounds(t, q, near)
            near = near[least * lever[near] <= gap]
        return near

    def forget(self) -> None:
        """Ask every row at the next step."""
        self._least[:] = -np.inf

    def _start(self, stride: RungeKuttaStep, due: Array) -> Array:
        """Return what the gaps of some rows are at least at the start of a step."""
        least = self._least[due]
        unknown = due[least == -np.inf]
        if unknown.size:
            least[least == -np.inf] = self._least[unknown] = self._rows.lower_bounds(stride.t, stride.q0, unknown)
        return least

    def _earliest(self, stride: RungeKuttaStep, suspects: Array, end: Array, used: Array) -> tuple[float, Array]:
        """Return where the first of some rows falls, of which `end` is the least gap there and `used` the travel."""
        bounds = np.array([*(self._at(stride, x, suspects, self._rows.lower_bounds) for x in FEW_NODES[:-1]), end])
        # nor does one in between
        part = np.diff(FEW_NODES)[:, None] * used
        near = ~(bounds[1:] + bounds[:-1] > part).all(axis=0)
        suspects = suspects[near]
        if not suspects.size:
            return 1.0, suspects

        def gaps(x: float, of: Array) -> Array:
            # what touches is off by rounding: a row closes where its gap falls below that
            return self._at(stride, x, suspects[of], self._rows.gaps) + self._rows.rounding[suspects[of]]

        # a bound by an axis is no gap
        known = bounds[:, near] + self._rows.rounding[suspects] if self._rows.smooth[suspects].all() else None
        # what passes through another within the step may leave no trace in a few values
        steepest = np.where(used[near] > self._rows.thickness[suspects], used[near], np.inf)
        share, k = first_root(gaps, steepest, known)
        return share, suspects[k : k + 1] if share < 1.0 else suspects[:0]

    def _at(self, stride: RungeKuttaStep, share: float, index: Array, ask: Ask) -> Array:
        q = stride.at(self._system, share)[0] if share < 1.0 else stride.q
        return ask(stride.t + share * stride.h, q, index)


def _used_up(reach: Array, travel: Array) -> Array:
    """Return by how much gaps may have closed; infinite where nothing is known of a row."""
    with np.errstate(invalid="ignore"):
        used: Array = reach @ travel
    used[np.isnan(used)] = np.inf
    return used

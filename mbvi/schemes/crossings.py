"""The first instant within a step at which an open constraint closes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..constraints import SmoothRows
from ..system import System
from ..system.system import Array
from .flow import Stride

# what touches is off by rounding: a row closes where its gap falls below this [m, rad]
_ROUNDING = 1e-14
# shares of a step at which gaps are looked at first, and where one may close, more closely
_COARSE, _FINE = np.linspace(0.0, 1.0, 5), np.linspace(0.0, 1.0, 33)


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

    def first(self, stride: Stride, closed: Array) -> tuple[float, Array]:
        """Return the share of a step at which the first open row closes, and which: 1 and none if none does."""
        far = self._least - _used_up(self._rows.reach, stride.travel)
        due = np.flatnonzero(~(far > 0.0))
        due = due[~np.isin(due, closed)]
        self.depth = 0.0
        if not due.size:
            self._least = far
            return 1.0, due
        gaps = np.array([self._gaps(stride, share, due) for share in _COARSE])
        # a parabola through three neighbours dips by an eighth of their second difference at most
        dip = np.abs(np.diff(gaps, 2, axis=0)).max(axis=0)
        suspects = due[gaps[1:].min(axis=0) <= dip]
        far[due] = gaps[-1]
        self.depth = max(0.0, -float(gaps[-1].min()))
        share, first = 1.0, due[:0]
        if suspects.size:
            share, first = self._earliest(stride, suspects)
        if share < 1.0:
            # the step will be cut: its end is not where they will be
            far[due], self.depth = gaps[0] - _used_up(self._rows.reach[due], share * stride.travel), 0.0
        self._least = far
        return share, first

    def near(self, gap: float) -> Array:
        """Return the rows that may be as near as that."""
        return np.flatnonzero(self._least <= gap)

    def forget(self) -> None:
        """Ask every row at the next step."""
        self._least[:] = -np.inf

    def _gaps(self, stride: Stride, share: float, index: Array) -> Array:
        q, _ = stride.at(self._system, share)
        return self._rows.gaps(stride.t + share * stride.h, q, index) + _ROUNDING

    def _earliest(self, stride: Stride, suspects: Array) -> tuple[float, Array]:
        from scipy.optimize import brentq

        gaps = np.array([self._gaps(stride, share, suspects) for share in _FINE])
        best, first = 1.0, suspects[:0]
        for k, row in enumerate(suspects):
            index = suspects[k : k + 1]

            def gap(share: float, index: Array = index) -> float:
                return float(self._gaps(stride, share, index)[0])

            bracket = _bracket(gap, gaps[:, k])
            if bracket is None or bracket[0] >= best:
                continue
            share = float(brentq(gap, *bracket, xtol=1e-15, rtol=8.9e-16)) if bracket[0] < bracket[1] else bracket[0]
            if share < best:
                best, first = share, np.array([row])
        return best, first


def _used_up(reach: Array, travel: Array) -> Array:
    """Return by how much gaps may have closed; infinite where nothing is known of a row."""
    with np.errstate(invalid="ignore"):
        used: Array = reach @ travel
    used[np.isnan(used)] = np.inf
    return used


def _bracket(gap: Callable[[float], float], values: Array) -> tuple[float, float] | None:
    """Return two shares between which a gap first falls below zero; where it starts there it must rise first."""
    from scipy.optimize import minimize_scalar

    below = np.flatnonzero(values[1:] < 0.0) + 1
    last = int(below[0]) if below.size else len(values)
    # a dip between two samples
    for j in range(1, min(last, len(values) - 1)):
        if values[j] <= min(values[j - 1], values[j + 1]) and values[j] > 0.0:
            low = minimize_scalar(gap, bounds=(_FINE[j - 1], _FINE[j + 1]), method="bounded", options={"xatol": 1e-9})
            if low.fun < 0.0:
                return float(_FINE[j - 1]), float(low.x)
    if not below.size:
        return None
    if values[last - 1] > 0.0 and last > 1:
        return float(_FINE[last - 1]), float(_FINE[last])
    # it is back before the first sample: where was it highest?
    high = minimize_scalar(lambda s: -gap(s), bounds=(0.0, _FINE[last]), method="bounded", options={"xatol": 1e-12})
    return (float(high.x), float(_FINE[last])) if -high.fun > 0.0 else (0.0, 0.0)

"""Joints with dry friction: when one stops, and what a step may hide of that."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...problem import Problem
from ...projection import joint_rows
from ...system.system import Array
from .doubling import HIDDEN, Doubled
from .measure import Measure


class JointSlips:
    """The joints and hinges with dry friction at a state.

    Parameters
    ----------
    problem : Problem
        Of which `has_joint_friction` is true.
    measure : Measure
        The units.
    t, q, v
        The state.
    h : float
        A time over which forces act [s].

    Attributes
    ----------
    rows : ndarray, shape (d, nv)
        Their speeds are these rows times v.
    before : ndarray, shape (d,)
        The speeds [rad/s, m/s].
    """

    def __init__(self, problem: Problem, measure: Measure, t: float, q: Array, v: Array, h: float) -> None:
        self.rows = joint_rows(problem.system.free_motion(t, q, v, h).metric)[0][::2]
        self.before, self._units = self.rows @ v, measure.joint_units(self.rows)

    def slides(self, least: float) -> Array:
        """Return which joints move faster than `least`, in the units of `Measure`, shape (d,)."""
        return np.asarray(np.abs(self.before) > least * self._units)

    def stop_time(self, acceleration: Array, least: float) -> float:
        """Return the time until a joint that slides stops at a given acceleration, shape (nv,); inf if none does."""
        change = self.rows @ acceleration
        falls = self.slides(least) & (change * self.before < 0.0)
        return float((np.abs(self.before[falls]) / np.abs(change[falls])).min(initial=np.inf))

    def hidden(self, found: Doubled, acceleration: Callable[[], Array], h: float, least: float) -> tuple[float, bool]:
        """Return what a step may hide of an error, in the units of `Measure`, and whether a joint reverses.

        A joint that stops within the step stays until its end, even if forces would drive it back at once. Its speed is
        wrong by up to that to which `acceleration`, that before the step, leads beyond zero. A joint that begins to
        move does so from the start of the step on, as in `doubling.hidden`.
        """
        ends = np.array([self.rows @ step.v for step in found.steps])
        slid, fast = self.slides(least), np.abs(ends) > least * self._units
        stops, beyond = slid & (ends * self.before <= 0.0).any(axis=0), 0.0
        if stops.any():
            beyond = np.maximum(-np.sign(self.before) * (self.before + h * (self.rows @ acceleration())), 0.0)
        begins = HIDDEN * np.abs(ends).max(axis=0)
        error = np.where(stops, beyond, np.where(~slid & fast.any(axis=0), begins, 0.0)) / self._units
        return float(error.max(initial=0.0)), bool((slid & fast & (ends * self.before < 0.0)).any())

"""Sizes of displacements and speeds in the units of a problem, and the thresholds that follow from a tolerance."""

from __future__ import annotations

import numpy as np

from ...problem import Problem
from ...system.parts import velocity_units

Array = np.ndarray

# error of one step, gap at which a contact is closed and speed at which it rests, all relative to the tolerance
_STEP, _GAP, _REST = 0.2, 0.01, 0.05
# the gap is at least so many activation tolerances
_LEAST_GAP = 4.0
# speed at which a contact that is held counts as not moving, relative to the largest speed: rounding of projections
_STILL = 1e-6
# step below which every step is accepted, relative to the time in which bodies move by the tolerance
_SHORTEST = 0.1


class Measure:
    """Sizes in lengths of the scene and radians, and thresholds of a tolerance.

    Parameters
    ----------
    problem : Problem
        The problem.
    tolerance : float
        See `Adaptive`.

    Attributes
    ----------
    step : float
        Largest error of one step.
    gap : float
        Gap below which a contact counts as closed [m].
    units : ndarray, shape (nv,)
        Unit of each velocity; see `velocity_units`.
    """

    def __init__(self, problem: Problem, tolerance: float) -> None:
        self.units, self._length = velocity_units(problem.system, problem.length), problem.length
        self._constraints, self._tolerance = problem.constraints, tolerance
        self.step = _STEP * tolerance
        self.gap = max(_GAP * tolerance * problem.length, _LEAST_GAP * problem.tolerance)

    def size(self, tangent: Array) -> float:
        """Return the largest entry of a displacement or velocity, shape (nv,)."""
        return float(np.abs(tangent / self.units).max(initial=0.0))

    def error(self, displacement: Array, change: Array, speed: float) -> float:
        """Return the larger of a displacement and a change of velocity, that relative to `speed`, at least 1."""
        return max(self.size(displacement), self.size(change) / max(1.0, speed))

    def still(self, number: Array, speed: float) -> Array:
        """Return the speed of each constraint that is rounding at the largest speed of the state [m/s, rad/s]."""
        return _STILL * max(1.0, speed) * self._row_units(number)

    def rest(self, number: Array, speed: float) -> Array:
        """Return the speed below which a contact of each constraint rests [m/s, rad/s]."""
        return _REST * self._tolerance * max(1.0, speed) * self._row_units(number)

    def slides(self, speed: float) -> float:
        """Return the slip below which a contact does not slide [m/s]."""
        return _REST * self._tolerance * max(1.0, speed) * self._length

    def shortest(self, speed: float) -> float:
        """Return the step below which every step is accepted at a largest speed [s]."""
        return _SHORTEST * self._tolerance / max(1.0, speed)

    def joint_units(self, rows: Array) -> Array:
        """Return the unit of the speed of each joint, which is its row times v, shape (d,): 1 rad/s of hinges."""
        return np.where((rows != 0.0).sum(axis=1) == 1, np.abs(rows) @ self.units, 1.0)

    def _row_units(self, number: Array) -> Array:
        return np.ones(len(number)) * self._length / self._constraints.levers(number)

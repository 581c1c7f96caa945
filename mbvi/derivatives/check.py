"""Compares a derivative with differences of runs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..problem import Problem
from ..projection import Projector
from ..schemes import EventDriven
from ..schemes.event_driven.motion_state import NO_ROWS
from ..schemes.event_driven.rows.contact_rows import SmoothRows
from ..system.parts import velocity_units
from ..system.system import Array
from .directions import Directions
from .variation import LEAST

# tolerance of the runs that are compared
_TOLERANCE = 1e-12
# size of a column, relative to the largest, that counts as none
_ROUNDING = 1e-9
# lengths of differences in the order they are tried, and the relative error estimate that is good enough
_LENGTHS, _GOOD = (1e-5, 1e-6, 1e-4), 1e-8


@dataclass(frozen=True, eq=False)
class SensitivityCheck:
    """A derivative along some directions, beside differences of runs at tolerance 1e-12.

    Attributes
    ----------
    directions : ndarray, shape (p, k)
        Random combinations of the columns, one in each column.
    derivative : ndarray, shape (2 nv, k)
        The derivative of the state at the end along each.
    differences : ndarray, shape (2 nv, k)
        The same by differences of order four.
    error : ndarray, shape (k,)
        The largest difference of both, in lengths of the scene and radians, relative to the largest entry of the
        derivative or of the variation at the start; by parameters at least 1e-3 of such a unit for a variation of the
        size of the parameter: of a mass by itself, a place by the scene's length, a torque by what accelerates by 10.
    uncertainty : ndarray, shape (k,)
        An estimate of how much of that is the error of the differences.
    """

    directions: Array
    derivative: Array
    differences: Array
    error: Array
    uncertainty: Array

    def __repr__(self) -> str:
        """Return both along each direction at the entry where the derivative is largest."""
        lines = ["direction   derivative       differences      relative error   of the differences"]
        for k, (error, uncertainty) in enumerate(zip(self.error, self.uncertainty, strict=True)):
            row = int(np.abs(self.derivative[:, k]).argmax())
            both = f"{self.derivative[row, k]:<16.9g} {self.differences[row, k]:<16.9g}"
            lines.append(f"{k:<11} {both} {error:<16.1e} {uncertainty:.1e}")
        return "\n".join(lines)


@dataclass(frozen=True, eq=False)
class VariedRuns:
    """Runs from varied starts.

    Attributes
    ----------
    problem : Problem
        The problem.
    duration : float
        [s].
    varied : Directions
        The columns of the variations.
    start : ndarray, shape (2 nv, p)
        The variations of the initial state, with those that keep closed what is closed.
    closed : ndarray of int
        Rows that are closed at the start, in all runs.
    still : ndarray of bool, or None
        Which of them have no slip; None without friction.
    """

    problem: Problem
    duration: float
    varied: Directions
    start: Array
    closed: Array
    still: Array | None = None

    def compared(self, matrix: Array, count: int) -> SensitivityCheck:
        """Return the derivative at the end along some random directions, beside differences."""
        units = np.tile(velocity_units(self.problem.system, self.problem.length), 2)
        size, sizes = np.abs(self.start / units[:, None]).max(axis=0), self.varied.sizes
        of_p = self.varied.of_parameters
        size = np.where(of_p, 1.0 / sizes, size)
        chosen = np.random.default_rng(0).normal(size=(matrix.shape[1], count))
        # e < 0 is no restitution, so that all of them grow
        chosen = np.where(np.any(self.varied.by_e, axis=0)[:, None], np.abs(chosen), chosen)
        # a unit variation of each column has the size of a length of the scene or a radian
        # of a column that would open a contact or a loop rounding alone is left
        chosen /= np.where(size > _ROUNDING * size.max(), size, 1.0)[:, None] * np.sqrt(len(chosen))
        derivative = matrix @ chosen
        found = [self._difference(direction, units) for direction in chosen.T]
        differences = np.array([one for one, _ in found]).T
        found_sizes = [np.abs(one / units[:, None]).max(axis=0) for one in (derivative, self.start @ chosen)]
        least = LEAST * np.abs(chosen / sizes[:, None])[of_p].max(axis=0, initial=0.0)
        scale = np.maximum(np.maximum(*found_sizes), least)
        scale = np.where(scale > 0.0, scale, 1.0)
        error = np.abs((differences - derivative) / units[:, None]).max(axis=0) / scale
        return SensitivityCheck(chosen, derivative, differences, error, np.array([one for _, one in found]) / scale)

    def _difference(self, direction: Array, units: Array) -> tuple[Array, float]:
        """Return the difference quotient along a direction and an estimate of its error, without unit."""
        best: tuple[Array, float] = np.full(len(units), np.nan), np.inf
        for length in _LENGTHS:
            found, coarse = self._quotients(length * direction, length)
            # the quotient of order two is off by much more than that of order four
            estimate = float(np.abs((found - coarse) / units).max())
            if estimate < best[1]:
                best = found, estimate
            if estimate < _GOOD * float(np.abs(found / units).max()):
                break
        return best

    def _quotients(self, change: Array, length: float) -> tuple[Array, Array]:
        """Return the difference quotients of order four and of order two."""
        centre = self._centre
        if (2.0 * (self.varied.by_e @ change)[self._rows.number] > self._rows.restitution).any():
            # differences on one side
            one, two, four = (self._from(centre, x * change) for x in (1.0, 2.0, 4.0))
            return (32.0 * one - 12.0 * two + four) / (12.0 * length), (4.0 * one - two) / (2.0 * length)
        one, two = (self._from(centre, x * change) - self._from(centre, -x * change) for x in (1.0, 2.0))
        return (8.0 * one - two) / (12.0 * length), one / (2.0 * length)

    @cached_property
    def _centre(self) -> tuple[Array, Array]:
        return self._end(np.zeros(self.start.shape[1]))

    @cached_property
    def _rows(self) -> SmoothRows:
        return EventDriven(_TOLERANCE).integrator(self.problem, Projector()).rows

    def _from(self, centre: tuple[Array, Array], change: Array) -> Array:
        """Return the variation of the end, shape (2 nv,), by a combination of columns."""
        q, v = self._end(change)
        return np.concatenate([self.problem.system.difference(centre[0], q), v - centre[1]])

    def _end(self, change: Array) -> tuple[Array, Array]:
        """Return the state at the end of the run that starts varied."""
        problem, n = self.problem, self.problem.system.nv
        dx, columns = self.start @ change, self.varied
        varied = columns.parameters.varied(problem, columns.by_p @ (change / columns.sizes))
        q = problem.system.integrate(problem.q0, dx[:n])
        varied = varied.at(q, problem.system.tangent(q, problem.v0 + dx[n:]), problem.t0)
        varied.constraints.renew()
        integrator = EventDriven(_TOLERANCE).integrator(varied, Projector())
        integrator.rows.restitution = integrator.rows.restitution + (columns.by_e @ change)[integrator.rows.number]
        if self.closed.size:
            # closed contacts stay so to all orders of the variation, and not to the first one only
            integrator.closed = self.closed
            if integrator.modes is not None and self.still is not None:
                integrator.modes.choose(self.closed, self.still, np.zeros((len(self.closed), 3)))
            integrator.remove_drift()
            integrator.closed = NO_ROWS
        integrator.rows.friction = (columns.parameters.frictions(len(problem.constraints)) @ columns.by_p) @ (
            change / columns.sizes
        )
        for _ in integrator.run(self.duration):
            pass
        return integrator.q, integrator.v

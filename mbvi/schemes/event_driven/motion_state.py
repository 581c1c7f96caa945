"""The state of an event-driven integration: time, configuration, velocity and the contacts that are closed."""

from __future__ import annotations

import numpy as np

from ...problem import Problem
from ...projection import Projector
from ...system.parts import velocity_units
from ...system.system import Array
from ..step import Step
from .finding.closing_events import ClosingEvents
from .friction.implicit_steps import ImplicitSteps
from .friction.modes import ContactModes
from .observed import ContactObserver
from .rows.contact_rows import SmoothRows
from .runge_kutta import Flow, velocity_change

# largest error of one step, relative to the tolerance
LOCAL = 0.3
# largest gap of a touching contact, relative to the tolerance of the scheme
_TOUCHING = 0.01
# rates below this count as zero, in lengths of the scene a second [1/s]
SLOW = 1e-14
# slip across its direction that does not turn it, relative to the tolerance
_FAINT = 0.01
NO_ROWS = np.zeros(0, np.int64)


class MotionState:
    """A state of the motion, with the rows of all constraints.

    Parameters
    ----------
    problem : Problem
        System, constraints and initial state.
    tolerance : float
        Intended bound of the error; see `EventDriven`.
    projector : Projector
        Solves the projections.

    Attributes
    ----------
    t, q, v
        Time [s], configuration and velocity.
    modes : ContactModes or None
        Modes of the closed rows; None in problems without friction.
    implicit : ImplicitSteps or None
        Steps where directions of slip turn fast; None in problems without friction.
    units : ndarray, shape (nv,)
        See `velocity_units`.
    closed : ndarray of int, shape (k,)
        The rows that are kept closed.
    held : ndarray of int, shape (k,)
        Rows that touch and cannot close because of those; see `held_rows`.
    all_touching : ndarray of int, shape (k,)
        All rows that touched at the last event; few of them may take part in it.
    event_rows : ndarray of int, shape (k,)
        The rows of the last event.
    impact_time : float
        Time of the last impact [s].
    depth : ndarray, shape (2,)
        Greatest depths of contacts and of limits at the end of the last step, before drift was removed [m, m or rad].
    residual : float
        Relative KKT residual of the law that led to the state; 0 where the law was not applied.
    touching : float
        Gap below which a contact touches [m].
    fallbacks : int
        How many steps of `Paoli` were taken.
    undetermined : int
        How many of them because contacts with friction had no unique accelerations.
    at_fallbacks : set of int
        The constraints that were active in them; of those with jumping gradients, if some were, only these.
    fallback : Step or None
        The step of `Paoli`, if the last step was one.
    last_fallback : Step or None
        The last step of `Paoli`.
    strikes : bool
        Whether that holds an impact.
    """

    def __init__(self, problem: Problem, tolerance: float, projector: Projector) -> None:
        self.problem, self.tolerance, self.projector = problem, tolerance, projector
        self.system = problem.system
        self.system.start()
        self.t, self.q, self.v = problem.t0, problem.q0.copy(), problem.v0.copy()
        self.rows = SmoothRows(problem.constraints, self.t, self.q, problem.length)
        self.flow = Flow(problem, self.rows)
        self.closing = ClosingEvents(self.system, self.rows, self.flow.kernels)
        self.units = velocity_units(self.system, problem.length)
        slow, faint = SLOW * problem.length, _FAINT * tolerance * problem.length
        self.modes = ContactModes(self.flow, self.rows, slow, faint) if problem.constraints.frictional else None
        self.flow.modes = self.modes
        local = LOCAL * tolerance
        self.implicit = None if self.modes is None else ImplicitSteps(self.flow, self.modes, self.units, local)
        self.observed = ContactObserver(problem, self.rows)
        self.closed = self.held = self.all_touching = NO_ROWS
        self.touching = min(problem.tolerance, _TOUCHING * tolerance * problem.length)
        self.event_rows, self.impact_time = NO_ROWS, -np.inf
        self.depth, self.residual, self.fallbacks, self.undetermined = np.zeros(2), 0.0, 0, 0
        self.fallback: Step | None = None
        self.last_fallback: Step | None = None
        self.strikes = False
        self.at_fallbacks: set[int] = set()

    def feature_pairs(self) -> Array:
        """Return the rows of the pairs of which rows of features are closed, ascending."""
        features = self.closed[self.closed >= len(self.rows.all)]
        return np.unique(self.rows.pair[features]) if features.size else NO_ROWS

    def slow(self, index: Array) -> Array:
        """Return the rates of some rows that count as zero [m/s or rad/s]."""
        return np.asarray(SLOW * self.problem.length / self.rows.lever[index])

    def slow_constraints(self, numbers: Array) -> Array | float:
        """Return the rates of some constraints that count as zero [m/s or rad/s]."""
        return SLOW * self.problem.length / self.problem.constraints.levers(numbers)

    def remove_drift(self) -> None:
        """Remove the drift of closed contacts: from the configuration, then from the velocity."""
        if self.modes is None and self.flow.kernels is not None:
            found = self.flow.kernels.remove_drift(self.closed, self.q, self.v)
            if found is not None:
                self.q, self.v, gap = found
                self.depth = np.maximum(self.depth, self.rows.depths(self.closed, gap))
                return
        for _ in range(2):
            self.depth = np.maximum(self.depth, self.close_gaps(self.closed))
        J = self._kept_rows()
        self.v = self.v + velocity_change(self.system.metric(self.q), J, -(J @ self.v))

    def _kept_rows(self) -> Array:
        """Return the gradients of closed rows, and of the tangents along which they stick."""
        J = self.rows.gradients(self.t, self.q, self.closed)
        if self.modes is None or not self.modes.sticks.any():
            return J
        T = np.asarray(self.rows.tangents(self.t, self.q, self.closed).jacobian)[self.modes.sticks.repeat(2)]
        return np.concatenate([J, T[T.any(axis=1)]])

    def close_gaps(self, index: Array) -> Array:
        """Move the configuration so that some gaps vanish, to first order; return the greatest depths before."""
        gap, J = self.rows.gaps(self.t, self.q, index), self.rows.gradients(self.t, self.q, index)
        self.q = self.system.integrate(self.q, velocity_change(self.system.metric(self.q), J, -gap))
        return self.rows.depths(index, gap)

    def names(self, index: Array) -> list[str]:
        """Return the names of the constraints of some rows, each once."""
        return sorted({self.problem.constraints.name(int(k)) for k in self.rows.number[index]})


def certain_rates(J: Array, v: Array, slow: Array | float) -> Array:
    """Return for each row a rate that exceeds all rounding errors of J v, at least `slow`."""
    return np.asarray(1e-12 * (np.abs(J) @ np.abs(v)) + slow)

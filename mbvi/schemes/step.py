"""What one step of a scheme leaves behind."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from ..constraints import Rows
from ..problem import Problem
from ..projection import Projector
from ..system.system import Array


class Step(NamedTuple):
    """The state after a step and how it came about.

    Attributes
    ----------
    t : float
        Time [s].
    q : ndarray, shape (nq,)
        Configuration.
    v : ndarray, shape (nv,)
        Velocity.
    active : Rows
        The active constraints at q.
    percussion : ndarray, shape (k,)
        p >= 0 with M (v - v_before) - h g = J' p [N s, N m s] (Lemma 3.3 with the sign turned).
    before, free, after : ndarray, shape (k,)
        J v of each active row: before the step, as the forces alone would leave it, and after it [m/s, rad/s].
    residual : float
        Relative KKT residual of the projection.
    """

    t: float
    q: Array
    v: Array
    active: Rows
    percussion: Array
    before: Array
    free: Array
    after: Array
    residual: float


class Scheme(Protocol):
    """A way to advance a problem by one step."""

    def step(self, problem: Problem, t: float, q: Array, v: Array, h: float, projector: Projector) -> Step:
        """Return the state at t + h.

        Parameters
        ----------
        problem : Problem
            What moves.
        t : float
            Time [s].
        q : ndarray, shape (nq,)
            Configuration.
        v : ndarray, shape (nv,)
            Velocity.
        h : float
            Time step [s].
        projector : Projector
            Solves the projections and keeps its solvers between steps.
        """
        ...

"""The result of one step of a scheme, and the impact law (8) that all schemes apply."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..constraints import Rows
from ..problem import Problem
from ..projection import FreeMotion, Projector, TreeFreeMotion
from ..system import System
from ..system.system import Array
from .row_projection import project_rows, slip_rates

# rates of a step without active rows
NO_RATES = np.zeros((4, 0))


class Step(NamedTuple):
    """The state after a step, with the constraints that acted in it.

    Attributes
    ----------
    t : float
        Time [s].
    q : ndarray, shape (nq,)
        Configuration.
    v : ndarray, shape (nv,)
        Velocity.
    active : Rows
        The active constraints at the configuration where the law was applied; for some schemes this is within the
        step. Their gaps are those at q, to first order.
    rates : ndarray, shape (4, k)
        Of each active row the percussion, then three rates of its gap: `percussion`, `free`, `after` and `before`.
    residual : float
        Relative KKT residual of the projection; with friction that of Coulomb's law.
    slip : ndarray, shape (4, k, 2), or None
        Of each row the percussion and three velocities along its tangents, in the order of `rates` [N s, m/s]; None
        without friction.
    """

    t: float
    q: Array
    v: Array
    active: Rows
    rates: Array
    residual: float
    slip: Array | None = None

    @property
    def percussion(self) -> Array:
        """P >= 0 with M (v - v_before) - h g = J' p, shape (k,) [N s, N m s] (Lemma 3.3 with the sign turned)."""
        return self.rates[0]

    @property
    def free(self) -> Array:
        """Rate of the gap, J v + df/dt, that the forces alone would lead to, shape (k,) [m/s, rad/s]."""
        return self.rates[1]

    @property
    def after(self) -> Array:
        """Rate of the gap after the step, shape (k,) [m/s, rad/s]."""
        return self.rates[2]

    @property
    def before(self) -> Array:
        """Rate of the gap before the step, shape (k,) [m/s, rad/s]."""
        return self.rates[3]


def law(
    projector: Projector, v: Array, free_motion: FreeMotion | TreeFreeMotion, rows: Rows
) -> tuple[Array, Array, float, Array | None]:
    """Return the velocity after the law (8), the rates of the rows, the relative residual, and `Step.slip`.

    e applies to the rate of the gap: argmin |w - x|_M with J w + r >= -e (J v + r), r = df/dt. With friction it is
    Coulomb's law with that bound of the normal rates.

    Parameters
    ----------
    projector : Projector
        Solves the projection.
    v : ndarray, shape (nv,)
        Velocity before.
    free_motion : FreeMotion
        The velocity x that the forces alone would lead to, and M.
    rows : Rows
        The active constraints.
    """
    if rows.rate is None and rows.tangents is None:
        return *projector.law(v, free_motion, rows.jacobian, rows.restitution, rows.constraint), None
    x, before = free_motion.free, rows.speeds(v)
    lower = -rows.restitution * before
    if rows.rate is not None:
        lower -= rows.rate
    w, percussion, residual, tangential = project_rows(projector, x, free_motion.metric, rows, lower)
    rates = np.array([percussion, rows.speeds(x), rows.speeds(w), before])
    return w, rates, residual, slip_rates(rows, tangential, x, w, v)


# closing speed below which a row counts as still [lengths of the scene per second, rad/s]
STILL = 1e-12


def closes(rates: Array, still: Array | float) -> Array:
    """Return which rows close, shape (k,).

    A row closes if it has a percussion and its gap fell before the law, faster than `still` plus twice what the forces
    of the step explain.
    """
    percussion, free, _, before = rates
    return np.asarray((percussion > 0.0) & (before + 2.0 * np.abs(free - before) < -still))


def still_rates(problem: Problem, numbers: Array) -> Array | float:
    """Return the closing speed below which each row counts as still, shape (k,) or one for all [m/s, rad/s]."""
    return STILL * problem.length / problem.constraints.levers(numbers)


def advance_gaps(step: Step, time: float) -> Step:
    """Return the step with its gaps advanced by a time at the rates after the law, to first order."""
    return step._replace(active=step.active._replace(gap=step.active.gap + time * step.after))


def end_at(system: System, state: Step, steps: list[Step], t: float) -> tuple[list[Step], Step]:
    """Return the steps from a state up to a time, the last of them interpolated along the retraction.

    Parameters
    ----------
    system : System
        The system that moves.
    state : Step
        Where the first step starts.
    steps : list of Step
        Steps of a scheme with `Timing.jump` = 0, the last of which ends at t or later.
    t : float
        Time [s].
    """
    k = next((k for k, step in enumerate(steps) if step.t >= t), len(steps) - 1)
    start, end = steps[k - 1] if k else state, steps[k]
    displacement = system.difference(start.q, end.q)
    q = system.integrate(start.q, min(1.0, (t - start.t) / (end.t - start.t)) * displacement)
    return steps[:k], advance_gaps(end._replace(t=t, q=q), t - end.t)

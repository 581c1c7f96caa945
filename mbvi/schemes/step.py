"""What one step of a scheme leaves behind."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..constraints import Rows
from ..problem import Problem
from ..projection import FreeMotion, Projector, TreeFreeMotion
from ..system import System
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
        The active constraints where the law was applied, which for some schemes is within the step; their gaps are
        those at q, to first order.
    rates : ndarray, shape (4, k)
        `percussion`, `free`, `after` and `before` of each active row.
    residual : float
        Relative KKT residual of the projection.
    """

    t: float
    q: Array
    v: Array
    active: Rows
    rates: Array
    residual: float

    @property
    def percussion(self) -> Array:
        """P >= 0 with M (v - v_before) - h g = J' p, shape (k,) [N s, N m s] (Lemma 3.3 with the sign turned)."""
        return self.rates[0]

    @property
    def free(self) -> Array:
        """Rate of the gap, J v + df/dt, as the forces alone would leave it, shape (k,) [m/s, rad/s]."""
        return self.rates[1]

    @property
    def after(self) -> Array:
        """Rate of the gap after the step, shape (k,) [m/s, rad/s]."""
        return self.rates[2]

    @property
    def before(self) -> Array:
        """Rate of the gap before the step, shape (k,) [m/s, rad/s]."""
        return self.rates[3]


def law(projector: Projector, v: Array, push: FreeMotion | TreeFreeMotion, rows: Rows) -> tuple[Array, Array, float]:
    """Return the velocity after the law (8), the rates of the rows, and the relative KKT residual.

    e acts on what the gap does: argmin |w - x|_M with J w + r >= -e (J v + r), r = df/dt.

    Parameters
    ----------
    projector : Projector
        Solves the projection.
    v : ndarray, shape (nv,)
        Velocity before.
    push : FreeMotion
        The velocity x as the forces alone would leave it, and M.
    rows : Rows
        The active constraints.
    """
    if rows.rate is None:
        return projector.law(v, push, rows.jacobian, rows.restitution, rows.constraint)
    x, before = push.free, rows.speeds(v)
    lower = -rows.restitution * before - rows.rate
    w, percussion, residual = projector.project(x, push.metric, rows.jacobian, lower, rows.constraint)
    return w, np.array([percussion, rows.speeds(x), rows.speeds(w), before]), residual


# in lengths of the scene a second, and rad/s; what approaches more slowly does not close
STILL = 1e-12


def closes(rates: Array, still: Array | float) -> Array:
    """Return of each row whether it presses and approaches faster than `still` and the forces of one step explain."""
    percussion, free, _, before = rates
    return np.asarray((percussion > 0.0) & (before + 2.0 * np.abs(free - before) < -still))


def still_rates(problem: Problem, numbers: Array) -> Array | float:
    """Return the rate of each row below which it does not close, shape (k,) or one for all [m/s, rad/s]."""
    return STILL * problem.length / problem.constraints.levers(numbers)


def advance_gaps(step: Step, time: float) -> Step:
    """Return the step with the gaps of its rows where its velocity carries them within a time, to first order."""
    return step._replace(active=step.active._replace(gap=step.active.gap + time * step.after))


def ended(system: System, state: Step, found: list[Step], t: float) -> tuple[list[Step], Step]:
    """Return the steps from a state up to a time, the last of them read on its straight way there.

    Parameters
    ----------
    system : System
        What moves.
    state : Step
        Where the first step starts.
    found : list of Step
        Steps of a scheme that moves with the velocity it leads to, the last of which ends at t or later.
    t : float
        Time [s].
    """
    k = next((k for k, step in enumerate(found) if step.t >= t), len(found) - 1)
    start, end = found[k - 1] if k else state, found[k]
    way = system.difference(start.q, end.q)
    q = system.integrate(start.q, min(1.0, (t - start.t) / (end.t - start.t)) * way)
    return found[:k], advance_gaps(end._replace(t=t, q=q), t - end.t)

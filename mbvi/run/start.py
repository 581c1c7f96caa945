"""The initial state of a run."""

from __future__ import annotations

import numpy as np

from ..constraints import Rows
from ..errors import InfeasibleError, ProjectionError
from ..problem import Problem
from ..projection import FreeMotion, Projector
from ..schemes import Step
from ..schemes.step import law
from ..system.system import Array

# steps leave parts of velocities that equalities do not allow, of the order of the step; what is more contradicts them
_LEFT = 1e-2
# velocities that are rounding, rad/s and lengths of the scene per second
_ROUNDING = 1e-12


def initial_step(problem: Problem, projector: Projector) -> Step:
    """Return the initial state, with the law (8) applied where v0 is not in T_K(q0) or opens a loop."""
    problem.system.start()
    return first_step(problem, projector)


def first_step(problem: Problem, projector: Projector) -> Step:
    """Return what `initial_step` does, of a system that has been started before."""
    problem.constraints.renew()
    # copies, because the problem's own arrays are read-only
    q, v = problem.q0.copy(), kept_velocity(problem, problem.q0, problem.v0).copy()
    active = problem.constraints.active(problem.t0, q, problem.tolerance)
    return admitted(problem, projector, q, v, active)


def kept_velocity(problem: Problem, q: Array, v: Array) -> Array:
    """Return v, shape (nv,), or the nearest velocity that keeps the equalities at q, where v opens them.

    What steps leave of velocities that equalities do not allow stays, so that runs can go on from any of their states.
    """
    kept = problem.system.tangent(q, v)
    opening = v - kept
    if np.abs(opening).max(initial=0.0) <= _ROUNDING * min(1.0, problem.length):
        return v
    metric = problem.system.metric(q)
    return kept if opening @ metric.apply(opening) > _LEFT**2 * (v @ metric.apply(v)) else v


def admitted(problem: Problem, projector: Projector, q: Array, v: Array, active: Rows) -> Step:
    """Return a state as the initial one of a run, given its active rows."""
    t = problem.t0
    if closes_none(active, v):
        before = active.speeds(v)
        return Step(t, q, v, active, np.array([np.zeros(len(before)), before, before, before]), 0.0)
    motion = FreeMotion(v, problem.system.metric(q))
    try:
        v, rates, residual, slip, active = law(projector, v, motion, active)
    except InfeasibleError:
        raise
    except ProjectionError:
        with projector.acceptance.second_bound():
            v, rates, residual, slip, active = law(projector, v, motion, active)
    return Step(t, q, v, active, rates, residual, slip)


def closes_none(rows: Rows, v: Array) -> bool:
    """Return whether no row closes at a velocity, shape (nv,), by more than rounding."""
    rounding = 1e-12 * (abs(rows.jacobian) @ np.abs(v))
    if rows.rate is not None:
        rounding += 1e-12 * np.abs(rows.rate)
    return bool((rows.speeds(v) >= -rounding).all())

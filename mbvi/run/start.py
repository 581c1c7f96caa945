"""The initial state of a run."""

from __future__ import annotations

import numpy as np

from ..problem import Problem
from ..projection import FreeMotion, Projector
from ..schemes import Step
from ..schemes.step import law


def initial_step(problem: Problem, projector: Projector) -> Step:
    """Return the initial state, with the law (8) applied where v0 is not in T_K(q0)."""
    problem.system.start()
    problem.constraints.renew()
    # copies, because the problem's own arrays are read-only
    t, q, v = problem.t0, problem.q0.copy(), problem.v0.copy()
    active = problem.constraints.active(t, q, problem.tolerance)
    before = active.speeds(v)
    rounding = 1e-12 * (abs(active.jacobian) @ np.abs(v))
    if active.rate is not None:
        rounding += 1e-12 * np.abs(active.rate)
    if (before >= -rounding).all():
        return Step(t, q, v, active, np.array([np.zeros(len(before)), before, before, before]), 0.0)
    v, rates, residual, slip, active = law(projector, v, FreeMotion(v, problem.system.metric(q)), active)
    return Step(t, q, v, active, rates, residual, slip)

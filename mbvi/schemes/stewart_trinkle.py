"""The scheme for piles: every pair within reach is kept apart at the end of the step."""

from __future__ import annotations

import numpy as np

from ..errors import InputError
from ..problem import Problem
from ..projection import Projector
from ..system.system import Array
from .step import Step

_NONE = np.zeros((4, 0))


class StewartTrinkle:
    """v_{i+1} = argmin |w - v_i - h M^-1 g|_M subject to J w >= -max(f, 0) / h, then q_{i+1} = q_i + h v_{i+1}."""

    jump = 0.0

    def step(self, problem: Problem, t: float, q: Array, v: Array, h: float, projector: Projector) -> Step:
        """Return the state at t + h; see `Scheme`."""
        system, end = problem.system, t + h
        push = system.push(t, q, v, h)
        speed = np.sqrt((push.free.reshape(-1, 3) ** 2).sum(axis=1)).max()
        rows = problem.constraints.near(end, q, 2.0 * h * speed)
        if not rows.gap.size:
            return Step(end, system.integrate(q, h * push.free), push.free, rows, _NONE, 0.0)
        J, lower = rows.jacobian, -np.maximum(rows.gap, 0.0) / h
        w, percussion, residual = projector.project(push.free, push.metric, J, lower, rows.constraint)
        rates = np.array([percussion, J @ push.free, J @ w, J @ v])
        gap = rows.gap + h * rates[2]
        return Step(end, system.integrate(q, h * w), w, rows._replace(gap=gap), rates, residual)

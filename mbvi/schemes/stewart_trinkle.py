"""The scheme for piles: whatever could meet within the step is kept apart at its end."""

from __future__ import annotations

import numpy as np

from ..constraints import Rows
from ..errors import UnsuitableError
from ..problem import Problem
from ..projection import Metric, Projector
from ..system.system import Array
from .step import Step

_NONE = np.zeros((4, 0))
# how often a step looks farther for what it has not seen
_MOST = 6


class StewartTrinkle:
    """Keep gaps open at the end of the step: J w >= -max(f, 0) / h for all that is within reach, then q + h w.

    v_{i+1} = argmin |w - v_i - h M^-1 g|_M subject to J w >= -max(f(q_i), 0) / h, with M, g, f and J at q_i, the rows
    those within reach; q_{i+1} = q_i + h v_{i+1} along the retraction. For e = 0.

    Notes
    -----
    Order 1; velocity level; e = 0 only. An impact ends on the constraint instead of up to h |v-| inside, for it is
    spread over two steps: the first comes to touch, the second takes the rest of the velocity; the record holds the
    first and its part of the percussion. Between spheres and half-spaces no gap gets smaller than its linearisation, so
    that the residual of the projection is all that penetrates; elsewhere it is the curvature over a step, of order h^2,
    and it adds up, for a depth once there stays. Reach is twice what the fastest body would move; where at the end
    something penetrates that was out of reach, the step is taken anew with a farther one. A step takes M, g and the
    gradients once, the gaps twice. Its projection has more rows than that of `Paoli`.
    D. Stewart and J. Trinkle, An implicit time-stepping scheme for rigid body dynamics with inelastic collisions and
    Coulomb friction (1996).
    """

    jump = 0.0

    def check(self, problem: Problem) -> None:
        """Raise `UnsuitableError` if some e is above 0; of a crowd of shapes `step` does, where two come near."""
        _check(problem.constraints.largest_restitution)

    def step(self, problem: Problem, t: float, q: Array, v: Array, h: float, projector: Projector) -> Step:
        """Return the state at t + h; see `Scheme`."""
        system, end = problem.system, t + h
        push = system.push(t, q, v, h)
        free, metric = push.free, push.metric
        reach = _reach(problem, q, h * free)
        for _ in range(_MOST):
            rows = problem.constraints.near(t + 0.5 * h, q, reach)
            if not rows.gap.size:
                step = Step(end, system.integrate(q, h * free), free, rows, _NONE, 0.0)
            else:
                step = _stepped(problem, rows, end, q, v, h, projector, free, metric)
            if np.isinf(reach) or not _missed(problem, step):
                break
            reach *= 2.0
        return step


def _stepped(
    problem: Problem,
    rows: Rows,
    end: float,
    q: Array,
    v: Array,
    h: float,
    projector: Projector,
    free: Array,
    metric: Metric,
) -> Step:
    """Return the step with the given rows."""
    _check(float(rows.restitution.max()))
    # walls that move were asked where they are half-way
    gap = rows.gap if rows.rate is None else rows.gap - 0.5 * h * rows.rate
    lower = -np.maximum(gap, 0.0) / h
    if rows.rate is not None:
        lower -= rows.rate
    w, percussion, residual = projector.project(free, metric, rows.jacobian, lower, rows.constraint)
    rates = np.array([percussion, rows.speeds(free), rows.speeds(w), rows.speeds(v)])
    rows = rows._replace(gap=gap + h * rates[2])
    return Step(end, problem.system.integrate(q, h * w), w, rows, rates, residual)


def _check(e: float) -> None:
    if e > 0.0:
        raise UnsuitableError(
            f"StewartTrinkle is for e = 0, and a contact here has e = {e:g}: take Paoli, MoreauJean or "
            "Centered, or set the restitution to 0"
        )


def _reach(problem: Problem, q: Array, moved: Array) -> float:
    """Return twice how far the fastest body would move, or infinity where there are no bodies to see."""
    system = problem.system
    bodies = np.arange(1, len(system.bodies))
    if not bodies.size:
        return np.inf
    shift = system.placements(system.integrate(q, moved), bodies) - system.placements(q, bodies)
    turned = np.sqrt((shift[:, :3] ** 2).sum(axis=(1, 2)))
    far = np.sqrt((shift[:, 3] ** 2).sum(axis=1)) + problem.length * turned
    return 2.0 * float(far.max()) + problem.tolerance


def _missed(problem: Problem, step: Step) -> bool:
    """Tell whether something that the step has no row for penetrates at its end."""
    there = problem.constraints.near(step.t, step.q, -problem.tolerance)
    return bool(there.gap.size) and not np.isin(there.constraint, step.active.constraint).all()

"""The scheme for piles: whatever could meet within the step is kept apart at its end."""

from __future__ import annotations

import numpy as np

from ..constraints import Rows
from ..constraints.active import chosen, stacked
from ..errors import ProjectionError, UnsuitableError
from ..problem import Problem
from ..projection import Projector, Push, TreePush
from ..system.system import Array
from .step import Step

_NONE = np.zeros((4, 0))
# how often a step looks for what it has no row for yet
_MOST = 6
# of the scene's length, the depth by which gradients that turned within the step may be off
_OFF = 1e-3


class StewartTrinkle:
    """Keep gaps open at the end of the step: J w >= -max(f, 0) / h for all that is within reach, then q + h w.

    v_{i+1} = argmin |w - v_i - h M^-1 g|_M subject to J w >= -max(f(q_i), 0) / h, with M, g, f and J at q_i, the rows
    those within reach; q_{i+1} = q_i + h v_{i+1} along the retraction or, where something has sunk in, q_i + h y, with
    y the same under J y >= -f / h: what pushes out is no velocity. For e = 0.

    Notes
    -----
    Order 1; velocity level; e = 0 only. An impact ends on the constraint instead of up to h |v-| inside, for it is
    spread over two steps: the first comes to touch, the second takes the rest of the velocity; the record holds the
    first and its part of the percussion. Reach is twice what the fastest body would move. Between spheres and
    half-spaces no gap gets smaller than its linearisation, so that the residual of the projection is all that
    penetrates; elsewhere gradients turn within a step: what penetrates at its end by more than 1e-3 of the scene's
    length, or was out of reach, gets a row as it is there and the step is taken anew, and the rest is pushed out in the
    next step. A step takes M, g and the gradients once, the gaps twice. Its projection has more rows than that of
    `Paoli`.
    D. Stewart and J. Trinkle, An implicit time-stepping scheme for rigid body dynamics with inelastic collisions and
    Coulomb friction (1996).
    """

    jump = 0.0

    def check(self, problem: Problem) -> None:
        """Raise `UnsuitableError` if some e is above 0; of a crowd of shapes `step` does, where two come near."""
        _check(problem.constraints.largest_restitution)

    def step(self, problem: Problem, t: float, q: Array, v: Array, h: float, projector: Projector) -> Step:
        """Return the state at t + h; see `Scheme`."""
        push = problem.system.push(t, q, v, h)
        # walls that move are asked where they are half-way
        rows = _back(problem.constraints.near(t + 0.5 * h, q, _reach(problem, q, h * push.free)), 0.5 * h)
        for _ in range(_MOST):
            step, way = _stepped(problem, rows, t + h, q, v, h, projector, push)
            deepest = min(-problem.tolerance, float(step.active.gap.min(initial=0.0)) - 1e-12 * problem.length)
            there = problem.constraints.near(step.t, step.q, deepest)
            unseen = ~np.isin(there.constraint, rows.constraint) | (there.gap < -_OFF * problem.length)
            if not unseen.any():
                break
            more = _back(chosen(there, unseen), h)
            rows = stacked([rows, more._replace(gap=more.gap - h * (more.jacobian @ way))])
        return _deepened(step, there) if there.gap.size else step


def _back(rows: Rows, time: float) -> Rows:
    """Return rows with the gaps that walls which move on their own left a time before."""
    return rows if rows.rate is None else rows._replace(gap=rows.gap - time * rows.rate)


def _stepped(
    problem: Problem, rows: Rows, end: float, q: Array, v: Array, h: float, projector: Projector, push: Push | TreePush
) -> tuple[Step, Array]:
    """Return the step with the given rows, their gaps at its start, and the velocity that leads to its end."""
    free, gap, system = push.free, rows.gap, problem.system
    if not gap.size:
        return Step(end, system.integrate(q, h * free), free, rows, _NONE, 0.0), free
    _check(float(rows.restitution.max()))
    still = 0.0 if rows.rate is None else rows.rate
    w, percussion, residual = projector.project(
        free, push.metric, rows.jacobian, -np.maximum(gap, 0.0) / h - still, rows.constraint
    )
    way = w
    if (gap < -problem.tolerance).any():
        try:
            way, _, off = projector.project(free, push.metric, rows.jacobian, -gap / h - still, rows.constraint)
            residual = max(residual, off)
        except ProjectionError:
            # what is jammed stays as deep as it is: that is in the record
            pass
    rates = np.array([percussion, rows.speeds(free), rows.speeds(w), rows.speeds(v)])
    rows = rows._replace(gap=gap + h * rows.speeds(way))
    return Step(end, system.integrate(q, h * way), w, rows, rates, residual), way


def _deepened(step: Step, there: Rows) -> Step:
    """Return the step with the gaps that were found at its end where these are deeper than its rows say."""
    rows = step.active
    order = np.argsort(rows.constraint, kind="stable")
    known = np.isin(there.constraint, rows.constraint)
    place = order[np.searchsorted(rows.constraint[order], there.constraint[known])]
    gap = rows.gap.copy()
    np.minimum.at(gap, place, there.gap[known])
    return step._replace(active=rows._replace(gap=gap))


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

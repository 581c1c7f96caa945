"""The scheme for piles: whatever could meet within the step is kept apart at its end."""

from __future__ import annotations

import numpy as np

from ..constraints import Rows
from ..constraints.rows import chosen, stacked
from ..errors import ProjectionError, UnsuitableError
from ..problem import Problem
from ..projection import FreeMotion, Projection, Projector, TreeFreeMotion
from ..system.system import Array
from .scheme import Scheme, Timing
from .step import Step

# how often a step looks for what it has no row for yet, or whose gradient has turned
_MOST = 6
# of the scene's length, the depth by which gradients that turned within the step may be off
_OFF = 1e-3


class StewartTrinkle(Scheme):
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
    next step. A step takes M and g once, and where nothing is taken anew the gradients once and the gaps twice. Its
    projection has more rows than that of `Paoli`.
    D. Stewart and J. Trinkle, An implicit time-stepping scheme for rigid body dynamics with inelastic collisions and
    Coulomb friction (1996).
    """

    timing = Timing(jump=0.0)

    def check(self, problem: Problem) -> None:
        """Raise `UnsuitableError` if some e is above 0; of a crowd of shapes `step` does, where two come near."""
        _check(problem.constraints.largest_restitution)

    def step(self, problem: Problem, t: float, q: Array, v: Array, h: float, projector: Projector) -> Step:
        """Return the state at t + h; see `Scheme`."""
        system, end = problem.system, t + h
        push = system.free_motion(t, q, v, h)
        # walls that move are asked where they are half-way
        rows = _back(problem.constraints.near(t + 0.5 * h, q, _reach(problem, q, h * push.free)), 0.5 * h)
        for turn in range(_MOST + 1):
            way, lifted = _way(problem, rows, h, projector, push)
            place, gap = system.integrate(q, h * way.velocity), rows.gap + h * rows.speeds(way.velocity)
            lever = problem.constraints.levers(rows.constraint)
            deepest = min(-problem.tolerance, float((lever * gap).min(initial=0.0)) - 1e-12 * problem.length)
            there = problem.constraints.near(end, place, deepest)
            sunk = problem.constraints.levers(there.constraint) * there.gap < -_OFF * problem.length
            unseen = ~_among(there.constraint, rows.constraint) | sunk
            if turn == _MOST or not unseen.any():
                break
            more = _back(chosen(there, unseen), h)
            rows = stacked([rows, more._replace(gap=more.gap - h * (more.jacobian @ way.velocity))])
        # what pushes out is no velocity
        w, percussion, residual = _kept_apart(rows, h, projector, push, 0.0) if lifted else way
        rates = np.array([percussion, rows.speeds(push.free), rows.speeds(w), rows.speeds(v)])
        rows = rows._replace(gap=_deepened(gap, rows, there))
        return Step(end, place, w, rows, rates, max(residual, way.residual))


def _back(rows: Rows, time: float) -> Rows:
    """Return rows with the gaps that walls which move on their own left a time before."""
    return rows if rows.rate is None else rows._replace(gap=rows.gap - time * rows.rate)


def _kept_apart(
    rows: Rows, h: float, projector: Projector, push: FreeMotion | TreeFreeMotion, most: float
) -> Projection:
    """Return the velocity that leaves every gap of the rows open after a step, or as deep as it is beyond `most`."""
    if not rows.gap.size:
        return Projection(push.free, np.zeros(0), 0.0)
    _check(float(rows.restitution.max()))
    lower = -np.maximum(rows.gap, -most) / h
    if rows.rate is not None:
        lower -= rows.rate
    return projector.project(push.free, push.metric, rows.jacobian, lower, rows.constraint)


def _way(
    problem: Problem, rows: Rows, h: float, projector: Projector, push: FreeMotion | TreeFreeMotion
) -> tuple[Projection, bool]:
    """Return the velocity that leads to the end of a step, and whether it pushes out what has sunk in."""
    if rows.gap.size and rows.gap.min() < -_unsolved(rows, h, projector, push) - problem.tolerance:
        try:
            return _kept_apart(rows, h, projector, push, np.inf), True
        except ProjectionError:
            # what is jammed stays as deep as it is: that is in the record
            pass
    return _kept_apart(rows, h, projector, push, 0.0), False


def _unsolved(rows: Rows, h: float, projector: Projector, push: FreeMotion | TreeFreeMotion) -> float:
    """Return how deep the residual of the projections lets things sink [m]: to push that out would solve all twice."""
    largest = float(np.abs(rows.speeds(push.free)).max()) + float(np.abs(rows.gap).max()) / h
    return 2.0 * h * projector.residual * largest


def _among(numbers: Array, known: Array) -> Array:
    """Tell which numbers are known: `np.isin` sorts both, and few are asked for."""
    if not known.size:
        return np.zeros(len(numbers), bool)
    ranked = np.sort(known, kind="stable")
    return np.asarray(ranked[np.searchsorted(ranked[:-1], numbers)] == numbers)


def _deepened(gap: Array, rows: Rows, there: Rows) -> Array:
    """Return the gaps of rows where these are not as deep as was found."""
    known = _among(there.constraint, rows.constraint)
    if not known.any():
        return gap
    order = np.argsort(rows.constraint, kind="stable")
    place = order[np.searchsorted(rows.constraint[order], there.constraint[known])]
    gap = gap.copy()
    np.minimum.at(gap, place, there.gap[known])
    return gap


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

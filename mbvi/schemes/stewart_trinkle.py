"""The scheme of D. Stewart and J. Trinkle for piles: gaps stay open at the end of the step."""

from __future__ import annotations

import numpy as np

from ..constraints import Rows
from ..constraints.rows import concatenate, take
from ..errors import ProjectionError, UnsuitableError
from ..problem import Problem
from ..projection import FreeMotion, Projection, Projector, TreeFreeMotion
from ..system.system import Array
from .scheme import Scheme, Timing
from .step import Step

# most retries of a step with added rows
_MOST_RETRIES = 6
# penetration at the end of a step above which it is retried, in lengths of the scene
_RETRY_DEPTH = 1e-3


class StewartTrinkle(Scheme):
    """Keep gaps open at the end of the step: J w >= -max(f, 0) / h for all pairs within reach, then q + h w.

    v_{i+1} = argmin |w - v_i - h M^-1 g|_M subject to J w >= -max(f(q_i), 0) / h, with M, g, f and J at q_i, for the
    rows within reach; q_{i+1} = q_i + h v_{i+1} along the retraction. Where a contact penetrates, q_{i+1} = q_i + h y
    instead, where y is the same projection under J y >= -f / h. The displacement that removes penetration thus does not
    enter the velocity. For e = 0.

    Notes
    -----
    Order 1; velocity level; e = 0 only. An impact ends on the constraint instead of up to h |v-| inside, because it is
    spread over two steps: the first closes the gap, the second removes the remaining velocity. The record holds the
    first and its part of the percussion. The reach is twice the displacement of the fastest body.

    Between spheres and half-spaces no gap gets smaller than its linearisation, so that only the residual of the
    projection penetrates. Elsewhere gradients change within a step. A contact that was out of reach, or that penetrates
    at the end of the step by more than 1e-3 of the scene's length, then gets a row as it is there, and the step is
    retried. Smaller penetration is removed in the next step.

    A step evaluates M and g once and, where it is not retried, the gradients once and the gaps twice. Its projection
    has more rows than that of `Paoli`.
    D. Stewart and J. Trinkle, An implicit time-stepping scheme for rigid body dynamics with inelastic collisions and
    Coulomb friction (1996).
    """

    timing = Timing(jump=0.0)
    accepts_depth = True

    def check(self, problem: Problem) -> None:
        """Raise `UnsuitableError` if some e is above 0; where pairs are listed only when near, `step` raises it."""
        _check(problem.constraints.largest_restitution)

    def step(self, problem: Problem, t: float, q: Array, v: Array, h: float, projector: Projector) -> Step:
        """Return the state at t + h; see `Scheme`."""
        system, end = problem.system, t + h
        free_motion = system.free_motion(t, q, v, h)
        # rows to walls with a prescribed motion are linearised in the middle of the step
        rows = _at_earlier_time(
            problem.constraints.active(t + 0.5 * h, q, _reach(problem, q, h * free_motion.free)), 0.5 * h
        )
        for retry in range(_MOST_RETRIES + 1):
            displacing, corrected = _end_velocity(problem, rows, h, projector, free_motion)
            place, gap = system.integrate(q, h * displacing.velocity), rows.gap + h * rows.speeds(displacing.velocity)
            lever = problem.constraints.levers(rows.constraint)
            # rows deeper at the end than every known row; penetration within the tolerance is left
            deepest = min(-problem.tolerance, float((lever * gap).min(initial=0.0)) - 1e-12 * problem.length)
            at_end = problem.constraints.active(end, place, deepest)
            deep = problem.constraints.levers(at_end.constraint) * at_end.gap < -_retry_depth(problem, projector)
            missed = ~_is_among(at_end.constraint, rows.constraint) | deep
            if retry == _MOST_RETRIES or not missed.any():
                break
            added = _at_earlier_time(take(at_end, missed), h)
            rows = concatenate([rows, added._replace(gap=added.gap - h * (added.jacobian @ displacing.velocity))])
        # the displacement that removes penetration does not enter the velocity
        w, percussion, residual = _open_gaps(rows, h, projector, free_motion, 0.0) if corrected else displacing
        rates = np.array([percussion, rows.speeds(free_motion.free), rows.speeds(w), rows.speeds(v)])
        rows = rows._replace(gap=_deeper_gaps(gap, rows, at_end))
        return Step(end, place, w, rows, rates, max(residual, displacing.residual))


def _at_earlier_time(rows: Rows, time: float) -> Rows:
    """Return rows with gaps less what the prescribed motion of walls adds to them in `time` [s]."""
    return rows if rows.rate is None else rows._replace(gap=rows.gap - time * rows.rate)


def _open_gaps(
    rows: Rows, h: float, projector: Projector, free_motion: FreeMotion | TreeFreeMotion, most: float
) -> Projection:
    """Return the velocity with which no gap of the rows is negative after a step.

    Of each penetration at most `most` is removed [m or rad].
    """
    if not rows.gap.size:
        return Projection(free_motion.free, np.zeros(0), 0.0)
    _check(float(rows.restitution.max()))
    lower = -np.maximum(rows.gap, -most) / h
    if rows.rate is not None:
        lower -= rows.rate
    return projector.project(free_motion.free, free_motion.metric, rows.jacobian, lower, rows.constraint, h)


def _end_velocity(
    problem: Problem, rows: Rows, h: float, projector: Projector, free_motion: FreeMotion | TreeFreeMotion
) -> tuple[Projection, bool]:
    """Return the velocity along which the configuration moves in a step, and whether it removes penetration."""
    if rows.gap.size and rows.gap.min() < -_residual_depth(rows, h, projector, free_motion) - problem.tolerance:
        try:
            return _open_gaps(rows, h, projector, free_motion, np.inf), True
        except ProjectionError:
            # where contacts contradict each other penetration remains, and the run records it
            pass
    return _open_gaps(rows, h, projector, free_motion, 0.0), False


def _residual_depth(rows: Rows, h: float, projector: Projector, free_motion: FreeMotion | TreeFreeMotion) -> float:
    """Return the penetration that the residual of a projection may leave [m].

    It is not removed, because that would cost a second projection in each step.
    """
    if projector.accepted is not None:
        return 0.5 * projector.accepted.depth
    largest = float(np.abs(rows.speeds(free_motion.free)).max()) + float(np.abs(rows.gap).max()) / h
    return 2.0 * h * projector.residual * largest


def _retry_depth(problem: Problem, projector: Projector) -> float:
    """Return the penetration at the end of a step above which it is retried [m]."""
    return _RETRY_DEPTH * problem.length if projector.accepted is None else projector.accepted.depth


def _is_among(numbers: Array, known: Array) -> Array:
    """Return which of `numbers` are among `known`; faster than `np.isin`, which sorts both arrays."""
    if not known.size:
        return np.zeros(len(numbers), bool)
    ranked = np.sort(known, kind="stable")
    return np.asarray(ranked[np.searchsorted(ranked[:-1], numbers)] == numbers)


def _deeper_gaps(gap: Array, rows: Rows, at_end: Rows) -> Array:
    """Return the gaps of rows, each lowered to that of its constraint in `at_end` where that is lower."""
    known = _is_among(at_end.constraint, rows.constraint)
    if not known.any():
        return gap
    order = np.argsort(rows.constraint, kind="stable")
    place = order[np.searchsorted(rows.constraint[order], at_end.constraint[known])]
    gap = gap.copy()
    np.minimum.at(gap, place, at_end.gap[known])
    return gap


def _check(e: float) -> None:
    if e > 0.0:
        raise UnsuitableError(
            f"StewartTrinkle is for e = 0, and a contact here has e = {e:g}: take Paoli, MoreauJean or "
            "Centered, or set the restitution to 0"
        )


def _reach(problem: Problem, q: Array, displacement: Array) -> float:
    """Return twice the largest displacement of a body, or infinity where the system names no bodies."""
    system = problem.system
    bodies = np.arange(1, len(system.bodies))
    if not bodies.size:
        return np.inf
    shift = system.placements(system.integrate(q, displacement), bodies) - system.placements(q, bodies)
    # a turn moves a point of a body by at most the change of its rotation matrix times the scene's length
    turned = np.sqrt((shift[:, :3] ** 2).sum(axis=(1, 2)))
    far = np.sqrt((shift[:, 3] ** 2).sum(axis=1)) + problem.length * turned
    return 2.0 * float(far.max()) + problem.tolerance

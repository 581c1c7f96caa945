"""The scheme of D. Stewart and J. Trinkle for piles: gaps stay open at the end of the step."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..compiled import plain_array
from ..constraints import Rows
from ..constraints.carried import Place, carried_along, with_mean_rates
from ..constraints.rows import concatenate, take
from ..errors import UnsuitableError
from ..problem import Problem
from ..projection import Projector
from ..projection.positions.travel import largest_of_parts, largest_of_rows
from ..system import Spheres
from ..system.system import Array
from .gap_bounds.open_gaps import bouncing_velocities, displacing_velocity, open_gaps
from .gap_bounds.reach import groups, largest_of_groups, parts_of_bodies, spread_reach
from .kernels.stewart_trinkle import RETRY_DEPTH, stewart_trinkle_step
from .positions.end_repair import near_rows, repair
from .row_projection import RowProjection, slip_rates
from .scheme import Scheme, Timing
from .step import Step

# most retries of a step with added rows
_MOST_RETRIES = 6
# depth to first order at the end, in allowed depths, from which on all contacts near the end are searched
_LIKELY = 1e-3


class StewartTrinkle(Scheme):
    """Keep gaps open at the end of the step: J w >= -max(f, 0) / h for all pairs within reach, then q + h w.

    v_{i+1} = argmin |w - v_i - h M^-1 g|_M subject to J w >= -max(f(q_i), 0) / h, with M, g, f and J at q_i, for the
    rows within reach; q_{i+1} = q_i + h v_{i+1} along the retraction. Where a contact penetrates, q_{i+1} = q_i + h y
    instead, where y is the same projection under J y >= -f / h. The displacement that removes penetration thus does not
    enter the velocity. Walls with a prescribed motion move with their mean velocities in the step.

    Where e > 0, a contact that v_i closes within the step has J w >= -e J v_i instead, and open contacts that v_i does
    not close have no bound (`newton_bounds`). If w would close one of these, q_{i+1} = q_i + h y with the y nearest to
    w under J y >= -f / h.

    Notes
    -----
    Order 1; velocity level; any e in [0, 1], one per constraint; several constraints at once by one projection, which
    never raises the kinetic energy. At e = 0 an impact ends on the constraint instead of up to h |v-| inside, because
    it is spread over two steps: the first closes the gap, the second removes the remaining velocity. The record holds
    the first and its part of the percussion. At e > 0 an impact comes up to a step early, and leaves a gap. The reach
    is twice the displacement of the fastest body that contacts within reach connect; among many bodies, of all.

    Between spheres and half-spaces no gap gets smaller than its linearisation, so that only the residual of the
    projection penetrates. Elsewhere gradients change within a step. A contact of a pair that was out of reach then gets
    a row as it is at the end of the step, and the step is retried. Among many bodies that turn, contacts deeper than
    allowed are pushed out at the end of the step, linearised there (`repair`). Otherwise such contacts get rows and the
    step is retried, and smaller penetration is removed in the next step. Allowed is the accepted depth of a run, or
    1e-3 of the scene's length where a residual is given.

    A step evaluates M and g once and, where it is not retried, the gradients once and the gaps twice. Its projection
    has more rows than that of `Paoli`; where a body that bounces meets a third one it needs two.
    D. Stewart and J. Trinkle, An implicit time-stepping scheme for rigid body dynamics with inelastic collisions and
    Coulomb friction (1996).
    """

    timing = Timing(jump=0.0)
    accepts_depth = True

    def check(self, problem: Problem) -> None:
        """Raise `UnsuitableError` if restitution is to be capped."""
        if problem.energy_cap:
            raise UnsuitableError("StewartTrinkle does not cap restitution: take Centered(project_positions=True)")

    @property
    def step_kernel(self) -> Any:
        """The kernel of the step of few bodies; see `Scheme`."""
        return stewart_trinkle_step

    def step(self, problem: Problem, t: float, q: Array, v: Array, h: float, projector: Projector) -> Step:
        """Return the state at t + h; see `Scheme`."""
        system, end = problem.system, t + h
        free_motion = system.free_motion(t, q, v, h)
        lengths = system.are_lengths()
        projector.begin(v[lengths], free_motion.free[lengths])
        rows = _rows_within_reach(problem, t, q, h * free_motion.free, h)
        # gradients of many turning bodies change within a step: contacts are then linearised again at its end
        turning = not isinstance(rows.jacobian, np.ndarray) and not lengths.all()
        allowed = RETRY_DEPTH * problem.length if projector.accepted is None else projector.accepted.depth
        velocity: RowProjection | None
        farthest, last = np.inf, None
        for retry in range(_MOST_RETRIES + 1):
            if rows.restitution.any():
                displacing, velocity = bouncing_velocities(
                    problem, rows, v, h, projector, free_motion, allowed * turning
                )
            elif turning:
                displacing = velocity = open_gaps(rows, h, projector, free_motion, 0.0)
            else:
                displacing, corrected = displacing_velocity(problem, rows, h, projector, free_motion)
                velocity = None if corrected else displacing
            moved = h * displacing.velocity
            if last is not None and problem.constraints.travel(moved) > farthest:
                # a row beside a point about which bodies turn would turn them round: the guard shortens such a step
                rows, displacing, velocity, place, gap, at_end = last
                break
            place, gap = system.integrate(q, moved), rows.gap + h * rows.speeds(displacing.velocity)
            lever = problem.constraints.levers(rows.constraint)
            # rows deeper at the end than every known row; penetration within the tolerance is left
            least = float((lever * gap).min(initial=0.0))
            deepest = min(-problem.tolerance, least - 1e-12 * problem.length)
            # gaps to first order that are negative may be far off
            heap = turning and least < -_LIKELY * allowed
            at_end = (
                near_rows(problem, end, place, allowed)
                if heap
                else _deeper_rows(problem, end, place, deepest, q, moved, rows, gap)
            )
            depth = _depths(problem, at_end)
            missed = ~_is_among(at_end.constraint, rows.constraint)
            missed = missed & (depth > problem.tolerance) if turning else missed | (depth > allowed)
            repaired = None
            if (retry == _MOST_RETRIES or not missed.any()) and (
                heap or (turning and depth.max(initial=0.0) > allowed)
            ):
                at_end = at_end if heap else near_rows(problem, end, place, allowed)
                repaired = repair(problem, end, place, at_end, free_motion.metric, projector, allowed)
                if _deepest(problem, repaired.rows) > allowed:
                    # the step itself must turn away from them
                    missed = _depths(problem, at_end) > allowed
            if retry == _MOST_RETRIES or not missed.any():
                break
            if last is None:
                farthest = 2.0 * (problem.constraints.travel(moved) + float(depth.max()))
            last = rows, displacing, velocity, place, gap, at_end
            # their points are where those of the other rows are
            added = _at_earlier_time(take(at_end, missed), h)
            added = carried_along(problem.constraints, added, Place(end, place), Place(t, q))
            rows = concatenate([rows, added._replace(gap=added.gap - h * (added.jacobian @ displacing.velocity))])
        if repaired is not None:
            place, moved, at_end = repaired
            # no gap is smaller than the least at the end
            gap = np.maximum(gap + rows.jacobian @ moved, min(0.0, -_deepest(problem, at_end)) / lever)
        if velocity is None:
            # the displacement that removes penetration does not enter the velocity
            velocity = open_gaps(rows, h, projector, free_motion, 0.0)
        w, percussion, residual, tangential = velocity
        rates = np.array([percussion, rows.speeds(free_motion.free), rows.speeds(w), rows.speeds(v)])
        rows = rows._replace(gap=_deeper_gaps(gap, rows, at_end))
        slip = slip_rates(rows, tangential, free_motion.free, w, v)
        return Step(end, place, w, rows, rates, max(residual, displacing.residual), slip)


def _depths(problem: Problem, rows: Rows) -> Array:
    """Return the depths of rows as lengths, shape (k,), negative where gaps are open [m]."""
    return np.asarray(-problem.constraints.levers(rows.constraint) * rows.gap)


def _deepest(problem: Problem, rows: Rows) -> float:
    return float(_depths(problem, rows).max(initial=0.0))


def _at_earlier_time(rows: Rows, time: float) -> Rows:
    """Return rows with gaps less what the prescribed motion of walls adds to them in `time` [s]."""
    return rows if rows.rate is None else rows._replace(gap=rows.gap - time * rows.rate)


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


def _rows_within_reach(problem: Problem, t: float, q: Array, displacement: Array, h: float) -> Rows:
    """Return the rows that a step may close, which begins at (t, q) with a free displacement, shape (nv,).

    Rows of many bodies, which are sparse, all have the reach of the fastest one.
    """
    part, reach = problem.constraints.part, _reaches(problem, q, displacement)
    constraints = problem.constraints
    rows = with_mean_rates(constraints, constraints.active(t, q, float(reach.max())), t, q, h)
    if not part[-1] or np.isinf(reach).any() or not isinstance(rows.jacobian, np.ndarray):
        return rows
    of_part, near = np.zeros(part[-1] + 1), np.empty(len(rows.gap), bool)
    np.maximum.at(of_part, parts_of_bodies(problem.system, part), reach)
    lengths = plain_array(problem.constraints.levers(rows.constraint) * rows.gap)
    return rows if spread_reach(plain_array(rows.jacobian), lengths, part, of_part, near) else take(rows, near)


def _deeper_rows(
    problem: Problem, t: float, q: Array, deepest: float, origin: Array, moved: Array, rows: Rows, gap: Array
) -> Rows:
    """Return the rows at (t, q) that are deeper than all known rows of their group.

    Parameters
    ----------
    t, q
        The end of the step.
    deepest : float
        The least gap of all known rows there, and less than what is left [m].
    origin, moved
        Where the step begins, and the displacement.
    rows : Rows
        The known rows.
    gap : ndarray, shape (k,)
        Their gaps at the end, to first order.
    """
    part = problem.constraints.part
    if not part[-1] or not isinstance(rows.jacobian, np.ndarray):
        return problem.constraints.active(t, q, deepest, origin, moved)
    found = problem.constraints.active(t, q, -problem.tolerance, origin, moved)
    if not len(found.gap):
        return found
    depth = largest_of_groups(-problem.constraints.levers(rows.constraint) * gap, groups(problem, rows))
    least = largest_of_parts(found.jacobian, part, largest_of_rows(rows.jacobian, part, depth))
    deeper = _depths(problem, found) >= least + 1e-12 * problem.length
    return found if deeper.all() else take(found, deeper)


def _reaches(problem: Problem, q: Array, displacement: Array) -> Array:
    """Return twice the displacement of each body, or infinity where the system names no bodies, shape (n,) [m]."""
    system = problem.system
    bodies = np.arange(1, len(system.bodies))
    if not bodies.size:
        return np.full(1, np.inf)
    if isinstance(system, Spheres):
        apart = displacement.reshape(len(bodies), -1)
        return 2.0 * np.sqrt((apart**2).sum(axis=1)) + problem.tolerance
    shift = system.placements(system.integrate(q, displacement), bodies) - system.placements(q, bodies)
    # a turn moves a point of a body by at most the change of its rotation matrix times the scene's length
    turned = np.sqrt((shift[:, :3] ** 2).sum(axis=(1, 2)))
    far = np.sqrt((shift[:, 3] ** 2).sum(axis=1)) + problem.length * turned
    return 2.0 * far + problem.tolerance

"""Projects closed contacts out of penetration, in the kinetic metric; contacts that bounce keep their penetration."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array, diags_array

from ..constraints import Rows
from ..constraints.rows import concatenate, match_contacts, take
from ..errors import ProjectionError
from ..problem import Problem
from ..projection import FreeMotion, Metric, Projector, TreeFreeMotion
from ..system import System
from ..system.system import Array
from .step import Step, advance_gaps, law

# most linearisations of the constraints within a step
_MOST_LINEARISATIONS = 20
# rows whose gap is below this part of the penetration take part in the projection
_NEARBY = 0.1
# two rows whose kinetic angle has a cosine below this are independent
_INDEPENDENT = 1e-9


class Applied(NamedTuple):
    """Where in a step of length h a scheme applied the impact law.

    Attributes
    ----------
    t : float
        When [s].
    q, v : ndarray, shapes (nq,) and (nv,)
        Configuration, and velocity before the law.
    h : float
        Length of the step [s].
    force_velocity : ndarray, shape (nv,)
        Velocity at which the forces were evaluated.
    """

    t: float
    q: Array
    v: Array
    h: float
    force_velocity: Array

    def free_motion(self, system: System) -> FreeMotion | TreeFreeMotion:
        """Return the free motion of v under the forces at `force_velocity`."""
        at = self.force_velocity
        free_motion = system.free_motion(self.t, self.q, at, self.h)
        return free_motion if at is self.v else free_motion.of(self.v, at)


class _Projected(NamedTuple):
    """A projected configuration.

    Attributes
    ----------
    q : ndarray, shape (nq,)
        The configuration.
    displacement : ndarray, shape (nv,)
        Tangent vector to it from the configuration before the projection.
    near : Rows
        The rows there that took part in the last projection.
    residual : float
        Relative KKT residual of that projection.
    """

    q: Array
    displacement: Array
    near: Rows
    residual: float


def project_positions(problem: Problem, applied: Applied, step: Step, projector: Projector) -> Step:
    """Return a step whose closed contacts are projected out of penetration, in the kinetic metric.

    A contact is closed if the velocity after the law changes its gap by no more than the activation tolerance in a
    step. A contact with e < 1 whose gap starts to rise is closed too if the gap is no larger after a whole step, as in
    sliding along a concave wall. A contact that is coupled to a bouncing one does not count as closed.

    The projection raises the gaps of closed contacts to zero. Any other gap that is negative gets no smaller, and one
    that is positive gets no smaller than zero. Rows that are active only after the projection join the law, and the law
    is applied again: otherwise a box at rest would tip from edge to edge. Finally the velocity is made tangent to the
    closed contacts at the projected configuration.

    Parameters
    ----------
    problem : Problem
        System and constraints.
    applied : Applied
        Where the law was applied.
    step : Step
        The step before position projection; its gaps are those where the law was applied.
    projector : Projector
        Solves the projections.

    Returns
    -------
    Step
        With the gaps of its end, to first order.

    Notes
    -----
    Positions are not projected in a step where 20 linearisations do not suffice, as between polyhedra whose nearest
    features change, or where contacts contradict each other. The run records that penetration.
    """
    system, drift = problem.system, step.t - applied.t
    for _ in range(_MOST_LINEARISATIONS):
        rows, closed = step.active, _closed(problem, applied, step)
        if not closed.any():
            break
        # where the law acts at the end of the step, the active rows there are those of the law
        before = problem.constraints.active(step.t, step.q, problem.tolerance) if drift else rows
        # for each row the row of the law at the same contact, -1 where there is none
        owner = match_contacts(before, rows)
        floor = np.where((owner >= 0) & closed[owner], 0.0, np.minimum(before.gap, 0.0))
        # the largest distance by which a closed contact must move out
        depth = float((problem.constraints.levers(before.constraint) * (floor - before.gap)).max(initial=0.0))
        if depth <= problem.tolerance:
            break
        projected = _projected(problem, step, before, floor, projector)
        if projected is None:
            break
        owner = match_contacts(projected.near, rows)
        if (owner >= 0).all():
            return _with_tangent_velocity(
                problem, applied, advance_gaps(step, drift), projected, owner, closed, projector
            )
        rows = concatenate([rows, take(projected.near, owner < 0)])
        w, rates, residual = _law(problem, applied, rows, projector)
        q = system.integrate(applied.q, drift * w) if drift else step.q
        step = Step(step.t, q, w, rows, rates, residual)
    return advance_gaps(step, drift)


def _law(problem: Problem, applied: Applied, rows: Rows, projector: Projector) -> tuple[Array, Array, float]:
    """Apply the law where the scheme applied it, with these rows."""
    return law(projector, applied.v, applied.free_motion(problem.system), rows)


def _with_tangent_velocity(
    problem: Problem,
    applied: Applied,
    step: Step,
    projected: _Projected,
    owner: Array,
    closed: Array,
    projector: Projector,
) -> Step:
    """Return the step at the projected configuration, with a velocity tangent to its closed contacts."""
    rows, near, unmatched = step.active, projected.near, np.ones(len(closed), bool)
    unmatched[owner] = False
    # the projection changed the gradients of closed contacts: that must not make them bounce
    near = near._replace(restitution=np.where(closed[owner], 0.0, near.restitution))
    rows = rows._replace(gap=rows.gap + rows.jacobian @ projected.displacement)
    rows = concatenate([near, take(rows, unmatched)]) if unmatched.any() else near
    free_motion = applied.free_motion(problem.system)
    free, before = free_motion.free, rows.speeds(applied.v)
    lower = -rows.restitution * before
    # a gap that the projection left open may close until the next law: otherwise its body would fall freely
    may_close = closed[owner] | (step.percussion[owner] == 0.0)
    opened = np.flatnonzero(may_close & (near.gap * problem.constraints.levers(near.constraint) > problem.tolerance))
    lower[opened] = -near.gap[opened] / (applied.h - (step.t - applied.t))
    if rows.rate is not None:
        lower -= rows.rate
    w, percussion, residual = projector.project(free, free_motion.metric, rows.jacobian, lower)
    rates = np.array([percussion, rows.speeds(free), rows.speeds(w), before])
    return Step(step.t, projected.q, w, rows, rates, max(residual, projected.residual))


def _closed(problem: Problem, applied: Applied, step: Step) -> Array:
    """Return which rows of the law are closed contacts, shape (k,); see `project_positions`."""
    rows, h = step.active, applied.h
    lever = problem.constraints.levers(rows.constraint)
    rise, gap = h * lever * step.after, lever * rows.gap
    closed = np.abs(rise) <= problem.tolerance
    # at e = 1 every contact that rises bounces
    rises = (rise > problem.tolerance) & (rows.restitution < 1.0)
    if rises.any():
        place = problem.system.integrate(applied.q, h * step.v)
        # the lowest gap of each contact after a whole step at the velocity after the law
        ahead = problem.constraints.active(applied.t + h, place, problem.tolerance)
        owner, lowest = match_contacts(ahead, rows), np.full(len(rise), np.inf)
        known = owner >= 0
        np.minimum.at(lowest, owner[known], ahead.gap[known])
        closed |= rises & (lever * lowest <= gap + problem.tolerance)
    if closed.any() and not closed.all():
        # to project a contact of a body that bounces at another contact would make the body rock
        metric, J = problem.system.metric(applied.q), rows.jacobian
        bounces = ~closed & ((step.percussion > 0.0) | (gap < -problem.tolerance))
        closed[closed] = ~_coupled(metric, J, closed, bounces)
    return closed


def _coupled(metric: Metric, J: Array | csr_array, some: Array, others: Array) -> Array:
    """Return which of the rows `some` are coupled to any of the rows `others` in the kinetic metric, shape (k,).

    Both are masks of the rows of J; k is the number of rows in `some`.
    """
    if isinstance(J, np.ndarray):
        lengths = np.sqrt(np.vecdot(J, metric.solve_rows(J)))
        cosines = np.abs(J[some] @ metric.solve_rows(J[others]).T)
        return np.asarray((cosines > _INDEPENDENT * lengths[some][:, None] * lengths[others]).any(axis=1))
    U = metric.whiten_rows(J)
    lengths = np.sqrt((U * U).sum(axis=1))
    unit = diags_array(1.0 / np.where(lengths > 0.0, lengths, 1.0)) @ U
    # nonzero only for rows on the same bodies
    cosines = abs(unit[some] @ unit[others].T).tocoo()
    found = np.zeros(int(some.sum()), bool)
    found[cosines.coords[0][cosines.data > _INDEPENDENT]] = True
    return found


def _projected(problem: Problem, step: Step, before: Rows, floor: Array, projector: Projector) -> _Projected | None:
    """Return the nearest configuration in which no gap is below its lower bound; None if the iteration fails.

    Parameters
    ----------
    step : Step
        The step at whose configuration the projection starts.
    before : Rows
        The active rows there.
    floor : ndarray, shape (k,)
        Lower bounds of their gaps; that of rows that become active during the projection is 0.

    Notes
    -----
    All near rows are linearised again at the configuration of the last projection. The iteration ends when the gaps of
    all rows with a positive percussion equal their lower bounds to within the activation tolerance. Equality matters: a
    contact whose gap remained open would not be active, and its body would fall.
    """
    system, tolerance = problem.system, problem.tolerance
    metric, still = system.metric(step.q), np.zeros(system.nv)
    depth = float((problem.constraints.levers(before.constraint) * (floor - before.gap)).max())
    place, moved, near, bound = step.q, still, before, floor
    for _ in range(_MOST_LINEARISATIONS):
        lower = near.jacobian @ moved + bound - near.gap
        last = moved
        try:
            moved, percussion, residual = projector.project(still, metric, near.jacobian, lower)
        except ProjectionError:
            return None
        lever = problem.constraints.levers(near.constraint)
        done = (lever * np.abs(near.jacobian @ (moved - last)) <= tolerance)[percussion > 0.0].all()
        if done and (lever * (near.gap - bound) >= -tolerance).all():
            return _Projected(place, last, near, residual)
        place = system.integrate(step.q, moved)
        near = problem.constraints.active(step.t, place, tolerance + _NEARBY * depth)
        owner = match_contacts(near, before)
        bound = np.where(owner >= 0, floor[owner], 0.0)
    return None

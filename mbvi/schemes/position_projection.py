"""Lifts closed contacts out of each other: projects positions, never of bounces, onto all constraints that are near."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array, diags_array

from ..constraints import Rows
from ..constraints.rows import chosen, owners, stacked
from ..errors import ProjectionError
from ..problem import Problem
from ..projection import FreeMotion, Metric, Projector, TreeFreeMotion
from ..system import System
from ..system.system import Array
from .step import Step, advance_gaps, law

# linearisations of the constraints within a step
_MOST = 20
# of the depth that is repaired; what is nearer than that is near
_NEAR = 0.1
# cosines of kinetic angles below this: two rows do not see each other
_UNRELATED = 1e-9


class Applied(NamedTuple):
    """When and where a scheme applied the law in a step of length h, the velocity before, and that of the forces."""

    t: float
    q: Array
    v: Array
    h: float
    at: Array

    def free_motion(self, system: System) -> FreeMotion | TreeFreeMotion:
        """Return what the forces at the velocity `at` do to v."""
        push = system.free_motion(self.t, self.q, self.at, self.h)
        return push if self.at is self.v else push.of(self.v, self.at)


class _Lifted(NamedTuple):
    """Where a projection of positions leads: the configuration, the way to it, and the rows that are near there."""

    q: Array
    moved: Array
    near: Rows
    residual: float


def settled(problem: Problem, applied: Applied, step: Step, projector: Projector) -> Step:
    """Return a step with its closed contacts lifted out of each other, in the kinetic metric.

    Closed is a row that, with its velocity after the law, rises by no more than the activation tolerance within a step,
    or for 0 < e < 1 is as deep at its end on a concave wall, which is how sliding looks there; and that sees no row
    that is not closed. All others may go no deeper: bounces keep the depth they have, and what is near keeps out. What
    is near once lifted joins the law, or a box at rest would tip from edge to edge for ever; the velocity is made
    tangent to closed contacts where they then are.

    Parameters
    ----------
    problem : Problem
        What moves.
    applied : Applied
        The law of the step.
    step : Step
        The step without this, its gaps those where the law was applied.
    projector : Projector
        Solves the projections.

    Returns
    -------
    Step
        With the gaps of its end, to first order.

    Notes
    -----
    Nothing is lifted in a step where 20 linearisations do not suffice, as between polyhedra whose nearest features
    change, or where contacts contradict each other: that penetration is in the record.
    """
    system, drift = problem.system, step.t - applied.t
    for _ in range(_MOST):
        rows, closed = step.active, _closed(problem, applied, step)
        if not closed.any():
            break
        # with no drift since, these are the rows of the law themselves
        before = problem.constraints.active(step.t, step.q, problem.tolerance) if drift else rows
        owner = owners(before, rows)
        floor = np.where((owner >= 0) & closed[owner], 0.0, np.minimum(before.gap, 0.0))
        depth = float((problem.constraints.levers(before.constraint) * (floor - before.gap)).max(initial=0.0))
        if depth <= problem.tolerance:
            break
        lifted = _lifted(problem, step, before, floor, projector)
        if lifted is None:
            break
        owner = owners(lifted.near, rows)
        if (owner >= 0).all():
            return _tangent(problem, applied, advance_gaps(step, drift), lifted, owner, closed, projector)
        rows = stacked([rows, chosen(lifted.near, owner < 0)])
        w, rates, residual = _law(problem, applied, rows, projector)
        q = system.integrate(applied.q, drift * w) if drift else step.q
        step = Step(step.t, q, w, rows, rates, residual)
    return advance_gaps(step, drift)


def _law(problem: Problem, applied: Applied, rows: Rows, projector: Projector) -> tuple[Array, Array, float]:
    return law(projector, applied.v, applied.free_motion(problem.system), rows)


def _tangent(
    problem: Problem, applied: Applied, step: Step, lifted: _Lifted, owner: Array, closed: Array, projector: Projector
) -> Step:
    """Return the step at the lifted configuration, its velocity along the closed contacts as they are there."""
    rows, near, left = step.active, lifted.near, np.ones(len(closed), bool)
    left[owner] = False
    # what is closed does not bounce off what its own lifting turned
    near = near._replace(restitution=np.where(closed[owner], 0.0, near.restitution))
    rows = rows._replace(gap=rows.gap + rows.jacobian @ lifted.moved)
    rows = stacked([near, chosen(rows, left)]) if left.any() else near
    push = applied.free_motion(problem.system)
    free, before = push.free, rows.speeds(applied.v)
    lower = -rows.restitution * before
    # what hovers closes until the law is applied next, lest it fall
    idle = closed[owner] | (step.percussion[owner] == 0.0)
    hovers = np.flatnonzero(idle & (near.gap * problem.constraints.levers(near.constraint) > problem.tolerance))
    lower[hovers] = -near.gap[hovers] / (applied.h - (step.t - applied.t))
    if rows.rate is not None:
        lower -= rows.rate
    w, percussion, residual = projector.project(free, push.metric, rows.jacobian, lower)
    rates = np.array([percussion, rows.speeds(free), rows.speeds(w), before])
    return Step(step.t, lifted.q, w, rows, rates, max(residual, lifted.residual))


def _closed(problem: Problem, applied: Applied, step: Step) -> Array:
    """Return which rows of the law are closed contacts, shape (k,)."""
    rows, h = step.active, applied.h
    lever = problem.constraints.levers(rows.constraint)
    rise, gap = h * lever * step.after, lever * rows.gap
    closed = np.abs(rise) <= problem.tolerance
    # where nothing is ever lost, a hop is a bounce
    hops = (rise > problem.tolerance) & (rows.restitution < 1.0)
    if hops.any():
        place = problem.system.integrate(applied.q, h * step.v)
        then = problem.constraints.active(applied.t + h, place, problem.tolerance)
        owner, lowest = owners(then, rows), np.full(len(rise), np.inf)
        known = owner >= 0
        np.minimum.at(lowest, owner[known], then.gap[known])
        closed |= hops & (lever * lowest <= gap + problem.tolerance)
    if closed.any() and not closed.all():
        # to lift one side of what still bounces at another would set it rocking
        metric, J = problem.system.metric(applied.q), rows.jacobian
        bounces = ~closed & ((step.percussion > 0.0) | (gap < -problem.tolerance))
        closed[closed] = ~_seen(metric, J, closed, bounces)
    return closed


def _seen(metric: Metric, J: Array | csr_array, some: Array, others: Array) -> Array:
    """Return which of some rows see any of the others in the kinetic metric, shape (k,)."""
    if isinstance(J, np.ndarray):
        lengths = np.sqrt(np.vecdot(J, metric.solve_rows(J)))
        cosines = np.abs(J[some] @ metric.solve_rows(J[others]).T)
        return np.asarray((cosines > _UNRELATED * lengths[some][:, None] * lengths[others]).any(axis=1))
    U = metric.whiten_rows(J)
    lengths = np.sqrt((U * U).sum(axis=1))
    unit = diags_array(1.0 / np.where(lengths > 0.0, lengths, 1.0)) @ U
    # as many numbers as there are rows that touch the same bodies
    cosines = abs(unit[some] @ unit[others].T).tocoo()
    found = np.zeros(int(some.sum()), bool)
    found[cosines.coords[0][cosines.data > _UNRELATED]] = True
    return found


def _lifted(problem: Problem, step: Step, before: Rows, floor: Array, projector: Projector) -> _Lifted | None:
    """Return the nearest configuration in which no row is below its floor, None where there is none to be found.

    Parameters
    ----------
    step : Step
        Where to start from.
    before : Rows
        The active rows there.
    floor : ndarray, shape (k,)
        The gaps these must have; of rows that become active on the way it is 0.

    Notes
    -----
    All near rows are linearised anew where the last projection led: what presses ends at its floor to within the
    tolerance from both sides, for what hovers is not active and would fall.
    """
    system, tolerance = problem.system, problem.tolerance
    metric, still = system.metric(step.q), np.zeros(system.nv)
    depth = float((problem.constraints.levers(before.constraint) * (floor - before.gap)).max())
    place, moved, near, asked = step.q, still, before, floor
    for _ in range(_MOST):
        lower = near.jacobian @ moved + asked - near.gap
        last = moved
        try:
            moved, percussion, residual = projector.project(still, metric, near.jacobian, lower)
        except ProjectionError:
            return None
        lever = problem.constraints.levers(near.constraint)
        done = (lever * np.abs(near.jacobian @ (moved - last)) <= tolerance)[percussion > 0.0].all()
        if done and (lever * (near.gap - asked) >= -tolerance).all():
            return _Lifted(place, last, near, residual)
        place = system.integrate(step.q, moved)
        near = problem.constraints.near(step.t, place, tolerance + _NEAR * depth)
        owner = owners(near, before)
        asked = np.where(owner >= 0, floor[owner], 0.0)
    return None

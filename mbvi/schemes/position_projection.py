"""Projects closed contacts out of penetration, in the kinetic metric; contacts that bounce keep their penetration."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array, diags_array
from scipy.sparse.csgraph import connected_components

from ..constraints import Rows
from ..constraints.rows import concatenate, match_contacts, take
from ..errors import ProjectionError
from ..problem import Problem
from ..projection import FreeMotion, LinearGaps, Metric, Projector, TreeFreeMotion
from ..projection.held_rows import FARTHEST, HARDLY
from ..projection.raise_gaps import MOST_LINEARISATIONS, NEARBY
from ..system.system import Array
from .nearby_rows import NearbyRows
from .row_projection import project_rows, slip_rates
from .step import Step, advance_gaps, closing_speeds

# two rows whose kinetic angle has a cosine below this are independent
_INDEPENDENT = 1e-9
# squares of lengths below this part of the largest are rounding
_DEPENDENT = 1e-12
# a contact moves within a step by less than this part of the scene's length
_SAME_CONTACT = 0.1


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
    motion : FreeMotion or TreeFreeMotion
        Free motion of v.
    opened : ndarray, shape (k,), or None
        Speeds at which rows of the law that are open may close.
    """

    t: float
    q: Array
    v: Array
    h: float
    motion: FreeMotion | TreeFreeMotion
    opened: Array | None = None


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


def project_positions(problem: Problem, applied: Applied, step: Step, projector: Projector, nearby: NearbyRows) -> Step:
    """Return a step whose closed contacts are projected out of penetration, in the kinetic metric.

    A contact is closed if the velocity after the law changes its gap by no more than the activation tolerance in a
    step, or if it bears load and lands within the step. A contact with e < 1 whose gap starts to rise is closed too if
    the gap is no larger after a whole step, as in sliding along a concave wall. So is a contact that would stay in
    penetration: without restitution each one that is there, with restitution one that hardly moves, unless an impact of
    this step has brought it there. A contact that is coupled to a bouncing one does not
    count as closed, unless it would stay in penetration.

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
    nearby : NearbyRows
        The rows at the end of the step, as far as they are known.

    Returns
    -------
    Step
        With the gaps of its end, to first order.

    Notes
    -----
    Linearisations alternate where the nearest features of polyhedra change. The last 10 of 20 therefore add to each
    other, and may leave contacts open that were raised before. Where these do not suffice either, or where contacts
    contradict each other, other mechanisms and bodies are projected, and the joint limits. Nothing is where the law
    that follows is not solved. The run records the penetration that stays.
    """
    settled = _settled(problem, applied, step, projector, nearby)
    if settled is not None:
        return settled
    system, drift = problem.system, step.t - applied.t
    if step.slip is not None and not _may_sink(problem, step, drift, nearby):
        return advance_gaps(step, drift)
    slack = np.zeros(len(step.active.gap)) if applied.opened is None else applied.opened
    for _ in range(MOST_LINEARISATIONS):
        rows, closed = step.active, _closed(problem, applied, step)
        if not _bears_or_sinks(problem, step, drift):
            break
        # where the law acts at the end of the step, the active rows there are those of the law
        before = nearby.at(step.q) if drift else rows
        # for each row the row of the law at the same contact, -1 where there is none
        owner = match_contacts(before, rows)
        lengths = problem.constraints.levers(before.constraint) * before.gap
        # bounds below zero by no more than the tolerance stay: they would contradict each other by their rounding
        sunk = (owner >= 0) & closed[owner] & (lengths < -problem.tolerance)
        sunk |= _stays_sunk(problem, applied, before, before.speeds(step.v), before.speeds(applied.v))
        floor = np.where(sunk, 0.0, np.minimum(before.gap, 0.0))
        # the largest distance by which a closed contact must move out
        depth = -float(lengths[sunk].min(initial=0.0))
        if depth <= problem.tolerance:
            break
        sticking = _sticking(problem, applied, step)
        start = problem, applied, step, before, floor, depth, projector, nearby
        projected = _projected(*start, sticking)
        if projected is None and sticking is not None:
            # a body that landed tilted cannot turn about contacts that are all held
            projected = _projected(*start, None)
        if projected is None:
            projected = _projected_apart(*start)
        if projected is None:
            break
        owner = match_contacts(projected.near, rows)
        if (owner >= 0).all():
            try:
                return _with_tangent_velocity(
                    problem, applied, advance_gaps(step, drift), projected, owner, closed, projector
                )
            except ProjectionError:
                break
        joined = take(projected.near, owner < 0)
        rows = concatenate([rows, joined])
        # a row that was open where the law acts may close by the end of the step: otherwise it would bear load there
        opened = np.zeros(len(joined.gap))
        if drift:
            moved = drift * step.v + projected.displacement
            opened = np.maximum(joined.gap - joined.jacobian @ moved, 0.0) / drift
            rows = rows._replace(gap=np.concatenate([step.active.gap, drift * opened]))
        slack = np.concatenate([slack, opened])
        lower = np.minimum(-rows.restitution * rows.speeds(applied.v), -slack)
        try:
            step = _with_bounds(applied, step, rows, lower, projector)
        except ProjectionError:
            # the law is solved for the rows before
            break
        if drift:
            step = step._replace(q=system.integrate(applied.q, drift * step.v))
    return advance_gaps(step, drift)


def _may_sink(problem: Problem, step: Step, drift: float, nearby: NearbyRows) -> bool:
    """Return whether a gap at the end of the step may be below zero by more than the tolerance."""
    if drift:
        return nearby.sinks(step.q)
    rows = step.active
    lengths = problem.constraints.levers(rows.constraint) * rows.gap
    return bool(lengths.min(initial=0.0) < -problem.tolerance)


def _settled(problem: Problem, applied: Applied, step: Step, projector: Projector, nearby: NearbyRows) -> Step | None:
    """Return the same step from one kernel, or None where gaps are not linear or a contact bounces."""
    known, drift = nearby.known(step.active), step.t - applied.t
    if known is None or not drift or known.rows.rate is not None or not isinstance(known.rows.jacobian, np.ndarray):
        return None
    if known.rows.tangents is not None:
        return None
    number, gap, J, e, point, *_ = rows = known.rows
    lever, opened = np.ones(len(gap)) * problem.constraints.levers(number), np.zeros(len(gap))
    if applied.opened is not None:
        opened[known.near] = applied.opened
    displacement = problem.system.difference(known.q, step.q)
    squares, tolerance = problem.constraints.cache.squares, problem.tolerance
    gaps = LinearGaps(
        number,
        point,
        J,
        gap,
        lever,
        e,
        opened,
        squares,
        applied.v,
        applied.h,
        drift,
        tolerance,
        known.reach,
        known.margin,
    )
    found = projector.settle(applied.motion, gaps, step.v, displacement, known.near, step.rates)
    if found is None:
        return None
    rows, rates = rows._replace(gap=found.gap, restitution=found.e), found.rates
    if not found.law.all():
        rows, rates = take(rows, found.law), rates.compress(found.law, 1)
    q = step.q
    if not np.array_equal(found.law, known.near):
        q = problem.system.integrate(applied.q, drift * found.w)
    if found.moved is None:
        residual = step.residual if found.residual < 0.0 else found.residual
        return Step(step.t, q, found.w, rows, rates, residual)
    return Step(step.t, problem.system.integrate(q, found.moved), found.tangent, rows, rates, found.residual)


def _with_bounds(applied: Applied, step: Step, rows: Rows, lower: Array, projector: Projector) -> Step:
    """Return the step with the velocity that the law gives under other lower bounds of the rates of gaps."""
    free = applied.motion.free
    if rows.rate is not None:
        lower = lower - rows.rate
    w, percussion, residual, tangential = project_rows(projector, free, applied.motion.metric, rows, lower)
    rates = np.array([percussion, rows.speeds(free), rows.speeds(w), rows.speeds(applied.v)])
    return Step(step.t, step.q, w, rows, rates, residual, slip_rates(rows, tangential, free, w, applied.v))


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
    lower = -rows.restitution * rows.speeds(applied.v)
    # a gap that the projection left open may close until the next law: otherwise its body would fall freely
    may_close = closed[owner] | (step.percussion[owner] == 0.0)
    # a contact that bounces leaves by Newton's law
    unmatched_stays = closed[unmatched] | (step.percussion[unmatched] == 0.0)
    stays = np.concatenate([may_close, unmatched_stays])
    opened = np.flatnonzero(may_close & (near.gap * problem.constraints.levers(near.constraint) > problem.tolerance))
    rest = applied.h - (step.t - applied.t)
    lower[opened] = -near.gap[opened] / rest
    may_open = closing_speeds(problem, rows, rest)
    if may_open is not None:
        lower = np.where(stays & (may_open > 0.0), np.minimum(lower, -may_open), lower)
    step = _with_bounds(applied, step, rows, lower, projector)
    return step._replace(q=projected.q, residual=max(step.residual, projected.residual))


def _closed(problem: Problem, applied: Applied, step: Step) -> Array:
    """Return which rows of the law are closed contacts, shape (k,); see `project_positions`."""
    rows, h = step.active, applied.h
    lever = problem.constraints.levers(rows.constraint)
    rise = h * lever * step.after
    # one that bears load and closes lands within the step
    closed = (np.abs(rise) <= problem.tolerance) | ((rise < 0.0) & (step.percussion > 0.0))
    sunk = _stays_sunk(problem, applied, advance_gaps(step, step.t - applied.t).active, step.after, step.before)
    closed |= sunk
    if not rows.restitution.any():
        # without restitution a contact bears load and does not rise, or it leaves
        return np.asarray(closed)
    gap = lever * rows.gap
    # at e = 1 every contact that rises bounces
    rises = (rise > problem.tolerance) & (rows.restitution < 1.0) & (step.percussion > 0.0)
    if rises.any():
        place = problem.system.integrate(applied.q, h * step.v)
        # the lowest gap of each contact after a whole step at the velocity after the law
        ahead = problem.constraints.active(applied.t + h, place, problem.tolerance)
        owner, lowest = match_contacts(ahead, rows), np.full(len(rise), np.inf)
        # not another contact of the same pair, such as the edge of a box that sinks while the other rises
        apart = np.linalg.norm(ahead.point - rows.point[owner], axis=1)
        known = (owner >= 0) & ~(apart > _SAME_CONTACT * problem.length)
        np.minimum.at(lowest, owner[known], ahead.gap[known])
        closed |= rises & (lever * lowest <= gap + problem.tolerance)
    if closed.any() and not closed.all():
        # to project a contact of a body that bounces at another contact would make the body rock
        metric, J = applied.motion.metric, rows.jacobian
        bounces = ~closed & ((step.percussion > 0.0) | (gap < -problem.tolerance))
        # but one that stays sunk would do so as long as the body bounces
        landed = closed & ~sunk
        if bounces.any() and landed.any():
            closed[landed] = ~_coupled(metric, J, landed, bounces)
    return closed


def _stays_sunk(problem: Problem, applied: Applied, rows: Rows, after: Array, before: Array) -> Array:
    """Return which rows at the end of a step stay in penetration, shape (k,); see the kernel `stays_sunk`.

    `after` and `before`, shape (k,), are the rates of their gaps after and before the law.
    """
    lever, e, tolerance = problem.constraints.levers(rows.constraint), rows.restitution, problem.tolerance
    depth, rise, fall = -lever * rows.gap, applied.h * lever * after, applied.h * lever * before
    still = (2.0 * np.abs(rise) < depth) & (depth > -fall)
    return np.asarray((depth > tolerance) & (e < 1.0) & ((e == 0.0) | still))


def _bears_or_sinks(problem: Problem, step: Step, drift: float) -> bool:
    """Return whether a row of the law bears load, or is below zero by more than the tolerance after a drift [s]."""
    rows = step.active
    lengths = problem.constraints.levers(rows.constraint) * (rows.gap + drift * step.after)
    return bool((step.percussion > 0.0).any() or lengths.min(initial=0.0) < -problem.tolerance)


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


def _projected(
    problem: Problem,
    applied: Applied,
    step: Step,
    before: Rows,
    floor: Array,
    depth: float,
    projector: Projector,
    nearby: NearbyRows,
    sticking: Array | None,
) -> _Projected | None:
    """Return the nearest configuration in which no gap is below its lower bound; None if the iteration fails.

    Parameters
    ----------
    step : Step
        The step at whose configuration the projection starts.
    before : Rows
        The active rows there.
    floor : ndarray, shape (k,)
        Lower bounds of their gaps; that of rows that become active during the projection is 0.
    depth : float
        The largest distance by which a gap must rise [m].
    nearby : NearbyRows
        The rows at the end of the step, as far as they are known.
    sticking : ndarray of bool, shape (n,), or None
        Rows of the law that are held along their tangents.

    Notes
    -----
    The rows are taken again at the configuration of each projection. The iteration ends when no gap there is below its
    lower bound, and those of all rows with a positive percussion equal it, to within the activation tolerance.
    Equality matters: a contact whose gap remained open would not be active, and its body would fall.
    """
    system, tolerance = problem.system, problem.tolerance
    moved = still = np.zeros(system.nv)
    near, bound, metric = before, floor, applied.motion.metric
    for i in range(MOST_LINEARISATIONS):
        J = near.jacobian if sticking is None else _held(metric, near, sticking, match_contacts(near, step.active))
        lower = near.jacobian @ moved + bound - near.gap
        # where linearisations alternate, each of the others adds to the displacement before
        origin = still if 2 * i < MOST_LINEARISATIONS else moved
        try:
            moved, percussion, residual = projector.project(origin, metric, J, lower)
        except ProjectionError:
            return None
        if sticking is not None and not _raises(metric, near.jacobian, moved, lower, tolerance):
            return None
        place, last = system.integrate(step.q, moved), near
        near = nearby.at(place, NEARBY * depth)
        owner, pushed = match_contacts(near, before), match_contacts(near, last)
        bound = np.where(owner >= 0, floor[owner], 0.0)
        excess = problem.constraints.levers(near.constraint) * (near.gap - bound)
        pushed = (pushed >= 0) & (percussion[pushed] > 0.0)
        if (excess >= -tolerance).all() and (excess[pushed] <= tolerance).all():
            return _Projected(place, moved, near, residual)
    return None


def _projected_apart(
    problem: Problem,
    applied: Applied,
    step: Step,
    before: Rows,
    floor: Array,
    depth: float,
    projector: Projector,
    nearby: NearbyRows,
) -> _Projected | None:
    """Project those independent groups of rows that can be projected, and of others the joint limits.

    The arguments are those of `_projected`, which has failed for all rows together. None if nothing can be projected.
    """
    kept, limits = np.minimum(before.gap, 0.0), np.isnan(before.point).any(axis=1)
    moved, residual, raised, some = np.zeros(problem.system.nv), 0.0, floor > kept, False
    for group in _independent_groups(problem, before):
        # all raised rows together have failed
        together = not raised[~group].any()
        for rows in (group & limits,) if together else (group, group & limits):
            if not raised[rows].any() or (together and not raised[group & ~limits].any()):
                continue
            part = np.where(rows, floor, kept)
            found = _projected(problem, applied, step, before, part, depth, projector, nearby, None)
            if found is not None:
                moved, residual, some = moved + found.displacement, max(residual, found.residual), True
                break
    if not some:
        return None
    place = problem.system.integrate(step.q, moved)
    return _Projected(place, moved, nearby.at(place, NEARBY * depth), residual)


def _independent_groups(problem: Problem, rows: Rows) -> list[Array]:
    """Return masks of rows, shape (k,), that act on mechanisms and free bodies on which no other rows act."""
    parts, count = [], 0
    for part, *_ in problem.system.located_parts():
        bodies = part.independent_bodies
        parts.append(count + np.repeat(np.arange(bodies), part.nv // bodies))
        count += bodies
    acts = csr_array(rows.jacobian)
    which = np.repeat(np.arange(acts.shape[0]), np.diff(acts.indptr)), np.concatenate(parts)[acts.indices]
    graph = csr_array((np.ones(len(acts.indices)), which), shape=(acts.shape[0], count))
    number, label = connected_components(graph @ graph.T, directed=False)
    return [label == k for k in range(number)]


def _raises(metric: Metric, J: Array | csr_array, moved: Array, lower: Array, tolerance: float) -> bool:
    """Return whether a displacement that holds tangents raises gaps, and is not much longer than one that does not.

    Held, the rows of two contacts of a ball in a groove oppose each other: to raise both takes a displacement that is
    very long, or mere rounding.
    """
    if (J @ moved < lower - tolerance).any():
        return False
    if not isinstance(J, np.ndarray):
        return True
    squares = np.vecdot(J, metric.solve_rows(J))
    some = (lower > 0.0) & (squares > 0.0)
    least = (lower[some] ** 2 / squares[some]).max(initial=0.0)
    return bool(moved @ metric.apply(moved) <= FARTHEST**2 * least)


def _sticking(problem: Problem, applied: Applied, step: Step) -> Array | None:
    """Return which rows of the law stick, shape (k,); None if none does."""
    if step.slip is None:
        return None
    percussion, _, after, _ = np.sqrt((step.slip * step.slip).sum(axis=2))
    sticks = (step.percussion > 0.0) & (percussion > 0.0) & (applied.h * after <= problem.tolerance)
    return sticks if sticks.any() else None


def _held(metric: Metric, near: Rows, sticking: Array, owner: Array) -> Array | csr_array:
    """Return the gradients of rows along displacements that do not move sticking contacts along their tangents.

    These are J P, where P projects onto such displacements in the metric. Gradients of which nothing is left become
    zero. Many bodies are not held: their rows are sparse, and J P is not.

    Parameters
    ----------
    metric : Metric
        M.
    near : Rows
        The rows.
    sticking : ndarray of bool, shape (n,)
        Which rows of the law stick.
    owner : ndarray of int, shape (k,)
        For each row that of the law, -1 where there is none.
    """
    J, held = near.jacobian, np.flatnonzero((owner >= 0) & sticking[owner])
    if near.tangents is None or not isinstance(J, np.ndarray) or not held.size:
        return J
    A = near.tangents.take(held).jacobian
    solved = metric.solve_rows(A)
    left = J - (J @ solved.T) @ np.linalg.pinv(solved @ A.T, HARDLY, hermitian=True) @ A
    lengths, before = (np.vecdot(rows, metric.solve_rows(rows)) for rows in (left, J))
    return np.where((lengths > _DEPENDENT * before)[:, None], left, 0.0)

"""Projects closed contacts out of penetration, in the kinetic metric; contacts that bounce keep their penetration."""

from __future__ import annotations

import numpy as np

from ...constraints import Rows
from ...constraints.carried import Place, carried_along
from ...constraints.rows import concatenate, match_contacts, renewed, take
from ...errors import ProjectionError
from ...problem import Problem
from ...projection import FreeMotion, Projector
from ...projection.positions.travel import MOST_LINEARISATIONS, NEARBY, largest_of_parts, largest_of_rows
from ...projection.row_speeds import times
from ...projection.tree import tangent
from ...system.system import Array
from ..row_projection import project_rows, slip_rates
from ..step import Step, advance_gaps, closing_speeds
from .closed_contacts import Applied, bears_or_sinks, closed_contacts, stays_sunk
from .corrections import with_corrections
from .free_impulses import with_gradients_at, with_momentum, without_percussions
from .least_displacement import Displaced, SunkRows, displacement_of_groups, least_displacement
from .moved_groups import with_the_rest_of_law
from .nearby_rows import NearbyRows


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
    system, drift, part = problem.system, step.t - applied.t, problem.constraints.part
    applied = applied._replace(usual=projector.usual_step)
    if not _may_sink(problem, step, drift, nearby):
        return _at_end(problem, applied, step)
    count = len(step.active.gap)
    slack = np.zeros(count) if applied.opened is None else applied.opened
    # the rows of the law as they are at the end of the step
    marks, bounces = step.active, np.ones(count, bool)
    if applied.ahead is not None and applied.bouncing is not None:
        bounces = largest_of_parts(applied.ahead.jacobian, part, applied.bouncing) > 0.0
        marks = _chosen(bounces, _at_the_end(problem, applied, step, bounces), applied.ahead)
    for _ in range(MOST_LINEARISATIONS):
        rows, closed = step.active, closed_contacts(problem, applied, step)
        if not bears_or_sinks(problem, step, drift):
            break
        # where the law acts at the end of the step, the active rows there are those of the law
        before = nearby.at(step.q) if drift else rows
        # for each row the row of the law at the same contact, -1 where there is none
        owner = match_contacts(before, marks)
        lengths = problem.constraints.levers(before.constraint) * before.gap
        # bounds below zero by no more than the tolerance stay: they would contradict each other by their rounding
        sunk = (owner >= 0) & closed[owner] & (lengths < -problem.tolerance)
        sunk |= stays_sunk(problem, applied, before, before.speeds(step.v), before.speeds(applied.v))
        floor = np.where(sunk, 0.0, np.minimum(before.gap, 0.0))
        if not (lengths[sunk] < -problem.tolerance).any():
            break
        end = _at_the_end(problem, applied, advance_gaps(step, drift), bounces)
        if bounces.all():
            marks = end
        else:
            there = nearby.all_at(step.q)
            # what is not found there has the gap that the law leads to
            marks = marks._replace(gap=end.gap)
            marks = _chosen(bounces, end, renewed(marks, there, match_contacts(there, marks)))
        sticking = _sticking(problem, applied, step)
        # of each part the largest distance by which a closed contact must move out
        depths = largest_of_rows(before.jacobian, part, np.where(sunk, -lengths, 0.0))
        sunken = SunkRows(problem, step.q, applied.motion.metric, marks, before, NEARBY * depths, projector, nearby)
        projected = least_displacement(sunken, floor, sticking)
        if projected is None and sticking is not None:
            # a body that landed tilted cannot turn about contacts that are all held
            projected = least_displacement(sunken, floor)
        if projected is None:
            projected = displacement_of_groups(sunken, floor)
        if projected is None:
            break
        owner = match_contacts(projected.near, marks)
        if (owner >= 0).all():
            marks = marks._replace(gap=marks.gap + times(marks.jacobian, projected.displacement))
            if not bounces.all():
                there = nearby.all_at(projected.q)
                same = match_contacts(there, marks)
                found = (same >= 0) & ~bounces[same]
                marks.gap[same[found]] = there.gap[found]
            try:
                return _with_tangent_velocity(
                    problem, applied, step, marks, projected, owner, closed, projector, nearby.place
                )
            except ProjectionError:
                break
        joined = take(projected.near, owner < 0)
        marks = concatenate([marks, joined])
        bouncing = applied.bouncing if applied.bouncing is not None else np.ones(part[-1] + 1)
        bounces = np.concatenate([bounces, largest_of_parts(joined.jacobian, part, bouncing) > 0.0])
        here = Place(applied.t, applied.q)
        there = carried_along(problem.constraints, joined, Place(step.t, nearby.place), here) if drift else joined
        rows = concatenate([rows, with_gradients_at(problem, *here, there)])
        # a row that was open where the law acts may close by the end of the step: otherwise it would bear load there
        opened = np.zeros(len(joined.gap))
        if drift:
            gap = joined.gap - drift * joined.speeds(step.v) - times(joined.jacobian, projected.displacement)
            opened = np.maximum(gap, 0.0) / drift
            rows = rows._replace(gap=np.concatenate([step.active.gap, drift * opened]))
        slack, joins = np.concatenate([slack, opened]), np.arange(len(rows.gap)) >= count
        before_law = rows.speeds(applied.v)
        lower = -rows.restitution * before_law
        # rows of the law keep their bounds; those that join it do not bounce
        lower = np.where(joins | ((slack > 0.0) & (before_law > -slack)), np.minimum(lower, -slack), lower)
        try:
            step = _with_bounds(applied, step, rows, lower, projector)
        except ProjectionError:
            # the law is solved for the rows before
            break
        if drift:
            step = step._replace(q=applied.end(system, step.v, drift)[0])
    return _at_end(problem, applied, step)


def _at_the_end(problem: Problem, applied: Applied, step: Step, some: Array) -> Rows:
    """Return the rows of the law; if `some` of them, shape (k,), are meant, with points carried to the step's end."""
    if step.t == applied.t or not some.any():
        return step.active
    here, end = Place(applied.t, applied.q), Place(step.t, step.q)
    return carried_along(problem.constraints, step.active, here, end)


def _chosen(some: Array, rows: Rows, others: Rows) -> Rows:
    """Return some of the rows, a mask of shape (k,), and others in the place of the rest."""
    place = np.arange(len(some))
    return take(concatenate([rows, others]), np.where(some, place, len(some) + place))


def _at_end(problem: Problem, applied: Applied, step: Step) -> Step:
    """Return the step with its gaps and its velocity at its end."""
    drift = step.t - applied.t
    return advance_gaps(step, drift)._replace(v=applied.end(problem.system, step.v, drift)[1])


def _may_sink(problem: Problem, step: Step, drift: float, nearby: NearbyRows) -> bool:
    """Return whether a gap at the end of the step may be below zero by more than the tolerance."""
    if drift:
        return nearby.sinks(step.q)
    rows = step.active
    lengths = problem.constraints.levers(rows.constraint) * rows.gap
    return bool(lengths.min(initial=0.0) < -problem.tolerance)


def _with_bounds(
    applied: Applied, step: Step, rows: Rows, lower: Array, projector: Projector, start: Array | None = None
) -> Step:
    """Return the step with the velocity that the law gives under other lower bounds of the rates of gaps.

    `start`, shape (nv,), replaces the free motion.
    """
    free = applied.motion.free
    if rows.rate is not None:
        lower = lower - rows.rate
    x = free if start is None else start
    w, percussion, residual, tangential = project_rows(projector, x, applied.motion.metric, rows, lower)
    rates = np.array([percussion, rows.speeds(free), rows.speeds(w), rows.speeds(applied.v)])
    slip = slip_rates(rows, tangential, free, w, applied.v)
    w = w if applied.across is None else w + applied.across
    return Step(step.t, step.q, w, rows, rates, residual, slip)


def _with_tangent_velocity(
    problem: Problem,
    applied: Applied,
    step: Step,
    marks: Rows,
    projected: Displaced,
    owner: Array,
    closed: Array,
    projector: Projector,
    place: Array,
) -> Step:
    """Return the step at the projected configuration, with a velocity tangent to its closed contacts.

    Free bodies start from their velocity at the end of the step, less the percussions of the law at the rows of the
    projected configuration: what the new percussions differ by is an impulse there. `marks` are the rows of the law at
    the end of the step, and `place` has the axes of the rows of the projected configuration.
    """
    law, step = step, step._replace(v=applied.end(problem.system, step.v, step.t - applied.t)[1])
    # gradients of contacts and of equalities are those at one place: where both hold a body against each other, the
    # percussions depend on what rounding leaves of their differences
    metric = problem.system.keeping(place, applied.motion.metric)
    v, free = tangent(metric, applied.v), tangent(metric, applied.motion.free)
    applied = applied._replace(v=v, motion=FreeMotion(free, metric))
    rows = marks._replace(restitution=step.active.restitution)
    near, unmatched = projected.near, np.ones(len(closed), bool)
    unmatched[owner] = False
    rest_of_law = np.flatnonzero(unmatched)
    # the projection changed the gradients of closed contacts: that must not make them bounce. The law may have lowered
    # the restitution of others
    near = near._replace(restitution=np.where(closed[owner], 0.0, step.active.restitution[owner]))
    if unmatched.any():
        rows = concatenate([near, with_gradients_at(problem, step.t, place, take(rows, unmatched))])
    else:
        rows = near
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
    before, order = step, np.concatenate([owner, rest_of_law])
    # bodies that loops hold turn freely until the end of the step, too
    coasting = FreeMotion(free + (step.v - law.v), metric)
    start = without_percussions(problem, coasting, step, rows, order)
    start = tangent(metric, coasting.free if start is None else start)
    step = _with_bounds(applied, step, rows, lower, projector, start)
    step = step._replace(q=projected.q, residual=max(step.residual, projected.residual), at_end=True)
    step = with_momentum(problem, step, place, before.q, before.v)
    step = with_the_rest_of_law(problem, law, before.v, step, order, projected.displacement)
    return with_corrections(problem, law, before, step, order, place)


def _sticking(problem: Problem, applied: Applied, step: Step) -> Array | None:
    """Return which rows of the law stick, shape (k,); None if none does."""
    if step.slip is None:
        return None
    percussion, _, after, _ = np.sqrt((step.slip[..., :2] ** 2).sum(axis=2))
    sticks = (step.percussion > 0.0) & (percussion > 0.0) & (applied.judged * after <= problem.tolerance)
    return sticks if sticks.any() else None

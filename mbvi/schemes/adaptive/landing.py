"""Predicts when a body lands, which is when a row that is open closes, and when a contact stops sliding."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ...constraints import Rows
from ...constraints.rows import match_contacts, take
from ...errors import ProjectionError
from ...problem import Problem
from ...projection import Projector, in_flight
from ...projection.row_speeds import times
from ...system.system import Array
from ..step import Step, law
from .cubic import POWERS, cubic
from .joints import JointSlips
from .measure import Measure

# part of a step over which the acceleration is taken
_SHORT = 1e-3
# most evaluations of gaps, and parts of the interval at which a landing is looked for
_MOST, _PARTS = 40, (1.0, 0.5, 0.25)
# most parts of a step in which an overlap is looked for; so many where walls move
_WALL_PARTS = 16


def landing_time(
    problem: Problem, measure: Measure, t: float, q: Array, v: Array, resting: Rows, h: float, projector: Projector
) -> float | None:
    """Return the time until a gap has fallen to half of `measure.gap`, below h [s]; None if none does.

    Prediction with the present acceleration, in which resting contacts bear load.
    """
    acceleration = acceleration_at(problem, t, q, v, resting, h, projector)
    system, constraints = problem.system, problem.constraints

    def lowest(x: float) -> float:
        """Return the lowest gap after x of rows that close, above the one looked for [m]."""
        place = system.integrate(q, x * (v + 0.5 * x * acceleration))
        rows = constraints.active(t + x, place, margin)
        if not len(rows.gap):
            return np.inf
        falls = (match_contacts(rows, resting) < 0) & (rows.speeds(v + x * acceleration) < 0.0)
        return float((constraints.levers(rows.constraint) * rows.gap)[falls].min(initial=np.inf)) - 0.5 * measure.gap

    margin = 2.0 * measure.gap + h * measure.size(v) * problem.length
    for part in _PARTS:
        end, above = part * h, lowest(part * h)
        if above < 0.0:
            return _root(lowest, end, above, 0.25 * measure.gap)
    return None


class Instant(NamedTuple):
    """What is near at a time within a step.

    Attributes
    ----------
    time : float
        Since the start of the step [s].
    v : ndarray, shape (nv,)
        Velocity.
    rows : Rows
        The rows whose gaps may close before the next instant.
    """

    time: float
    v: Array
    rows: Rows


def instants_within(
    problem: Problem, measure: Measure, t: float, q: Array, v: Array, end: Step, h: float
) -> list[Instant]:  # fmt: skip
    """Return the ends of a step from (q, v), and where bodies move far or walls move, instants between on its cubic."""
    system, constraints, speed = problem.system, problem.constraints, max(measure.size(v), measure.size(end.v))
    parts = _WALL_PARTS if constraints.moving else min(int(h * speed) + 1, _WALL_PARTS)
    margin = 2.0 * (measure.gap + h / parts * speed * problem.length)
    dense, found = cubic(system, h, (q, v), (end.q, end.v)), [Instant(0.0, v, constraints.active(t, q, margin))]
    for k in range(1, parts + 1):
        x = k / parts
        moved, change = h * (dense @ x**POWERS)
        place = end.q if k == parts else system.integrate(q, moved)
        found.append(Instant(x * h, v + change, constraints.active(t + x * h, place, margin)))
    return found


def missed_time(problem: Problem, measure: Measure, instants: list[Instant]) -> float | None:
    """Return the time of an overlap within a step whose ends are apart [s]; None without.

    Gaps that fall at one instant and rise at the next are cubics between; of an overlap it is the time when it is
    deepest.
    """
    for before, after in pairwise(instants):
        found = _deepest(problem, measure, before.rows, before.v, after.rows, after.v, after.time - before.time)
        if found is not None:
            return before.time + found
    return None


def flight_time(
    problem: Problem, measure: Measure, t: float, q: Array, v: Array, resting: Rows, instants: list[Instant]
) -> float | None:
    """Return a time within a step from (q, v) at which a moving wall has left a resting contact [s]; None without.

    A body that leaves a wall and lands on it again within a step is on it at its end. Between instants the rate of each
    gap is that of its wall and of bodies that fall freely.
    """
    constraints, short = problem.constraints, _SHORT * instants[-1].time
    if not constraints.moving or not len(resting.gap):
        return None
    pull, lever = (problem.system.free_velocity(t, q, v, short) - v) / short, constraints.levers(resting.constraint)
    none, opening, height = np.zeros(len(v)), np.zeros(len(resting.gap)), np.zeros(len(resting.gap))
    rate = resting.speeds(none)
    for before, (time, _, rows) in pairwise(instants[:-1]):
        # owner is -1 where there is none
        owner, last, h = match_contacts(resting, rows), rate, time - before.time
        rate, change = (np.append(one, 0.0)[owner] for one in (rows.speeds(none), h * times(rows.jacobian, pull)))
        opening = np.where(owner >= 0, np.maximum(opening + change + rate - last, 0.0), 0.0)
        height = np.where(opening > 0.0, height + h * opening, 0.0)
        if (lever * height > measure.gap).any():
            return time
    return None


def _deepest(
    problem: Problem, measure: Measure, first: Rows, v: Array, last: Rows, later: Array, h: float
) -> float | None:
    """Return when a gap between two instants is deepest that falls at the first and rises at the last [s]."""
    first = take(first, first.speeds(v) < 0.0)
    last = take(last, last.speeds(later) > 0.0)
    if not len(first.gap) or not len(last.gap):
        return None
    owner = match_contacts(first, last)
    first, last = take(first, owner >= 0), take(last, owner[owner >= 0])
    # in parts of the time: gap + falls x + bend x^2 + rest x^3
    falls, rises, change = h * first.speeds(v), h * last.speeds(later), last.gap - first.gap
    bend, rest = 3.0 * change - 2.0 * falls - rises, falls + rises - 2.0 * change
    root, over = np.sqrt(np.maximum(bend * bend - 3.0 * rest * falls, 0.0)), bend > 0.0
    x = np.where(over, -falls, root - bend) / np.where(over, bend + root, 3.0 * rest)
    deepest = first.gap + x * (falls + x * (bend + x * rest))
    overlap = problem.constraints.levers(first.constraint) * deepest < -measure.gap
    return h * float(x[overlap].min()) if overlap.any() else None


def stop_time(
    problem: Problem, t: float, q: Array, v: Array, resting: Rows, slips: JointSlips | None, least: float, h: float,
    projector: Projector,
) -> float | None:  # fmt: skip
    """Return the time until a resting contact or a joint stops to slide, below h [s]; None if none does.

    What slides by less than `least`, relative to the length of the scene [1/s], is left out.
    """
    rough = resting.tangents is not None and len(resting.gap) > 0
    if not rough and slips is None:
        return None
    acceleration = acceleration_at(problem, t, q, v, resting, h, projector)
    time = np.inf if slips is None else slips.stop_time(acceleration, least)
    if rough:
        time = min(time, _stop_time_of_contacts(resting, v, acceleration, least * problem.length))
    return time if time < h else None


def _stop_time_of_contacts(resting: Rows, v: Array, acceleration: Array, least: float) -> float:
    """Return the time until a contact stops to slide that slides faster than `least` [m/s]; inf if none does."""
    assert resting.tangents is not None
    slip, still = resting.tangents.slip(v)[:, :2], resting.tangents.slip(np.zeros(len(v)))[:, :2]
    change = resting.tangents.slip(acceleration)[:, :2] - still
    falls, square = -(slip * change).sum(axis=1), (change * change).sum(axis=1)
    some = (falls > 0.0) & ((slip * slip).sum(axis=1) > least * least) & (resting.tangents.friction > 0.0)
    return float((falls[some] / square[some]).min(initial=np.inf))


def _root(lowest: Callable[[float], float], end: float, below: float, enough: float) -> float:
    """Return a time in (0, end) at which a function that is negative at its end has come within `enough` of zero."""
    start, above, x = 0.0, np.inf, end
    for k in range(_MOST):
        # secants where both ends are known, kept off the ends, and halves
        secant = above < np.inf and k % 3 < 2
        x = start + (end - start) * (min(max(above / (above - below), 0.01), 0.99) if secant else 0.5)
        value = lowest(x)
        if abs(value) <= enough:
            break
        if value < 0.0:
            end, below = x, value
        else:
            start, above = x, value
    return x


def acceleration_at(
    problem: Problem, t: float, q: Array, v: Array, resting: Rows, h: float, projector: Projector
) -> Array:
    """Return the mean acceleration over a small part of a time h [s], with resting contacts and dry friction."""
    short = _SHORT * h
    motion = problem.system.free_motion(t, q, v, short)
    try:
        rigid = resting._replace(restitution=np.zeros(len(resting.gap)))
        w = law(projector, v, motion, rigid).velocity if len(resting.gap) else in_flight(motion)
    except ProjectionError:
        w = motion.free
    return np.asarray((w - v) / short)

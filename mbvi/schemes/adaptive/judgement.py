"""What a step that was taken whole and in halves leads to, and whether its error is small enough."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...constraints import Rows
from ...constraints.rows import match_contacts
from ...problem import Problem
from ...system.system import Array
from ..step import Step
from .balance import with_balance
from .closed import returned
from .cubic import POWERS, cubic
from .doubling import HIDDEN, Doubled, common_contacts, hidden, lands
from .measure import Measure

# gap beyond the displacement of an extrapolation up to which its contacts are looked for, in activation tolerances
_NEAR = 100.0
# share of the error between states, which does not add up from step to step
_BETWEEN = 0.2
# part of a step over which accelerations are taken
_SHORT = 1e-3

State = tuple[float, Array, Array]


class Verdict(NamedTuple):
    """What is known of a step.

    Attributes
    ----------
    step : Step
        The second half, with the state that the run would go on from.
    error : float
        Error of the step, in the units of `Measure`.
    power : float
        Exponent of the bound of the error in the length of a step that keeps to it.
    lands : bool
        Whether a body lands in the step.
    sound : bool
        Whether the difference of the states says what the error is: not where a body has passed a contact without
        landing, or a contact has reversed its slip.
    smooth : bool
        Whether the same contacts are closed throughout the step, so that shorter steps have smaller errors.
    """

    step: Step
    error: float
    power: float
    lands: bool
    sound: bool
    smooth: bool


class _Better(NamedTuple):
    """An extrapolated state, the error of the state before, and `Verdict.power`."""

    q: Array
    v: Array
    error: float
    power: float
    step: Step


def judged(
    problem: Problem, measure: Measure, found: Doubled, resting: Rows, state: State, h: float, speed: float, order: int,
    jumps: bool,
) -> Verdict:  # fmt: skip
    """Return what is known of a step.

    Parameters
    ----------
    found : Doubled
        The step.
    resting : Rows
        The contacts that were closed and at rest before.
    state : (float, ndarray, ndarray)
        Time [s], configuration and velocity before.
    h : float
        Length of the step [s].
    speed : float
        The largest speed, in the units of `Measure`.
    order : int
        Order of the steps in flight.
    jumps : bool
        Whether forces may jump.
    """
    (begins, q, v), landed = state, any(lands(step, resting) for step in found.steps)
    t = begins + h
    jump = _jump(problem, found, state, h) if jumps and not landed else None
    better = None if landed else _extrapolated(problem, measure, found, resting, t, speed, order, jump)
    if better is None:
        new, error, power = found.second, measure.error(found.displacement, found.change, speed), 0.5
    else:
        new, error, power = better.step._replace(q=better.q, v=better.v), better.error, better.power
    new = new._replace(t=t)
    still, slides = measure.slides(speed), np.zeros(len(resting.gap), bool)
    if resting.tangents is not None:
        slides = np.hypot(*resting.tangents.slip(v)[:, :2].T) > still
    unseen = [hidden(problem, step, resting, slides, still) for step in found.steps]
    error = max(error, max(one for one, _ in unseen) / (problem.length * max(1.0, speed)))
    error = max(error, _BETWEEN * _error_between(problem, measure, found, (q, v), new))
    sinks, turns = _sinks(problem, measure, resting, new), any(reverses for _, reverses in unseen)
    turns = turns or _reverses(problem, measure, resting, v, new, still)
    return Verdict(new, error, power, landed or sinks, not sinks and not turns, better is not None)


def _jump(problem: Problem, found: Doubled, state: State, h: float) -> Array:
    """Return what a jump of forces within a step may hide of the change of velocity, shape (nv,).

    Forces act as they are between the start, the middle and the end of the step: one that jumps in its last quarter is
    seen neither in the whole nor in the halves. The second difference over these three times has all of the jump.
    """
    t, short = state[0], _SHORT * h
    states = state, (t + 0.5 * h, found.first.q, found.first.v), (t + h, found.second.q, found.second.v)
    begin, middle, end = ((problem.system.free_velocity(*one, short) - one[2]) / short for one in states)
    return np.asarray(HIDDEN * h * (begin - 2.0 * middle + end))


def _error_between(problem: Problem, measure: Measure, found: Doubled, before: tuple[Array, Array], new: Step) -> float:
    """Return how far the cubic between the states before and after is from the first half, in units of `Measure`.

    A body that leaves a moving wall and lands on it again within the step is where the wall is at the end of each half.
    """
    system, h = problem.system, 2.0 * (found.second.t - found.first.t)
    moved = h * (cubic(system, h, before, (new.q, new.v))[0] @ 0.5**POWERS)
    return measure.size(system.difference(system.integrate(before[0], moved), found.first.q))


def _reverses(problem: Problem, measure: Measure, resting: Rows, v: Array, new: Step, still: float) -> bool:
    """Return whether a resting contact slips the other way after a step, on walls whose velocity changes in it.

    The law knows the velocities of walls where it acts. `v` is the velocity before, `still` as of `hidden`.
    """
    if not problem.constraints.moving or resting.tangents is None or not len(resting.gap):
        return False
    there = problem.constraints.active(new.t, new.q, measure.gap)
    if there.tangents is None or not len(there.gap):
        return False
    same = match_contacts(resting, there)
    before, after = resting.tangents.slip(v)[same >= 0, :2], there.tangents.slip(new.v)[same[same >= 0], :2]
    fast = np.minimum(np.hypot(*before.T), np.hypot(*after.T)) > still
    return bool((fast & ((before * after).sum(axis=1) < 0.0)).any())


def _extrapolated(
    problem: Problem, measure: Measure, found: Doubled, resting: Rows, t: float, speed: float, order: int,
    jump: Array | None,
) -> _Better | None:  # fmt: skip
    """Return what a step and its halves tend to; None where contacts differ. `jump` is that of `_jump`."""
    none = np.zeros(problem.system.nv)
    system, second, d, change = problem.system, found.second, found.displacement, found.change
    contacts = common_contacts(measure, found.steps, resting, speed)
    if contacts is None:
        return None
    if not len(contacts.rows.gap):
        part = 1.0 / (2.0**order - 1.0)
        q = system.integrate(second.q, part * d)
        v = system.tangent(q, second.v + part * change)
        error = part * measure.error(d, change, speed)
        if jump is not None:
            error = max(error, measure.error(none, jump, speed))
        return _Better(q, v, error, 1.0 / (1.0 + order), second)
    # in contact the steps are of order one
    q = system.integrate(second.q, d)
    v = system.tangent(q, second.v + change)
    reach = _NEAR * problem.tolerance + 2.0 * max(problem.constraints.travel(d), measure.size(d) * problem.length)
    better = returned(problem, t, q, v, contacts.rows, contacts.sticks, reach)
    if better is None:
        return None
    rows = second.active
    step = with_balance(found, contacts.closed, better.wrench)
    step = step._replace(active=rows._replace(gap=np.where(contacts.closed, 0.0, rows.gap)))
    # what differs across contacts is removed by the return
    error = measure.error(*better.along(d, change), speed)
    if jump is not None:
        error = max(error, measure.error(*better.along(none, jump), speed))
    return _Better(better.q, better.v, error, 0.5, step)


def _sinks(problem: Problem, measure: Measure, resting: Rows, new: Step) -> bool:
    """Return whether a gap that no row of the steps knows of is below zero at the end of a step."""
    constraints = problem.constraints
    if not len(constraints.active(new.t, new.q, -measure.gap).gap):
        return False
    # with the rows that rest beside those that sink: see `lands`
    rows = constraints.active(new.t, new.q, measure.gap)
    sunk = rows.gap * constraints.levers(rows.constraint) <= -measure.gap
    return lands(new._replace(active=rows, rates=np.tile(np.where(sunk, 1.0, 0.0), (4, 1))), resting)

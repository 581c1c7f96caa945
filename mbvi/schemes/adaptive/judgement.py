"""What a step that was taken whole and in halves leads to, and whether its error is small enough."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...constraints import Rows
from ...problem import Problem
from ...system.system import Array
from ..step import Step
from .closed import returned
from .doubling import Doubled, common_contacts, hidden, lands
from .measure import Measure

# gap beyond the displacement of an extrapolation up to which its contacts are looked for, in activation tolerances
_NEAR = 100.0


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
    """

    step: Step
    error: float
    power: float
    lands: bool
    sound: bool


class _Better(NamedTuple):
    """An extrapolated state, the error of the state before, and `Verdict.power`."""

    q: Array
    v: Array
    error: float
    power: float
    step: Step


def judged(
    problem: Problem, measure: Measure, found: Doubled, resting: Rows, v: Array, t: float, speed: float, order: int
) -> Verdict:
    """Return what is known of a step.

    Parameters
    ----------
    found : Doubled
        The step.
    resting : Rows
        The contacts that were closed and at rest before.
    v : ndarray, shape (nv,)
        The velocity before.
    t : float
        Time after the step [s].
    speed : float
        The largest speed, in the units of `Measure`.
    order : int
        Order of the steps in flight.
    """
    landed = any(lands(step, resting) for step in found.steps)
    better = None if landed else _extrapolated(problem, measure, found, resting, t, speed, order)
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
    sinks = _sinks(problem, measure, resting, new)
    return Verdict(new, error, power, landed or sinks, not sinks and not any(turns for _, turns in unseen))


def _extrapolated(
    problem: Problem, measure: Measure, found: Doubled, resting: Rows, t: float, speed: float, order: int
) -> _Better | None:
    """Return what a step and its halves tend to; None where contacts differ."""
    system, second, d, change = problem.system, found.second, found.displacement, found.change
    contacts = common_contacts(measure, found.steps, resting, speed)
    if contacts is None:
        return None
    if not len(contacts.rows.gap):
        part = 1.0 / (2.0**order - 1.0)
        q = system.integrate(second.q, part * d)
        v = system.tangent(q, second.v + part * change)
        return _Better(q, v, part * measure.error(d, change, speed), 1.0 / (1.0 + order), second)
    # in contact the steps are of order one
    q = system.integrate(second.q, d)
    v = system.tangent(q, second.v + change)
    reach = _NEAR * problem.tolerance + 2.0 * max(problem.constraints.travel(d), measure.size(d) * problem.length)
    better = returned(problem, t, q, v, contacts.rows, contacts.sticks, reach)
    if better is None:
        return None
    rows = second.active
    step = second._replace(active=rows._replace(gap=np.where(contacts.closed, 0.0, rows.gap)))
    # what differs across contacts is removed by the return
    return _Better(better.q, better.v, measure.error(*better.along(d, change), speed), 0.5, step)


def _sinks(problem: Problem, measure: Measure, resting: Rows, new: Step) -> bool:
    """Return whether a gap that no row of the steps knows of is below zero at the end of a step."""
    rows = problem.constraints.active(new.t, new.q, -measure.gap)
    return bool(len(rows.gap)) and lands(new._replace(active=rows, rates=np.ones((4, len(rows.gap)))), resting)

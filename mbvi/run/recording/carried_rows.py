"""The rows of the last step, whose contact points its bodies have carried to where the law acts now."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...constraints.carried import Place, carried
from ...problem import Problem
from ...schemes import Step, Timing

Array = np.ndarray


class LastRows(NamedTuple):
    """The rows of a step that have a percussion.

    Attributes
    ----------
    number : ndarray of int, shape (k,)
        Constraints, ascending.
    point : ndarray, shape (2, k, 3)
        Contact points, as the first and as the second body carries them where they are carried [m].
    rates : ndarray, shape (4, k)
        See `Step`.
    """

    number: Array
    point: Array
    rates: Array


NO_LAST_ROWS = LastRows(np.zeros(0, np.int64), np.zeros((2, 0, 3)), np.zeros((4, 0)))


def last_rows(last: Step | None) -> LastRows:
    """Return the rows of a step where they are; none before the first step."""
    loaded = np.zeros(0, np.int64) if last is None else last.rates[0].nonzero()[0]
    if last is None or not loaded.size:
        return NO_LAST_ROWS
    rows = last.active
    loaded = loaded[rows.constraint[loaded].argsort(kind="stable")]
    return LastRows(rows.constraint[loaded], rows.point[loaded][None].repeat(2, 0), last.rates[:, loaded].copy("C"))


def farthest(problem: Problem, timing: Timing, last: Step | None, step: Step) -> float:
    """Return how far bodies may carry the points of a step until the next.

    It is infinite where constraints do not say how far their bodies move. What a position projection adds is not
    counted: such a point has moved by no more than penetration.
    """
    constraints = problem.constraints
    if last is None or constraints.moving or constraints.searched.any():
        return 0.0 if last is None else np.inf
    h, envelope = step.t - last.t, constraints.cache.arrays[0]
    # points at the end of a step move on after the law
    moved = np.abs(last.v) + (1.0 - timing.jump) * step.at_end * np.abs(step.v)
    return h * float((envelope @ moved).max(initial=0.0))


def carried_rows(
    problem: Problem, timing: Timing, before: Step | None, last: Step, rows: LastRows, step: Step
) -> LastRows:
    """Return the rows of a step as its bodies carry them to those of the next step.

    Parameters
    ----------
    problem, timing
        Those of the run.
    before, last : Step or None, and Step
        The state before the step, None where that is the initial one, and the step.
    rows : LastRows
        Those of the step.
    step : Step
        The next step.
    """
    if not rows.number.size:
        return rows
    # the law of the initial state acts there
    old = place_of_rows(problem, timing, last if before is None else before, last)
    new = place_of_rows(problem, timing, last, step)
    return rows._replace(point=carried(problem.constraints, rows.number, rows.point[0], old, new))


def place_of_rows(problem: Problem, timing: Timing, before: Step, step: Step) -> Place:
    """Return where the rows of a step are, which begins in the state `before`."""
    if step.at_end:
        return Place(step.t, step.q)
    h = step.t - before.t
    return Place(before.t + timing.jump * h, timing.place_of_law(problem.system, before.q, before.v, h))

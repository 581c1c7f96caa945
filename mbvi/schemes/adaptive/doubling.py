"""One step taken whole and as two halves, and what contacts do in all three."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.linalg import lstsq

from ...constraints import Rows
from ...constraints.rows import match_contacts, take
from ...problem import Problem
from ...projection import Projector
from ...system.free.sparse_rows import dense
from ..scheme import Scheme
from ..step import Step
from .measure import Measure

Array = np.ndarray

# what both halves of a step may hide of a change of force within it, relative to the speed that it leads to
HIDDEN = 1.0 / 16.0
# most rows whose dependence is looked at, and the part of a gradient beside those of others that is rounding
LARGEST, _BESIDE = 400, 1e-6


class Doubled(NamedTuple):
    """The same interval as one step and as two.

    Attributes
    ----------
    whole : Step
        The step of length h.
    first, second : Step
        The steps of length h / 2, one after the other.
    displacement : ndarray, shape (nv,)
        Tangent vector at `whole.q` to `second.q`.
    """

    whole: Step
    first: Step
    second: Step
    displacement: Array

    @property
    def steps(self) -> tuple[Step, Step, Step]:
        """The three steps."""
        return self.whole, self.first, self.second

    @property
    def change(self) -> Array:
        """Difference of the velocities, shape (nv,)."""
        return self.second.v - self.whole.v


def doubled(
    problem: Problem, scheme: Scheme, t: float, q: Array, v: Array, h: float, projector: Projector
) -> Doubled:  # fmt: skip
    """Take a step of length h from (q, v) at t, and the same as two halves; raise as the scheme does."""
    half = 0.5 * h
    whole = scheme.step(problem, t, q, v, h, projector)
    first = scheme.step(problem, t, q, v, half, projector)
    second = scheme.step(problem, t + half, first.q, first.v, half, projector)
    return Doubled(whole, first, second, problem.system.difference(whole.q, second.q))


def lands(step: Step, resting: Rows) -> bool:
    """Return whether some row bears a percussion in the step that is none of the resting ones."""
    loaded = step.percussion > 0.0
    if not loaded.any():
        return False
    # among all rows: alone, the corner that lands would be the one that it takes the load of
    return bool((loaded & (match_contacts(step.active, resting) < 0)).any())


def held(step: Step, resting: Rows, still: Array | float) -> tuple[Array, Array]:
    """Return which rows a step keeps closed, and which of these stick, both masks of shape (k,).

    Those are resting rows that do not open. Whether they have a percussion does not matter: where contacts are
    redundant, that of some is zero. `still` is the speed below which a row does not move [m/s, rad/s], one for all or
    shape (k,).
    """
    closed, tangents = step.after <= still, step.active.tangents
    if closed.any():
        closed = closed & (match_contacts(step.active, resting) >= 0)
    if tangents is None or step.slip is None:
        return closed, np.zeros(len(closed), bool)
    slip = np.sqrt((step.slip[2, :, :2] ** 2).sum(axis=1))
    return closed, closed & (tangents.friction > 0.0) & (slip <= still)


def kept(measure: Measure, step: Step, resting: Rows, speed: float) -> tuple[Array, Array]:
    """Return what `held` does, without rows that bear nothing and are free to open; `speed` is the largest before.

    Of rows without a percussion those stay that move only as rows with one do: the rates of their gaps are sums of the
    rates of those. The gap of any other opens along the curve of its motion, although its rate in the middle of a step
    may be negative. Kept closed it would hold its bodies back.
    """
    active = step.active
    closed, sticks = held(step, resting, measure.still(active.constraint, speed))
    idle = closed & ~(step.percussion > 0.0)
    if idle.any() and np.count_nonzero(closed) <= LARGEST:
        J = dense(active.jacobian) * measure.units
        bears, rest = J[closed & ~idle], J[idle]
        beside = rest - lstsq(bears.T, rest.T, rcond=None)[0].T @ bears
        closed[idle] = np.linalg.norm(beside, axis=1) <= _BESIDE * np.linalg.norm(rest, axis=1)
    return closed, sticks & closed


def hidden(problem: Problem, step: Step, resting: Rows, slides: Array, still: float) -> tuple[float, bool]:
    """Return what the halves of a step may hide of an error, and whether a contact reverses its slip.

    A contact that opens within the step, or begins to slip, does so from its start on, by the force in its middle. Both
    halves may do the same, and are wrong by up to a sixteenth of the speed that it has at the end [m/s]. One that stops
    within the step stays until its end, even if it would slip back: its speed is wrong by up to what friction has in
    excess of that. Where slip reverses, the friction of the whole step is that of the end. `slides`, shape (k,), says
    which resting rows slide before the step, and `still` is the speed that counts as none [m/s].
    """
    owner, reverses, excess = match_contacts(step.active, resting), False, 0.0
    rises = problem.constraints.levers(step.active.constraint) * step.after
    opening = np.where((owner >= 0) & (rises > still), rises, 0.0)
    if step.slip is not None:
        after, before = step.slip[2, :, :2], step.slip[3, :, :2]
        fast, slow = np.hypot(*after.T), np.hypot(*before.T)
        begins = (owner >= 0) & (slow <= still) & (fast > still)
        opening = np.maximum(opening, np.where(begins, fast, 0.0))
        # owner is -1 where there is none
        slid = np.append(slides, False)[owner]
        excess = _excess(step, slid & (slow > still) & (fast <= still))
        turns = (after * before).sum(axis=1) < 0.0
        reverses = bool((turns & (step.percussion > 0.0) & (np.minimum(fast, slow) > still)).any())
    return max(HIDDEN * float(opening.max(initial=0.0)), excess), reverses


def _excess(step: Step, stops: Array) -> float:
    """Return the largest slip that all friction of some contacts would leave beyond zero, of those that stop [m/s]."""
    if step.slip is None or step.active.tangents is None or not stops.any():
        return 0.0
    before = step.slip[3, stops, :2]
    way = before / np.hypot(*before.T)[:, None]
    # across the slip there may be percussions that move nothing
    percussion, free = (np.abs(np.vecdot(step.slip[k, stops, :2], way)) for k in range(2))
    most = step.active.tangents.friction[stops] * step.percussion[stops]
    some = percussion > 0.0
    return float(((most[some] / percussion[some] - 1.0) * free[some]).max(initial=0.0))


class Contacts(NamedTuple):
    """The rows that three steps hold closed alike.

    Attributes
    ----------
    closed : ndarray of bool, shape (n,)
        Which rows of the last step they are.
    rows : Rows
        These.
    sticks : ndarray of bool, shape (k,)
        Which of them stick.
    """

    closed: Array
    rows: Rows
    sticks: Array


def common_contacts(measure: Measure, steps: tuple[Step, ...], resting: Rows, speed: float) -> Contacts | None:
    """Return the rows that are held in all steps; None if a step holds others, or others stick in it."""
    found = []
    for step in steps:
        number, (closed, sticks) = step.active.constraint, kept(measure, step, resting, speed)
        found.append(np.sort(2 * number[closed] + sticks[closed]))
    if not all(np.array_equal(found[-1], other) for other in found[:-1]):
        return None
    return Contacts(closed, take(steps[-1].active, closed), sticks[closed])

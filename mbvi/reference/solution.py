"""What a problem with a known solution carries."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..arguments import between, finite, number, positive
from ..errors import InputError
from ..problem import Problem

Array = np.ndarray
State = tuple[Array, Array]

# how far past its end a solution may be asked, relative to the duration: sums of steps are rounded
_PAST = 1e-9


@dataclass(frozen=True, eq=False)
class Reference:
    """A problem together with its exact solution.

    Attributes
    ----------
    name : str
        What it is called, with whatever arguments tell it from its kind.
    problem : Problem
        What is to be solved.
    duration : float
        How long the solution is known from `problem.t0` on [s].
    at : callable
        at(t) -> (q, v), shapes (nq,) and (nv,): exact, v the velocity after an impact at its instant.
    impacts : ndarray, shape (k,)
        Times at which v jumps, in (t0, t0 + duration] [s]; of an accumulation, those above rounding.
    source : str
        Where the solution comes from and how accurate it is.
    switches : ndarray, shape (s,)
        Times at which the motion is not smooth without a jump: the end of an accumulation, a release [s].
    """

    name: str
    problem: Problem
    duration: float
    at: Callable[[float], State]
    impacts: Array
    source: str
    switches: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def breakpoints(self) -> Array:
        """Start, end, and between them all times at which the motion is not smooth, sorted [s]."""
        ends = (self.problem.t0, self.problem.t0 + self.duration)
        return np.unique(np.concatenate([ends, self.impacts, self.switches]))

    def started(self, t: float) -> Problem:
        """Return the same problem started at time t [s] on its exact solution: impacts fall elsewhere in the steps."""
        problem, t = self.problem, finite(t, "t")
        e, length = problem.restitution, problem.length
        return Problem(problem.system, problem.constraints.constraints, *self.at(t), restitution=e, t0=t, length=length)


class Pieces:
    """A motion put together of smooth pieces.

    Parameters
    ----------
    starts : sequence of float
        When each piece starts, sorted, the first at or before 0; of pieces that start at once the last counts [s].
    states : sequence of callable
        One a piece: t -> (q, v).
    end : float
        When the last piece ends [s].
    """

    def __init__(self, starts: Sequence[float], states: Sequence[Callable[[float], State]], end: float) -> None:
        self._starts, self._states, self._end = list(starts), list(states), end

    def __call__(self, t: float) -> State:
        """Return (q, v) at time t [s].

        Raises
        ------
        InputError
            If t is before 0 or after the end.
        """
        # a float that is not finite is outside, too
        t, slack = t if type(t) is float else number(t, "t"), _PAST * self._end
        if not -slack <= t <= self._end + slack:
            raise InputError(f"the solution is known from 0 s to {self._end:g} s; got t = {t}")
        return self._states[max(0, bisect_right(self._starts, t) - 1)](t)


def checked(e: float, duration: float, longest: float = 1e4) -> tuple[float, float]:
    """Return restitution and duration, or raise `InputError` where they are none or no solution goes on for so long."""
    return between(e, "restitution e", 0.0, 1.0), between(positive(duration, "duration"), "duration", 0.0, longest)


def times(values: Sequence[float], end: float) -> Array:
    """Return as an array the times that are not after the end [s]."""
    found = np.array(values, dtype=float)
    return found[found <= end]

"""A problem together with its exact solution."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import cast

import numpy as np

from ..arguments import array, between, finite, number, positive
from ..errors import InputError
from ..problem import Problem

Array = np.ndarray
State = tuple[Array, Array]
# one time, or several, shape (m,) [s]
Times = float | Array
Motion = Callable[[Times], State]

# time beyond the end at which a solution is still evaluated, relative to the duration; sums of steps are rounded
_PAST = 1e-9


@dataclass(frozen=True, eq=False)
class Reference:
    """A problem together with its exact solution.

    Attributes
    ----------
    name : str
        Name, with the arguments that distinguish it from others of its kind.
    problem : Problem
        The problem.
    duration : float
        Time from `problem.t0` on for which the solution is known [s].
    at : callable
        at(t) -> (q, v), shapes (nq,) and (nv,), of several times (m, nq) and (m, nv); at an impact v is the velocity
        after it.
    impacts : ndarray, shape (k,)
        Times at which v jumps, in (t0, t0 + duration] [s]; in an accumulation those above rounding.
    source : str
        Origin and accuracy of the solution.
    switches : ndarray, shape (s,)
        Times at which the motion is not smooth without a jump: the end of an accumulation, a release [s].
    """

    name: str
    problem: Problem
    duration: float
    at: Motion
    impacts: Array
    source: str
    switches: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def breakpoints(self) -> Array:
        """Start, end, and all times between them at which the motion is not smooth, sorted [s]."""
        ends = (self.problem.t0, self.problem.t0 + self.duration)
        return np.unique(np.concatenate([ends, self.impacts, self.switches]))

    def started(self, t: float) -> Problem:
        """Return the problem that starts at time t [s] on the exact solution, so that impacts have another phase."""
        problem, t = self.problem, finite(t, "t")
        return Problem(
            problem.system, problem.constraints.constraints, *self.at(t), restitution=problem.restitution,
            friction=problem.friction, t0=t, length=problem.length,
        )  # fmt: skip


class Pieces:
    """A motion composed of smooth pieces.

    Parameters
    ----------
    starts : sequence of float
        Start of each piece, sorted, the first at or before 0 [s]. Of pieces with equal starts the last is used.
    states : sequence of callable
        t -> (q, v) of each piece, for one time or several.
    end : float
        End of the last piece [s].
    """

    def __init__(self, starts: Sequence[float], states: Sequence[Motion], end: float) -> None:
        self._starts, self._states, self._end = list(starts), list(states), end

    def __call__(self, t: Times | Sequence[float]) -> State:
        """Return (q, v) at time t, or at times in any order [s].

        Raises
        ------
        InputError
            If t is before 0 or after the end.
        """
        if np.ndim(t):
            return self._several(array(t, "t", ("m",)))
        # a float that is not finite is outside, too
        t = t if type(t) is float else number(cast("float", t), "t")
        self._check(t)
        return self._states[max(0, bisect_right(self._starts, t) - 1)](t)

    def _several(self, times: Array) -> State:
        for t in (times.min(), times.max()):
            self._check(float(t))
        q, v = (np.empty((len(times), len(x))) for x in self(0.0))
        piece = np.maximum(np.searchsorted(self._starts, times, side="right") - 1, 0)
        for k in np.unique(piece):
            own = piece == k
            q[own], v[own] = self._states[k](times[own])
        return q, v

    def _check(self, t: float) -> None:
        slack = _PAST * self._end
        if not -slack <= t <= self._end + slack:
            raise InputError(f"the solution is known from 0 s to {self._end:g} s; got t = {t}")


def checked(e: float, duration: float, longest: float = 1e4) -> tuple[float, float]:
    """Return restitution and duration; raise `InputError` if they are invalid or the duration is too long."""
    return between(e, "restitution e", 0.0, 1.0), between(positive(duration, "duration"), "duration", 0.0, longest)


def times(values: Sequence[float], end: float) -> Array:
    """Return the times that are not after the end, as an array [s]."""
    found = np.array(values, dtype=float)
    return found[found <= end]


def from_start(state: Motion, q0: Array, v0: Array, t: Times) -> State:
    """Return a state whose dense output has rounding errors at the start, which is (q0, v0) at time 0."""
    (q, v), start = state(t), column(t) == 0.0
    return np.where(start, q0, q), np.where(start, v0, v)


def column(values: Times) -> Array:
    """Return a value at one time or at several with an axis for components, shape (1,) or (m, 1)."""
    return np.asarray(values)[..., None]


def stacked(*components: Times) -> Array:
    """Return components at one time or at several, some of them constant, as an array, shape (n,) or (m, n)."""
    return np.stack(np.broadcast_arrays(*components), axis=-1)

"""Flights of q'' + q = cos(W t + phi) above a stop between impacts; no impact is missed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from ..errors import InputError
from .solution import Array, Motion, Pieces, State, Times, column, times

_MOST_IMPACTS, _MOST_ADVANCES = 5000, 100_000
# impacts closer in time than this count as an accumulation [s]
_NEAREST = 1e-6
# accelerations away from the stop below this count as zero
_STILL = 1e-13


@dataclass(frozen=True)
class Flight:
    """q = a cos s + b sin s + c cos(W s + phase), s = t - start, c = 1 / (1 - W^2)."""

    start: float
    phase: float
    frequency: float
    a: float
    b: float

    @classmethod
    def through(cls, start: float, phase: float, frequency: float, q: float, v: float) -> Flight:
        """Return the flight that starts at (q, v), where the forcing has the given phase."""
        c = 1 / (1 - frequency**2)
        return cls(start, phase, frequency, q - c * np.cos(phase), v + c * frequency * np.sin(phase))

    @property
    def c(self) -> float:
        """Amplitude of the forced part [m]."""
        return 1 / (1 - self.frequency**2)

    def __call__(self, t: Times) -> State:
        """Return (q, v) at time t, or at several [s]."""
        s, W = t - self.start, self.frequency
        q = self.a * np.cos(s) + self.b * np.sin(s) + self.c * np.cos(W * s + self.phase)
        v = -self.a * np.sin(s) + self.b * np.cos(s) - self.c * W * np.sin(W * s + self.phase)
        return column(q), column(v)

    def bound(self, order: int) -> float:
        """Return a bound of the derivative of that order, >= 1."""
        return float(np.hypot(self.a, self.b) + abs(self.c) * self.frequency**order)

    def landing(self, stop: float, end: float) -> float | None:
        """Return the first time after the start at which q is at the stop, None if that is after the end [s].

        Notes
        -----
        Conservative advancement: q - stop >= d + v s - B s^2 / 2 with B the bound of |q''|, so that no root can lie
        before the positive root of the right hand side.
        """
        B, s = self.bound(2), self._time_to_leave(stop)
        for _ in range(_MOST_ADVANCES):
            if self.start + s > end:
                return None
            q, v = self(self.start + s)
            d, rate = max(float(q[0]) - stop, 0.0), float(v[0])
            root = float(np.sqrt(rate * rate + 2 * B * d))
            advance = (rate + root) / B if rate > 0 else 2 * d / (root - rate) if d > 0 else 0.0
            s += advance
            if advance <= 1e-15 * (1 + abs(s)):
                return self._refined_by_newton(s, stop)
        raise InputError(f"an impact near {self.start + s:g} s grazes too closely to be located: choose another start")

    def _time_to_leave(self, stop: float) -> float:
        """Return a time after which a flight that starts at rest on the stop has certainly left it [s]."""
        q, v = self(self.start)
        if q[0] - stop > _STILL or v[0] > _STILL:
            return 0.0
        push, jerk = np.cos(self.phase) - stop, -self.frequency * np.sin(self.phase)
        # half of the time until the next term of Taylor's series can outweigh the first
        return float(1.5 * push / self.bound(3) if push > _STILL else 2.0 * jerk / self.bound(4))

    def _refined_by_newton(self, s: float, stop: float) -> float:
        for _ in range(3):
            q, v = self(self.start + s)
            if v[0] < 0:
                s -= float((q[0] - stop) / v[0])
        return self.start + s


class OscillatorMotion:
    """The motion of the oscillator from (q, v) at time 0, where the forcing has the given phase.

    Attributes
    ----------
    at : Pieces
        t -> (q, v).
    impacts, releases : ndarray
        Times [s].
    amplification : float
        Norm of the derivative of the last state by the first.

    Raises
    ------
    InputError
        If impacts accumulate before the end.
    """

    def __init__(
        self, e: float, frequency: float, phase: float, stop: float, q: float, v: float, duration: float
    ) -> None:
        self._e, self._frequency, self._phase, self._stop, self._end = e, frequency, phase, stop, duration
        self._starts: list[float] = []
        self._states: list[Motion] = []
        struck: list[float] = []
        released: list[float] = []
        monodromy, last = np.eye(2), 0.0
        flight: Flight | None = Flight.through(0.0, phase, frequency, q, v)
        while flight is not None:
            self._add(flight.start, flight)
            t = flight.landing(stop, duration)
            with np.errstate(over="ignore", invalid="ignore"):
                monodromy = _rotation((duration if t is None else t) - flight.start) @ monodromy
            if t is None:
                break
            if len(struck) == _MOST_IMPACTS or (struck and e > 0 and t - last < _NEAREST):
                raise InputError(f"impacts accumulate near {t:g} s: choose a shorter duration or another start")
            struck.append(t)
            last, before = t, float(flight(t)[1][0])
            with np.errstate(over="ignore", invalid="ignore"):
                monodromy = self._saltation(t, before) @ monodromy
            flight = self._next_flight(t, before, released)
        self.at = Pieces(self._starts, self._states, duration)
        self.impacts, self.releases = times(struck, duration), times(released, duration)
        # the product over thousands of impacts may overflow
        self.amplification = float(np.linalg.norm(monodromy, 2)) if np.isfinite(monodromy).all() else np.inf

    def _add(self, start: float, state: Motion) -> None:
        self._starts.append(start)
        self._states.append(state)

    def _acceleration_off_stop(self, t: float) -> float:
        """Return the acceleration away from the stop at rest on it."""
        return float(np.cos(self._frequency * t + self._phase) - self._stop)

    def _saltation(self, t: float, before: float) -> Array:
        e = self._e
        if e == 0.0 and self._acceleration_off_stop(t) <= _STILL:
            return np.zeros((2, 2))
        return np.array([[-e, 0.0], [(1 + e) * self._acceleration_off_stop(t) / before, -e]])

    def _next_flight(self, t: float, before: float, released: list[float]) -> Flight | None:
        """Return the flight after an impact, or None if the mass rests on the stop from then on."""
        phase = self._frequency * t + self._phase
        if self._e > 0.0 or self._acceleration_off_stop(t) > _STILL:
            return Flight.through(t, phase, self._frequency, self._stop, -self._e * before)
        self._add(t, partial(_at_rest, self._stop))
        if self._stop >= 1.0:
            return None
        # release: the cosine of the forcing rises through the stop's position
        leaving = -float(np.arccos(self._stop))
        release = t + float(np.mod(leaving - phase, 2 * np.pi)) / self._frequency
        if release > self._end:
            return None
        released.append(release)
        return Flight.through(release, leaving, self._frequency, self._stop, 0.0)


def _rotation(s: float) -> Array:
    return np.array([[np.cos(s), np.sin(s)], [-np.sin(s), np.cos(s)]])


def _at_rest(stop: float, t: Times) -> State:
    still = np.zeros_like(column(t))
    return still + stop, still

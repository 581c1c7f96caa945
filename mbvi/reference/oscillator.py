"""The impact oscillator q'' + q = cos(W t + phi), q >= stop: closed forms between impacts and on the stop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..arguments import finite, integer, positive
from ..constraints import GapFunction
from ..errors import InputError
from ..problem import Problem
from ..system import LagrangianSystem
from .flights import Flight, OscillatorMotion
from .solution import Array, Pieces, Reference, checked, times

_MOST_PERIODS = 100_000


def impact_oscillator(
    e: float, frequency: float = 2.5, stop: float = 0.2, n: int = 1, duration: float = 5.0
) -> Reference:
    """Return the orbit with one impact every n periods of the forcing; at e = 0 an orbit that rests on the stop.

    Parameters
    ----------
    e : float
        Restitution in [0, 1].
    frequency : float
        W of the forcing cos(W t + phi), not 1 [rad/s].
    stop : float
        Position of the stop [m].
    n : int
        Periods of the forcing between impacts (e > 0).
    duration : float
        [s].

    Raises
    ------
    InputError
        If an argument is out of its range, or no such orbit is stable, because rounding errors grow on an unstable
        orbit.

    Notes
    -----
    From an impact on, q = a cos t + b sin t + c cos(W t + phi) with c = 1 / (1 - W^2). The condition that q returns to
    the stop after P = 2 pi n / W with the velocity -u / e, u = q'(0+), gives with T = tan(P / 2)

        a = stop - c cos phi,  b = a T,  u = 2 a T e / (1 + e),  sin phi = a T (1 - e) / ((1 + e) c W),

    and a quadratic for a from cos^2 + sin^2 = 1. It is stable where the trace of the linearised return map is at most
    1 + e^2 in size, its determinant being e^2. The run starts in the middle between two impacts.
    """
    e, duration = checked(e, duration)
    frequency, stop = _checked(frequency, stop)
    n = integer(n, "n", 1)
    if e == 0.0:
        return _sticking(frequency, stop, duration)
    P = 2 * np.pi * n / frequency
    if duration > _MOST_PERIODS * P:
        raise InputError(f"more than {_MOST_PERIODS} impacts: choose a shorter duration or a lower frequency")
    orbit = _periodic(e, frequency, stop, P)
    starts = -0.5 * P + P * np.arange(int(duration / P + 0.5) + 1)
    # the forcing has the same phase at each impact
    at = Pieces(starts.tolist(), [replace(orbit, start=start) for start in starts.tolist()], duration)
    problem = _problem(e, frequency, orbit.phase + np.pi * n, stop, *replace(orbit, start=-0.5 * P)(0.0))
    source = "closed form: the periodic orbit of one impact every n periods, from a quadratic; exact to rounding"
    name = f"impact oscillator, period {n}" if n > 1 else "impact oscillator"
    return Reference(name, problem, duration, at, times(starts[1:].tolist(), duration), source)


def chaotic_oscillator(
    e: float,
    frequency: float = 4.2,
    stop: float = 0.3,
    q0: float = 0.5,
    v0: float = 0.0,
    duration: float = 6.0,
) -> Reference:
    """Return a motion of the impact oscillator from any start, by default a start with sensitive dependence.

    Parameters
    ----------
    e : float
        Restitution in [0, 1].
    frequency : float
        W of the forcing cos(W t), not 1 [rad/s].
    stop : float
        Position of the stop [m].
    q0, v0 : float
        Start, above the stop [m, m/s].
    duration : float
        [s]; `source` states how much an error at the start has grown at the end.

    Raises
    ------
    InputError
        If an argument is out of its range, or impacts accumulate before the end.

    Notes
    -----
    Flights are closed forms; the next impact is found by conservative advancement (|q''| is bounded, so a step up to
    the root of q - stop + q' s - B s^2 / 2 cannot pass one), polished by Newton's method. Every impact multiplies the
    error by about (1 + e) |q''| / |q'|: a nearly grazing one by much.
    """
    e, duration = checked(e, duration)
    frequency, stop = _checked(frequency, stop)
    q0, v0 = finite(q0, "q0"), finite(v0, "v0")
    if q0 <= stop:
        raise InputError(f"q0 must be above the stop at {stop:g}; got {q0:g}")
    motion = OscillatorMotion(e, frequency, 0.0, stop, q0, v0, duration)
    problem = _problem(e, frequency, 0.0, stop, np.array([q0]), np.array([v0]))
    grown = motion.amplification
    source = (
        "closed form between impacts located to rounding by conservative advancement; an error at the start grows "
        f"{grown:.2g} times until the end, rounding to about {1e-15 * max(1.0, grown):.0e}"
    )
    name = "chaotic oscillator"
    return Reference(name, problem, duration, motion.at, motion.impacts, source, motion.releases)


def _sticking(frequency: float, stop: float, duration: float) -> Reference:
    """Return the periodic orbit at e = 0 with one flight and one rest on the stop in each period."""
    if not -1 < stop < 1:
        raise InputError(
            f"at e = 0 the stop must lie in (-1, 1), so that the forcing holds and lifts the mass; got {stop}"
        )
    leaving = -float(np.arccos(stop))
    flight, period = Flight.through(0.0, leaving, frequency, stop, 0.0), 2 * np.pi / frequency
    landing = flight.landing(stop, period)
    if landing is None or np.cos(frequency * landing + leaving) >= stop:
        raise InputError("at e = 0 the mass does not land while the forcing holds it: choose another frequency or stop")
    q0, v0 = flight(0.5 * landing)
    phase = leaving + 0.5 * frequency * landing
    motion = OscillatorMotion(0.0, frequency, phase, stop, float(q0[0]), float(v0[0]), duration)
    problem = _problem(0.0, frequency, phase, stop, q0, v0)
    source = (
        "closed form in flight and at rest on the stop until the forcing outgrows the spring, "
        "the impact located to rounding by conservative advancement"
    )
    name = "impact oscillator"
    return Reference(name, problem, duration, motion.at, motion.impacts, source, motion.releases)


def _periodic(e: float, W: float, stop: float, P: float) -> Flight:
    """Return the stable orbit's flight from time 0, or raise `InputError`."""
    c, T = 1 / (1 - W**2), np.tan(0.5 * P)
    skew = T * (1 - e) / ((1 + e) * W)
    # (stop - a)^2 + (skew a)^2 = c^2
    discriminant = stop**2 - (1 + skew**2) * (stop**2 - c**2)
    for sign in (1.0, -1.0) if discriminant >= 0 else ():
        a = (stop + sign * np.sqrt(discriminant)) / (1 + skew**2)
        u = 2 * a * T * e / (1 + e)
        flight = Flight(0.0, float(np.arctan2(skew * a / c, (stop - a) / c)), W, float(a), float(a * T))
        if u <= 0:
            continue
        landing = flight.landing(stop, 1.5 * P)
        push = np.cos(flight.phase) - stop
        trace = -2 * e * np.cos(P) - (1 + e) * push * e / u * np.sin(P)
        if landing is not None and abs(landing - P) < 1e-9 and abs(trace) <= 1 + e * e:
            return flight
    raise InputError(
        f"there is no stable orbit with one impact every {P:g} s at e = {e:g}, frequency {W:g}, stop {stop:g}: "
        "choose another frequency or stop"
    )


def _problem(e: float, W: float, phase: float, stop: float, q0: Array, v0: Array) -> Problem:
    """Return the oscillator; its potential is the spring's."""
    mass = np.eye(1)
    return Problem(
        LagrangianSystem(lambda q: mass, lambda t, q, v: np.cos(W * t + phase) - q, 1, lambda q: 0.5 * float(q @ q)),
        [GapFunction(lambda q: q[0] - stop, lambda q: np.ones(1), name="stop")],
        q0,
        v0,
        restitution=e,
    )


def _checked(frequency: float, stop: float) -> tuple[float, float]:
    rate = positive(frequency, "frequency")
    if abs(rate - 1) <= 1e-3:
        raise InputError(f"frequency must differ from the resonance at 1; got {rate:g}")
    return rate, finite(stop, "stop")

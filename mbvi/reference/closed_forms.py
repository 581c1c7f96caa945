"""Closed-form motions of one point: a bouncing ball that comes to rest, and sliding inside a circle."""

from __future__ import annotations

from functools import partial

import numpy as np

from ..arguments import finite, positive
from ..constraints import GapFunction
from ..errors import InputError
from ..problem import Problem
from ..system import LagrangianSystem
from .solution import Pieces, Reference, State, Times, checked, column, times

# speed of a bounce, relative to the first, below which it is rounding
_SLOWEST = 1e-13
_MOST_BOUNCES = 100_000


def bouncing_ball(e: float, height: float = 1.0, gravity: float = 9.81, duration: float = 2.0) -> Reference:
    """Return a ball dropped from rest: for e < 1 infinitely many impacts in finite time, then rest.

    Parameters
    ----------
    e : float
        Restitution in [0, 1].
    height : float
        Height of the drop [m].
    gravity : float
        [m/s^2].
    duration : float
        [s].

    Raises
    ------
    InputError
        If e is outside [0, 1], or height, gravity or duration is not positive.

    Notes
    -----
    With T = (2 height / gravity)^(1/2), impact k is at T (1 + 2 (e + ... + e^k)) and leaves the speed
    e^(k+1) gravity T; they accumulate at T (1 + e) / (1 - e). The source is elementary.
    """
    e, duration = checked(e, duration)
    height, gravity = positive(height, "height"), positive(gravity, "gravity")
    fall = float(np.sqrt(2 * height / gravity))
    rest = fall * (1 + e) / (1 - e) if e < 1 else np.inf
    starts, states = [0.0], [partial(_thrown, 0.0, height, 0.0, gravity)]
    landing, speed = fall, e * gravity * fall
    while landing <= duration and (len(starts) == 1 or speed > _SLOWEST * gravity * fall):
        if len(starts) > _MOST_BOUNCES:
            raise InputError(f"more than {_MOST_BOUNCES} impacts: choose a shorter duration or another e")
        starts.append(landing)
        states.append(partial(_thrown, landing, 0.0, speed, gravity))
        # times are sums of ever shorter flights, so nothing cancels
        landing, speed = landing + 2 * speed / gravity, e * speed
    impacts = times(starts[1:], duration)
    starts.append(landing)
    states.append(partial(_thrown, landing, 0.0, 0.0, 0.0))
    mass = np.eye(1)
    problem = Problem(
        LagrangianSystem(lambda q: mass, lambda t, q, v: np.array([-gravity]), 1, lambda q: gravity * q[0]),
        [GapFunction(lambda q: q[0], lambda q: np.ones(1), name="floor")],
        [height],
        [0.0],
        restitution=e,
    )
    source = "closed form: parabolas between impacts whose times are a geometric series; exact to rounding"
    at = Pieces(starts, states, duration)
    return Reference("bouncing ball", problem, duration, at, impacts, source, times([rest], duration))


def _thrown(start: float, height: float, speed: float, gravity: float, t: Times) -> State:
    s = column(t - start)
    return height + s * (speed - 0.5 * gravity * s), speed - gravity * s


def sliding_in_disc(e: float, speed: float = 1.0, duration: float = 3.0) -> Reference:
    """Return a force-free point that slides along the inside of the unit circle.

    Parameters
    ----------
    e : float
        Restitution in [0, 1]; it has no effect, because there is no impact.
    speed : float
        [m/s].
    duration : float
        [s].

    Raises
    ------
    InputError
        If e is outside [0, 1], the speed is not finite, or the duration is not positive.

    Notes
    -----
    f(q) = (1 - |q|^2) / 2 and q = (cos w t, sin w t) with w the speed: the reaction is the centripetal force.
    """
    e, duration = checked(e, duration)
    speed = finite(speed, "speed")

    def at(t: Times) -> State:
        cos, sin = np.cos(speed * t), np.sin(speed * t)
        return np.array([cos, sin]).T, speed * np.array([-sin, cos]).T

    mass = np.eye(2)
    problem = Problem(
        LagrangianSystem(lambda q: mass, lambda t, q, v: np.zeros(2), 2, lambda q: 0.0),
        [GapFunction(lambda q: 0.5 * (1.0 - q @ q), lambda q: -q, name="circle")],
        *at(0.0),
        restitution=e,
    )
    source = "closed form: uniform motion on the circle; exact to rounding"
    return Reference("sliding in a disc", problem, duration, Pieces([0.0], [at], duration), np.zeros(0), source)

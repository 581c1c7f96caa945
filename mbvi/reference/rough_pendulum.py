"""A pendulum that rubs on a rough wall."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from ..arguments import finite, not_negative
from ..constraints import GapFunction
from ..errors import InputError
from ..problem import Problem
from ..system import LagrangianSystem
from .rough_plane import G
from .smooth import Smooth, integrated
from .solution import Array, Motion, Pieces, Reference, State, Times, checked, from_start, stacked, times

_MOST_STRETCHES = 100


def wall_pendulum(mu: float = 0.4, angle: float = 1.2, rate: float = 0.0, duration: float = 2.5) -> Reference:
    """Return a pendulum whose pivot is behind a rough vertical wall: its tip swings along the wall until it sticks.

    Parameters
    ----------
    mu : float
        Coefficient of friction, below 1.5.
    angle, rate : float
        Initial angle from the vertical, along the wall [rad], and its rate [rad/s].
    duration : float
        [s].

    Raises
    ------
    InputError
        If mu is not in [0, 1.5), the duration is not positive, or the tip would leave the wall.

    Notes
    -----
    q holds the angle along the wall and the angle of the rod to the wall. A rod of length 1 m holds the tip, 1 kg, and
    its pivot is d = 0.5 m behind the wall, so that the tip's circle has the radius r = (l^2 - d^2)^(1/2). The wall's
    force on the tip is d (g cos / r + rate^2), and the friction mu times that.
    """
    mu, angle, rate = not_negative(mu, "mu"), finite(angle, "angle"), finite(rate, "rate")
    if mu >= 1.5:
        raise InputError(f"mu must be below 1.5, so that the tip cannot jam; got {mu:g}")
    _, end = checked(0.0, duration, 50.0)
    behind, lean = 0.5, np.arcsin(0.5)
    radius = float(np.cos(lean))

    def press(theta: float, omega: float) -> float:
        return behind * (G * np.cos(theta) / radius + omega**2)

    def flow(way: float, t: float, y: Array) -> list[float]:
        return [y[1], -G / radius * np.sin(y[0]) - way * mu * press(y[0], y[1]) / radius]

    starts: list[float] = []
    states: list[Motion] = []
    t, y = 0.0, np.array([angle, rate])
    while t < end and len(starts) < _MOST_STRETCHES:
        load = -G * np.sin(y[0])
        starts.append(t)
        most = mu * press(y[0], 0.0)
        # friction across the circle can press the tip onto the wall, so that it may stick under a little more
        if y[1] == 0.0 and most < abs(load) <= most / np.sqrt(1.0 - (mu * behind / radius) ** 2):
            raise InputError(f"at {t:g} s the tip may stick or slip: choose another angle or mu")
        if y[1] == 0.0 and abs(load) <= most:
            states.append(partial(_on_wall, lean, partial(_still, y)))
            break
        way = float(np.sign(y[1] or load))
        swing = integrated(partial(flow, way), t, y, end, partial(_speed, way, t))
        states.append(partial(_on_wall, lean, swing.at))
        _check_press(swing, t, press)
        t, y = swing.end, np.array([swing.last[0], 0.0])
    q0, v0 = np.array([angle, lean]), np.array([rate, 0.0])
    states[0] = partial(from_start, states[0], q0, v0)
    at = Pieces(starts, states, end)
    source = "DOP853 at relative tolerance 1e-13 between stops, which are located to rounding"
    name = f"pendulum on a rough wall, mu = {mu:g}, {angle:g} rad"
    return Reference(name, _pendulum_problem(mu, behind, q0, v0), end, at, np.zeros(0), source, times(starts[1:], end))


def _still(y: Array, t: Times) -> Array:
    return np.multiply.outer(y, np.ones_like(t))


def _speed(way: float, start: float, t: float, y: Array) -> float:
    """Return the speed of a swing in its direction, which is zero at its start, too."""
    return way * float(y[1]) if t > start else 1.0


def _check_press(swing: Smooth, start: float, press: Callable[[float, float], float]) -> None:
    for t in np.linspace(start, swing.end, 50):
        if press(*swing.at(t)) <= 0.0:
            raise InputError(f"the tip leaves the wall at {t:g} s: choose a smaller angle")


def _on_wall(lean: float, motion: Callable[[Times], Array], t: Times) -> State:
    theta, omega = motion(t)
    return stacked(theta, lean), stacked(omega, 0.0)


def _pendulum_problem(mu: float, behind: float, q0: Array, v0: Array) -> Problem:
    def force(t: float, q: Array, v: Array) -> Array:
        (a, b), (w, u) = q, v
        sin, cos = np.sin(b), np.cos(b)
        along = 2.0 * sin * cos * w * u - G * cos * np.sin(a)
        return np.array([along, -sin * cos * w**2 - G * sin * np.cos(a)])

    def tangents(q: Array) -> Array:
        (a, b) = q
        sin, cos = np.sin(b), np.cos(b)
        return np.array([[cos * np.cos(a), -sin * np.sin(a)], [cos * np.sin(a), sin * np.cos(a)]])

    system = LagrangianSystem(
        lambda q: np.diag([np.cos(q[1]) ** 2, 1.0]), force, 2, lambda q: -G * np.cos(q[1]) * np.cos(q[0])
    )
    wall = GapFunction(
        lambda q: np.sin(q[1]) - behind, lambda q: np.array([0.0, np.cos(q[1])]), name="tip | wall", tangents=tangents
    )
    return Problem(system, [wall], q0, v0, friction=mu)

"""A tripod that slides and spins on a rough floor until it stops."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from ..arguments import finite, positive
from ..constraints import GapFunction
from ..problem import Problem
from ..system import LagrangianSystem
from .rough_plane import G, Stretch, stretches
from .smooth import integrated
from .solution import Array, Motion, Pieces, Reference, State, Times, checked, from_start, stacked, times

Motions = tuple[list[float], list[Motion]]
# speed below which the rest of a motion that stops is taken as uniformly decelerated [m/s]
_SLOW = 1e-7


def spinning_tripod(mu: float = 0.4, speed: float = 0.0, spin: float = 10.0, duration: float = 1.0) -> Reference:
    """Return a flat tripod that slides and spins on a floor until it stops.

    Parameters
    ----------
    mu : float
        Coefficient of friction.
    speed : float
        Initial speed of the centre along x [m/s].
    spin : float
        Initial angular velocity about the vertical [rad/s].
    duration : float
        [s].

    Raises
    ------
    InputError
        If mu or the duration is not positive.

    Notes
    -----
    q = (x, y, angle, z, tilt, tilt), tilts small and about the body's axes. Its feet are at the distance R = 0.1 m from
    the centre and at its height, so that each carries a third of the weight at all times. The moment of inertia is
    m R^2 / 2: spinning only, it stops after |spin| R / (2 mu g).
    """
    mu, speed, spin = positive(mu, "mu"), finite(speed, "speed"), finite(spin, "spin")
    _, end = checked(0.0, duration, 50.0)
    radius, mass, places = 0.1, 3.0, 2.0 * np.pi * np.arange(3) / 3.0
    inertia = 0.5 * mass * radius**2
    M = np.diag([mass, mass, inertia, mass, 0.5 * inertia, 0.5 * inertia])
    lever = radius * np.column_stack([np.sin(places), -np.cos(places)])

    def slips(angle: float, v: Array) -> Array:
        """Return the rows of the horizontal velocities of the feet, shape (3, 2, 3)."""
        arm = radius * np.column_stack([np.cos(places + angle), np.sin(places + angle)])
        rows = np.tile(np.eye(2, 3), (3, 1, 1))
        rows[:, 0, 2], rows[:, 1, 2] = -arm[:, 1], arm[:, 0]
        return rows

    def height(k: int, q: Array) -> float:
        return float(q[3] + lever[k] @ q[4:])

    def gradient(k: int, q: Array) -> Array:
        return np.concatenate([np.zeros(3), [1.0], lever[k]])

    def tangents(k: int, q: Array) -> Array:
        return np.hstack([slips(q[2], q)[k], np.zeros((2, 3))])

    def flow(t: float, y: Array) -> Array:
        rows = slips(y[2], y)
        u = rows @ y[3:]
        pull = -mu * mass * G / 3.0 * u / np.linalg.norm(u, axis=1, keepdims=True)
        return np.concatenate([y[3:], np.einsum("kij,ki->j", rows, pull) / np.diag(M)[:3]])

    starts, states = _sliding(flow, speed, spin, radius, end) if speed else _spinning(2.0 * mu * G / radius, spin)
    states[0] = partial(from_start, states[0], np.zeros(6), np.array([speed, 0.0, spin, 0.0, 0.0, 0.0]))
    system = LagrangianSystem(lambda q: M, lambda t, q, v: np.array([0, 0, 0, -mass * G, 0, 0]), 6)
    feet = [
        GapFunction(
            partial(height, k), partial(gradient, k), name=f"foot {k + 1} | floor", tangents=partial(tangents, k)
        )
        for k in range(3)
    ]
    at = Pieces(starts, states, end)
    problem = Problem(system, feet, *at(0.0), friction=mu)
    source = "DOP853 at relative tolerance 1e-13, in closed form if it only spins"
    name = f"tripod, {speed:g} m/s, {spin:g} rad/s"
    return Reference(name, problem, end, at, np.zeros(0), source, times(starts[1:], end))


def _spinning(grip: float, spin: float) -> Motions:
    """Return the starts and states of a motion that only spins, decelerated by grip [rad/s^2]."""
    found = stretches(spin, 0.0, grip)

    def state(stretch: Stretch, t: Times) -> State:
        angle, rate = stretch(t)
        return stacked(0.0, 0.0, angle, 0.0, 0.0, 0.0), stacked(0.0, 0.0, rate, 0.0, 0.0, 0.0)

    return [s.start for s in found], [partial(state, s) for s in found]


def _sliding(flow: Callable[[float, Array], Array], speed: float, spin: float, radius: float, end: float) -> Motions:
    """Return the starts and states of a motion that slides and spins, until it stops."""

    def size(y: Array) -> float:
        return float(np.hypot(np.hypot(y[3], y[4]), radius * y[5]))

    moving = integrated(flow, 0.0, np.array([0, 0, 0, speed, 0, spin]), end, lambda t, y: size(y) - _SLOW)
    starts = [0.0]
    states: list[Motion] = [partial(_flat, moving.at)]
    if moving.end < end:
        last, rate = moving.last, flow(moving.end, moving.last)
        left = size(last) / size(np.append(np.zeros(3), rate[3:]))
        rest = np.append(last[:3] + 0.5 * left * last[3:], np.zeros(3))
        starts.append(moving.end + left)
        states.append(partial(_flat, lambda t: np.multiply.outer(rest, np.ones_like(t))))
    return starts, states


def _flat(motion: Callable[[Times], Array], t: Times) -> State:
    y = motion(t)
    return stacked(*y[:3], 0.0, 0.0, 0.0), stacked(*y[3:], 0.0, 0.0, 0.0)

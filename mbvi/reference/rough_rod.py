"""A rod in Painlevé's configuration: its lower end strikes a rough floor and jams."""

from __future__ import annotations

import numpy as np

from ..arguments import not_negative, positive
from ..constraints import GapFunction
from ..errors import InputError
from ..problem import Problem
from ..system import LagrangianSystem
from .rough_plane import G
from .smooth import integrated
from .solution import Array, Pieces, Reference, State, Times, checked, column, stacked

# half the length of the rod [m], and its masses for (x, z, angle) [kg, kg m^2]
_HALF = 0.5
_ROD = np.array([1.0, 1.0, _HALF**2 / 3.0])


def painleve_rod(
    mu: float = 1.6, angle: float = 1.0, speed: float = 1.0, drop: float = 0.02, tip: float = 0.0, duration: float = 0.4
) -> Reference:
    """Return a rod whose lower end strikes a floor, slides into it and jams: Painlevé's configuration.

    Parameters
    ----------
    mu : float
        Coefficient of friction.
    angle : float
        Angle of the rod from the horizontal [rad].
    speed : float
        Initial speed, towards the lower end [m/s].
    drop : float
        Initial gap [m].
    tip : float
        Radius of a ball without mass about the lower end, which touches the floor; 0 is the end itself [m].
    duration : float
        [s].

    Raises
    ------
    InputError
        If the angle is no such configuration at this mu, the lower end slips or lifts after it has jammed, the tip is
        negative, or another argument is not positive.

    Notes
    -----
    A uniform rod of 1 kg and 1 m with e = 0; q = (x, z, angle) of its middle. Where mu > (1 + 3 cos^2) / (3 sin cos) no
    force lets the end itself slide on. A percussion stops it, and the rod turns about it; a ball rolls.
    """
    mu, angle, speed, drop = (
        positive(x, n) for x, n in ((mu, "mu"), (angle, "angle"), (speed, "speed"), (drop, "drop"))
    )
    tip = not_negative(tip, "tip")
    _, end = checked(0.0, duration, 5.0)
    sin, cos = np.sin(angle), np.cos(angle)
    least = (1.0 + 3.0 * cos**2) / (3.0 * cos * (sin + tip / _HALF))
    if mu <= least:
        raise InputError(f"Painlevé's configuration needs mu > {least:g}; got {mu:g}")
    start = np.array([0.0, tip + drop + _HALF * sin, angle])
    landing = float(np.sqrt(2.0 * drop / G))
    before = np.array([-speed, -G * landing, 0.0])

    def motion(a: Times) -> Array:
        """Return the velocity of q at the unit rate of the angle while the contact sticks."""
        return stacked(-_HALF * np.sin(a) - tip, _HALF * np.cos(a), 1.0)

    def acceleration(a: float, w: float) -> float:
        # Lagrange's equation in the angle
        along = motion(a)
        load = -0.5 * w**2 * 2.0 * _HALF * tip * np.cos(a) - G * along[1]
        return float(load / (along @ (_ROD * along)))

    along = motion(angle)
    rate = float(along @ (_ROD * before) / (along @ (_ROD * along)))
    _check_cone((rate * along - before)[:2], mu, landing)
    turn = integrated(lambda t, y: [y[1], acceleration(*y)], landing, np.array([angle, rate]), end)
    for t in np.linspace(landing, end, 101):
        a, w = turn.at(t)
        bend = acceleration(a, w)
        pull = bend * motion(a) - w**2 * _HALF * np.array([np.cos(a), np.sin(a), 0.0])
        _check_cone(pull[:2] + np.array([0.0, G]), mu, t)

    def falling(t: Times) -> State:
        q = start + stacked(-speed * t, -0.5 * G * t * t, 0.0)
        return q, before * stacked(1.0, t / landing, 1.0)

    place = start[0] - speed * landing - _HALF * cos

    def turning(t: Times) -> State:
        a, w = turn.at(t)
        q = stacked(place - tip * (a - angle) + _HALF * np.cos(a), tip + _HALF * np.sin(a), a)
        return q, column(w) * motion(a)

    problem = _rod_problem(mu, tip, *falling(0.0))
    source = "closed form until the impact, then DOP853 at relative tolerance 1e-13 for the angle"
    at = Pieces([0.0, landing], [falling, turning], end)
    name = f"Painlevé rod, mu = {mu:g}" + (f", ball of {tip:g} m" if tip else "")
    return Reference(name, problem, end, at, np.array([landing]), source)


def _check_cone(pull: Array, mu: float, t: float) -> None:
    """Raise `InputError` if a force or percussion (along the floor, up) is not inside the cone of friction."""
    if not abs(pull[0]) < mu * pull[1]:
        raise InputError(f"the lower end slips or lifts at {t:g} s: choose another mu, angle or duration")


def _rod_problem(mu: float, tip: float, q0: Array, v0: Array) -> Problem:
    system = LagrangianSystem(lambda q: np.diag(_ROD), lambda t, q, v: np.array([0.0, -G, 0.0]), 3, lambda q: G * q[1])
    end_on_floor = GapFunction(
        lambda q: q[1] - _HALF * np.sin(q[2]) - tip,
        lambda q: np.array([0.0, 1.0, -_HALF * np.cos(q[2])]),
        name="lower end | floor",
        tangents=lambda q: np.array([[1.0, 0.0, _HALF * np.sin(q[2]) + tip]]),
    )
    return Problem(system, [end_on_floor], q0, v0, friction=mu)

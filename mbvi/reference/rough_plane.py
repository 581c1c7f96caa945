"""A box on a rough plane, with exact solutions: it sticks and slides on an incline, rides on a belt, and tips."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ..arguments import finite, not_negative, positive
from ..errors import InputError
from ..geometry.motion import Translation
from ..scene import Scene
from .smooth import integrated
from .solution import Array, Pieces, Reference, State, Times, checked, stacked, times

G = 9.81
# a low box, which does not tip, and a tall one [m]
_LOW, _TALL = (0.4, 0.3, 0.1), (0.2, 0.3, 0.6)


class Stretch(NamedTuple):
    """A stretch of constant acceleration: its start [s], position [m], speed [m/s] and acceleration [m/s^2] there."""

    start: float
    position: float
    speed: float
    acceleration: float

    def __call__(self, t: Times) -> tuple[Any, Any]:
        """Return position and speed at time t, or at several [s]."""
        s = t - self.start
        return self.position + s * (self.speed + 0.5 * s * self.acceleration), self.speed + s * self.acceleration


def stretches(speed: float, load: float, grip: float) -> list[Stretch]:
    """Return the motion along a line from position 0 under a constant load and Coulomb friction.

    Parameters
    ----------
    speed : float
        Initial speed of the slip [m/s].
    load : float
        Acceleration without friction [m/s^2].
    grip : float
        Largest deceleration by friction [m/s^2].

    Returns
    -------
    list of Stretch
        Slip until it stops, if it does; then rest if |load| <= grip, or slip along the load.
    """
    found = []
    start, place = 0.0, 0.0
    if speed != 0.0:
        rate = load - np.copysign(grip, speed)
        found.append(Stretch(0.0, 0.0, speed, rate))
        # it does not stop, or after a time that no number holds
        if rate * speed >= 0.0 or abs(rate) <= 1e-150 * abs(speed):
            return found
        start = -speed / rate
        place = 0.5 * speed * start
    rest = abs(load) <= grip
    return [*found, Stretch(start, place, 0.0, 0.0 if rest else load - np.copysign(grip, load))]


def block_on_incline(mu: float = 0.5, slope: float = 0.45, speed: float = 0.0, duration: float = 1.0) -> Reference:
    """Return a box on an incline: it sticks where tan(angle) <= mu, and otherwise slides.

    Parameters
    ----------
    mu : float
        Coefficient of friction.
    slope : float
        Tangent of the angle; 0 is a level floor.
    speed : float
        Initial speed down the incline; negative is up [m/s].
    duration : float
        [s].

    Raises
    ------
    InputError
        If mu is negative, the duration is not positive, or the box would tip.

    Notes
    -----
    The acceleration down the incline is g (sin -+ mu cos) while it slips down or up. On a level floor the box stops
    after |speed| / (mu g). The plane is level and gravity is inclined.
    """
    mu, slope, speed = _coefficient(mu), finite(slope, "slope"), finite(speed, "speed")
    _, end = checked(0.0, duration)
    cos = 1.0 / np.sqrt(1.0 + slope**2)
    _upright(mu if speed or abs(slope) > mu else abs(slope))
    scene = _scene(mu, (G * cos * slope, 0.0, -G * cos))
    scene.add_box(_LOW, mass=2.0, position=(0, 0, 0.5 * _LOW[2]), velocity=(speed, 0, 0), name="block")
    motion = stretches(speed, G * cos * slope, mu * G * cos)
    at = Pieces([s.start for s in motion], [partial(_along_x, s, 0.0) for s in motion], end)
    source = "closed form: constant accelerations between stops; exact to rounding"
    switches = times([s.start for s in motion[1:]], end)
    name = f"block on an incline, mu = {mu:g}, slope = {slope:g}, {speed:g} m/s"
    return Reference(name, scene.build(), end, at, np.zeros(0), source, switches)


def block_on_belt(mu: float = 0.3, belt: float = 1.5, speed: float = -0.5, duration: float = 1.0) -> Reference:
    """Return a box put on a belt that moves: it slips until it has the belt's speed.

    Parameters
    ----------
    mu : float
        Coefficient of friction.
    belt, speed : float
        Speed of the belt, and initial speed of the box, along x [m/s].
    duration : float
        [s].

    Raises
    ------
    InputError
        If mu is negative, or the duration is not positive.

    Notes
    -----
    The box slips for |belt - speed| / (mu g). The belt is a half-space that moves along itself.
    """
    mu, belt, speed = _coefficient(mu), finite(belt, "belt"), finite(speed, "speed")
    _, end = checked(0.0, duration)
    _upright(mu)
    scene = Scene(gravity=(0, 0, -G), friction=mu)
    scene.add_halfspace((0, 0, 1), name="belt", motion=Translation((belt, 0, 0)))
    scene.add_box(_LOW, mass=2.0, position=(0, 0, 0.5 * _LOW[2]), velocity=(speed, 0, 0), name="block")
    motion = stretches(speed - belt, 0.0, mu * G)
    at = Pieces([s.start for s in motion], [partial(_along_x, s, belt) for s in motion], end)
    source = "closed form: constant acceleration, then the belt's speed; exact to rounding"
    name = f"block on a belt, mu = {mu:g}, {belt:g} m/s"
    switches = times([s.start for s in motion[1:]], end)
    return Reference(name, scene.build(), end, at, np.zeros(0), source, switches)


def tipping_box(mu: float = 0.9, slope: float = 0.6, duration: float = 0.4) -> Reference:
    """Return a tall box on an incline that tips about its lower edge, and does not slip there.

    Parameters
    ----------
    mu : float
        Coefficient of friction.
    slope : float
        Tangent of the angle, above width over height, which is 1/3.
    duration : float
        [s].

    Raises
    ------
    InputError
        If mu is negative, the duration is not positive, the box does not tip, or its edge would slip or lift.
    """
    mu, slope = _coefficient(mu), positive(slope, "slope")
    _, end = checked(0.0, duration, 2.0)
    width, height = _TALL[0], _TALL[2]
    if slope * height <= width:
        raise InputError(f"the box tips where the slope is above {width / height:g}; got {slope:g}")
    cos = 1.0 / np.sqrt(1.0 + slope**2)
    gravity = G * cos * np.array([slope, -1.0])
    arm = 0.5 * np.array([-width, height])
    # about the edge, per mass
    inertia = (width**2 + height**2) / 3.0

    def acceleration(angle: float) -> float:
        x, z = _turned(arm, angle)
        return float(z * gravity[0] - x * gravity[1]) / inertia

    turn = integrated(lambda t, y: [y[1], acceleration(y[0])], 0.0, np.zeros(2), end).at

    def at(t: Times) -> State:
        angle, rate = np.where(np.greater(t, 0.0), turn(t), 0.0)
        x, z = _turned(arm, angle)
        q = stacked(0.5 * width + x, 0.0, z, 0.0, np.sin(0.5 * angle), 0.0, np.cos(0.5 * angle))
        return q, stacked(rate * z, 0.0, -rate * x, 0.0, rate, 0.0)

    for t in np.linspace(0.0, end, 101):
        angle, rate = turn(t)
        x, z = _turned(arm, angle)
        pull = acceleration(angle) * np.array([z, -x]) - rate**2 * np.array([x, z]) - gravity
        if not abs(pull[0]) < mu * pull[1]:
            raise InputError(f"the edge slips or lifts at {t:g} s: choose a larger mu or a shorter duration")
    scene = _scene(mu, (gravity[0], 0.0, gravity[1]))
    scene.add_box(_TALL, mass=2.0, position=(0, 0, 0.5 * height), name="box")
    source = "DOP853 at relative tolerance 1e-13 for the angle about the edge"
    name = f"box that tips, mu = {mu:g}, slope = {slope:g}"
    return Reference(name, scene.build(), end, Pieces([0.0], [at], end), np.zeros(0), source)


def _coefficient(mu: float) -> float:
    return not_negative(mu, "mu")


def _upright(used: float) -> None:
    most = _LOW[0] / _LOW[2]
    if used >= most:
        raise InputError(f"the box tips at coefficients and slopes from {most:g} on; got {used:g}")


def _scene(mu: float, gravity: Sequence[float]) -> Scene:
    scene = Scene(gravity=gravity, friction=mu)
    scene.add_halfspace((0, 0, 1), name="floor")
    return scene


def _along_x(motion: Stretch, belt: float, t: Times) -> State:
    x, speed = motion(t)
    q = stacked(x + belt * t, 0.0, 0.5 * _LOW[2], 0.0, 0.0, 0.0, 1.0)
    return q, stacked(speed + belt, 0.0, 0.0, 0.0, 0.0, 0.0)


def _turned(arm: Array, angle: Times) -> Array:
    """Return (x, z) of an arm after a turn about y."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * arm[0] + s * arm[1], c * arm[1] - s * arm[0]])

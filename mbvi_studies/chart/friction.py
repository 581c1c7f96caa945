"""Scenes with friction: bodies on ball feet and a robot on an inclined plane, for mbvi and for other engines."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from mbvi.reference import painleve_rod
from mbvi.scene.urdf.shipped import robot

from ..engines.rig import State
from .errors import Array

G = 9.81
# radius of ball feet [m]; mass of what stands on them [kg]
_FOOT, _MASS = 0.01, 2.0
_NONE = np.zeros(0)
# stiffness [N m / rad] and damping [N m s / rad] of the robot's joints, and its coefficient of friction and slope
_STIFFNESS, _DAMPING, _STAND = 60.0, 2.0, (0.6, 0.3)


@dataclass(frozen=True, eq=False)
class Rough:
    """A body or robot on a rough plane z = 0, with gravity inclined instead of the plane.

    Attributes
    ----------
    name : str
        Title of its panel.
    urdf : str
        Text of the body, whose root link floats; only it and the plane touch.
    base : str
        The root link.
    joints : tuple of str
        Names of the joints, in the order of `State.angles`.
    mu : float
        Coefficient of friction.
    gravity : ndarray, shape (3,)
        [m/s^2].
    start : State
        Initial state; its angles are those that the springs of the joints, if any, hold.
    duration : float
        Simulated time [s].
    sampled : tuple of float
        Times at which states are read [s].
    error : callable
        The error of these states.
    what : str
        The error in words, with its unit.
    source : str
        What states are compared with.
    stiffness, damping : float
        Of the joints [N m / rad, N m s / rad].
    """

    name: str
    urdf: str
    base: str
    joints: tuple[str, ...]
    mu: float
    gravity: Array
    start: State
    duration: float
    sampled: tuple[float, ...]
    error: Callable[[list[State]], float]
    what: str
    source: str
    stiffness: float = 0.0
    damping: float = 0.0

    def torque(self, angles: Array, rates: Array) -> Array:
        """Return the torques of the springs of the joints [N m]."""
        return self.stiffness * (self.start.angles - angles) - self.damping * rates


def incline(share: float) -> Rough:
    """Return a block at rest on an incline whose tangent is a part of mu: it must not move."""
    mu = 0.5
    slope = share * mu
    feet = [(x, y, -0.03) for x in (-0.15, 0.15) for y in (-0.1, 0.1)]
    return Rough(
        f"block on an incline, tan = {share:g} mu", _feet_urdf(feet, (0.02, 0.04, 0.05)), "body", (), mu,
        _inclined(slope), _placed(0.04), 10.0, (10.0,), lambda s: float(np.hypot(*s[0].position[:2])),
        "creep in 10 s [m]", "rest",
    )  # fmt: skip


def launched() -> Rough:
    """Return a block launched along a floor: it stops after v^2 / (2 mu g)."""
    mu, speed = 0.5, 2.0
    feet = [(x, y, -0.03) for x in (-0.15, 0.15) for y in (-0.1, 0.1)]
    far = speed**2 / (2 * mu * G)
    return Rough(
        "block launched along a floor", _feet_urdf(feet, (0.02, 0.04, 0.05)), "body", (), mu, _inclined(0.0),
        _placed(0.04, linear=(speed, 0.0, 0.0)), 1.0, (1.0,),
        lambda s: float(np.hypot(s[0].position[0] - far, s[0].position[1])), "error of the stop [m]",
        "v^2 / (2 mu g)",
    )  # fmt: skip


def spinning() -> Rough:
    """Return a tripod that spins on a floor: it stops after the angle w^2 I / (2 mu m g R)."""
    mu, spin, radius, inertia = 0.4, 10.0, 0.1, 0.01
    places = 2 * np.pi * np.arange(3) / 3
    feet = [(radius * np.cos(a), radius * np.sin(a), 0.0) for a in places]
    angle = spin**2 * inertia / (2 * mu * _MASS * G * radius)
    return Rough(
        "tripod that spins to rest", _feet_urdf(feet, (0.005, 0.005, inertia)), "body", (), mu, _inclined(0.0),
        _placed(_FOOT, angular=(0.0, 0.0, spin)), 1.0, (1.0,),
        lambda s: abs(2 * float(np.arctan2(s[0].quaternion[2], s[0].quaternion[3])) - angle),
        "error of the angle [rad]", "w^2 I / (2 mu m g R)",
    )  # fmt: skip


def painleve() -> Rough:
    """Return a rod whose lower end strikes the floor in Painlevé's configuration and jams."""
    reference = painleve_rod(tip=_FOOT, duration=0.3)
    mu, end = float(reference.name.partition("mu = ")[2].partition(",")[0]), reference.duration
    q, v = reference.at(0.0)
    thin = 1e-4
    text = _urdf(1.0, (thin, 1.0 / 12.0, 1.0 / 12.0), [(-0.5, 0.0, 0.0)])
    turn = Rotation.from_rotvec([0.0, -q[2], 0.0]).as_quat()
    start = State(np.array([q[0], 0.0, q[1]]), turn, _NONE, np.array([v[0], 0.0, v[1]]), np.zeros(3), _NONE)
    exact = reference.at(end)[0]

    def error(states: list[State]) -> float:
        return float(np.linalg.norm(states[0].position - [exact[0], 0.0, exact[1]]))

    return Rough(
        "rod in Painlevé's configuration", text, "body", (), mu, _inclined(0.0), start, end, (end,), error,
        "error of its middle [m]", reference.source,
    )  # fmt: skip


def standing() -> Rough:
    """Return the shipped quadruped, which stands on a slope by springs in its joints for 60 s."""
    mu, slope = _STAND
    angles = {"hip": 0.0, "thigh": 0.7, "calf": -1.4}
    joints = tuple(f"{leg}_{joint}_joint" for leg in ("FL", "FR", "RL", "RR") for joint in angles)
    rest = np.array(list(angles.values()) * 4)
    # feet of radius 0.023 m below legs of two links of 0.2 m
    height = 0.4 * np.cos(0.7) + 0.023 + 1e-4
    still = np.zeros(3)
    start = State(np.array([0.0, 0.0, height]), np.array([0.0, 0.0, 0.0, 1.0]), rest, still, still, np.zeros(12))
    return Rough(
        "quadruped that stands on a slope", robot("quadruped").read_text(), "trunk", joints, mu, _inclined(slope),
        start, 60.0, (10.0, 60.0), lambda s: float(np.linalg.norm(s[1].position - s[0].position)),
        "creep of the trunk, 10 to 60 s [m]", "rest", _STIFFNESS, _DAMPING,
    )  # fmt: skip


# scenes by their names on the command line
ROUGH: dict[str, Callable[[], Rough]] = {
    "incline": partial(incline, 0.9),
    "steeper-incline": partial(incline, 0.99),
    "launched-block": launched,
    "spinning-tripod": spinning,
    "painleve-rod": painleve,
    "standing-quadruped": standing,
}


def _inclined(slope: float) -> Array:
    return G / np.sqrt(1.0 + slope**2) * np.array([slope, 0.0, -1.0])


def _placed(
    height: float,
    linear: tuple[float, float, float] = (0.0, 0.0, 0.0),
    angular: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> State:
    turn = np.array([0.0, 0.0, 0.0, 1.0])
    return State(np.array([0.0, 0.0, height]), turn, _NONE, np.array(linear), np.array(angular), _NONE)


def _feet_urdf(feet: list[tuple[float, float, float]], inertia: tuple[float, float, float]) -> str:
    return _urdf(_MASS, inertia, feet)


def _urdf(mass: float, inertia: tuple[float, float, float], feet: list[tuple[float, float, float]]) -> str:
    """Return a body with ball feet; one part a line, because some engines cut long lines."""
    x, y, z = inertia
    parts = [
        f'<robot name="body"><link name="body"><inertial><mass value="{mass}"/>',
        f'<inertia ixx="{x}" iyy="{y}" izz="{z}" ixy="0" ixz="0" iyz="0"/></inertial>',
        *(
            f'<collision name="foot {k}"><origin xyz="{" ".join(repr(float(c)) for c in foot)}"/>'
            f'<geometry><sphere radius="{_FOOT}"/></geometry></collision>'
            for k, foot in enumerate(feet)
        ),
        "</link></robot>",
    ]
    return "\n".join(parts)

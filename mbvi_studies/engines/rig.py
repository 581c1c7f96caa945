"""Models of chart cases for other engines: a URDF, planes, and the map between coordinates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from mbvi.scene.urdf.shipped import robot
from mbvi.system import ArticulatedSystem

from ..chart.sweep import Case

Array = np.ndarray

_BALL, _TIP = 0.1, 0.05
# moment of inertia of a point mass; engines do not accept zero [kg m^2]
_POINT = 1e-9


class State(NamedTuple):
    """Configuration and velocity of a rig; base velocities are in the world, the linear one that of its origin."""

    position: Array
    quaternion: Array
    angles: Array
    linear: Array
    angular: Array
    rates: Array


@dataclass(frozen=True)
class Rig:
    """The model of a problem for other engines.

    Attributes
    ----------
    urdf : str
        One robot or body; a fixed one is attached at its root link.
    base : str
        The root link.
    free : bool
        Whether the root link floats.
    joints : tuple of str
        Names of joints, in the order of `State.angles`.
    planes : tuple of (ndarray, float)
        Normal and offset; bodies are where normal . x >= offset.
    state : callable
        (q, v) -> State.
    coordinates : callable
        State -> (q, v).
    mass : float
        Total mass [kg].
    closing : float
        Speed of the first impact [m/s], for engines whose restitution depends on it.
    """

    urdf: str
    base: str
    free: bool
    joints: tuple[str, ...]
    planes: tuple[tuple[Array, float], ...]
    state: Callable[[Array, Array], State]
    coordinates: Callable[[State], tuple[Array, Array]]
    mass: float = 1.0
    closing: float = 1.0


class Engine(Protocol):
    """An adapter of an engine with a rig, at one step."""

    settings: str
    """Settings, in words."""
    continuous: bool
    """Whether the engine chooses its steps, so that h sets the stiffness only; otherwise it is semi-implicit."""

    def __init__(self, rig: Rig, e: float, h: float) -> None: ...

    def start(self, state: State) -> None:
        """Set the state."""

    def advance(self) -> None:
        """Advance by one step."""

    def read(self) -> State:
        """Return the state."""


def rig(case: Case) -> Rig | None:
    """Return the rig of a case, or None if the case does not consist of rigid bodies."""
    make = RIGS.get(case.name)
    return None if make is None else replace(make(case), mass=_mass(case), closing=_closing(case))


def _mass(case: Case) -> float:
    # largest diagonal entry of M at the start: exact for one body, a scale for a mechanism
    problem = case.problem
    return float(max(2 * problem.system.kinetic_energy(problem.q0, unit) for unit in np.eye(problem.system.nv)))


def _closing(case: Case) -> float:
    """Return the speed of the first impact [m/s]."""
    solution, problem = case.solution, case.problem
    if solution is None or not len(solution.impacts):
        return 1.0
    t = float(np.nextafter(solution.impacts[0], -np.inf))
    q, v = solution.at(t)
    return -float((problem.constraints.active(t, q, 1e-6 * problem.length).jacobian @ v).min(initial=-1e-9))


def _ball(case: Case) -> Rig:
    up, none = np.array([0.0, 0.0, 1.0]), np.zeros(3)
    inertia = 0.4 * _BALL**2

    def state(q: Array, v: Array) -> State:
        return State((q[0] + _BALL) * up, np.array([0.0, 0.0, 0.0, 1.0]), none[:0], v[0] * up, none, none[:0])

    text = _urdf([_link("ball", 1.0, none, inertia * np.ones(3), f'<sphere radius="{_BALL}"/>')])
    return Rig(text, "ball", True, (), ((up, 0.0),), state, lambda s: (s.position[2:] - _BALL, s.linear[2:]))


def _box(case: Case) -> Rig:
    size, mass = np.array([0.3, 0.5, 0.7]), 2.0
    inertia = mass / 12 * (size @ size - size**2)
    text = _urdf([_link("box", mass, np.zeros(3), inertia, f'<box size="{_words(size)}"/>')])

    def state(q: Array, v: Array) -> State:
        # scipy does not accept read-only arrays
        q, v = np.array(q), np.array(v)
        return State(q[:3], q[3:], v[:0], v[:3], Rotation.from_quat(q[3:]).apply(v[3:]), v[:0])

    def coordinates(s: State) -> tuple[Array, Array]:
        spin = Rotation.from_quat(s.quaternion).apply(s.angular, inverse=True)
        return np.concatenate([s.position, s.quaternion]), np.concatenate([s.linear, spin])

    return Rig(text, "box", True, (), ((np.array([0.0, 0.0, 1.0]), 0.0),), state, coordinates)


def _pendulum(case: Case) -> Rig:
    down, point = np.array([0.0, 0.0, -1.0]), _POINT * np.ones(3)
    parts = [
        # the root is fixed; some engines do not accept a link without mass
        _link("stand", 1.0, np.zeros(3), np.ones(3)),
        _link("upper", 1.0, down, point),
        _link("lower", 1.0, down, point, f'<sphere radius="{_TIP}"/>'),
        _hinge("shoulder", "stand", "upper", np.zeros(3)),
        _hinge("elbow", "upper", "lower", down),
    ]
    still, turn = np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0])

    def state(q: Array, v: Array) -> State:
        # both angles of mbvi are measured from the vertical
        return State(still, turn, np.array([q[0], q[1] - q[0]]), still, still, np.array([v[0], v[1] - v[0]]))

    wall = (np.array([1.0, 0.0, 0.0]), -0.1 - _TIP)
    return Rig(
        _urdf(parts), "stand", False, ("shoulder", "elbow"), (wall,), state,
        lambda s: (np.cumsum(s.angles), np.cumsum(s.rates)),
    )  # fmt: skip


def _quadruped(case: Case) -> Rig:
    system = case.problem.system
    assert isinstance(system, ArticulatedSystem)
    model = system.model
    text = robot("quadruped").read_text()

    def state(q: Array, v: Array) -> State:
        q, v = np.array(q), np.array(v)
        turn = Rotation.from_quat(q[3:7])
        return State(q[:3], q[3:7], q[7:], turn.apply(v[:3]), turn.apply(v[3:6]), v[6:])

    def coordinates(s: State) -> tuple[Array, Array]:
        turn = Rotation.from_quat(s.quaternion)
        v = [turn.apply(s.linear, inverse=True), turn.apply(s.angular, inverse=True), s.rates]
        return np.concatenate([s.position, s.quaternion, s.angles]), np.concatenate(v)

    names = tuple(name.partition("/")[2] or name for name in list(model.names)[2:])
    floor = (np.array([0.0, 0.0, 1.0]), 0.0)
    return Rig(text, "trunk", True, names, (floor,), state, coordinates)


RIGS: dict[str, Callable[[Case], Rig]] = {
    "bouncing ball": _ball,
    "tumbling body": _box,
    "double pendulum": _pendulum,
    "quadruped landing": _quadruped,
}


def _words(values: Array) -> str:
    return " ".join(repr(float(x)) for x in values)


def _urdf(parts: list[str]) -> str:
    return f'<robot name="rig">{"".join(parts)}</robot>'


def _link(name: str, mass: float, centre: Array, inertia: Array, shape: str = "") -> str:
    x, y, z = inertia.tolist()
    place = f'<origin xyz="{_words(centre)}"/>'
    solid = f"<collision>{place}<geometry>{shape}</geometry></collision>" if shape else ""
    return (
        f'<link name="{name}"><inertial>{place}<mass value="{mass}"/>'
        f'<inertia ixx="{x}" iyy="{y}" izz="{z}" ixy="0" ixz="0" iyz="0"/></inertial>{solid}</link>'
    )


def _hinge(name: str, parent: str, child: str, place: Array) -> str:
    # a positive angle swings towards x
    return (
        f'<joint name="{name}" type="continuous"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{_words(place)}"/><axis xyz="0 -1 0"/></joint>'
    )

"""Adapter to jiminy: contact points that act as springs in acceleration, integrated with error control."""

from __future__ import annotations

import pickle
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from functools import lru_cache
from importlib.metadata import version
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from .rig import Array, Rig, State

NAME = f"jiminy {version('jiminy-py')}"
# errors of runs that the engine gives up
FAILURES: tuple[type[Exception], ...] = (RuntimeError,)
# reason why there is no model of free bodies
NO_BODIES = "its contacts are of points with one ground, and none of bodies with each other"
_METHOD, _TOLERANCE = "runge_kutta_dopri", 1e-7
# tolerance per unit of kd; with a smaller one, steps at the start of damping would be shorter than the engine allows
_JUMP = 5e-12
# largest step [s]; factor of sqrt(h) for the largest step of free bodies, whose rotation has an uncontrolled error of
# order two [s^1/2]
_LONGEST, _SPINNING = 0.02, 0.15
# omega h of contacts
_STIFF = 100.0
# damping ratio at e = 0: damping stops the body, and the spring removes the penetration
_MOST_DAMPED = 25.0
_GRAVITY = np.array([0.0, 0.0, -9.81])


class Jiminy:
    """A rig in jiminy, rotated and moved so that its plane is the ground; h sets the stiffness of contacts."""

    continuous = True

    def __init__(self, rig: Rig, e: float, h: float) -> None:
        # jiminy has one ground
        ((normal, offset),) = rig.planes
        points, radius = _points(rig.urdf)
        # roll and pitch that make the normal vertical
        angles = np.array([np.arctan2(normal[1], normal[2]), -np.arcsin(normal[0]), 0.0])
        self._turn = Rotation.from_euler("xyz", angles)
        self._up = np.array([0.0, 0.0, offset + radius])
        self._free, self._h = rig.free, h
        ratio = damping_ratio(e)
        omega = _STIFF / h / max(ratio, 1.0)
        self._gains = omega**2, 2.0 * ratio * omega
        longest = min(_LONGEST, _SPINNING * np.sqrt(h)) if rig.free else _LONGEST
        tolerance = max(_TOLERANCE, _JUMP * self._gains[1])
        options = {
            "stepper": {"odeSolver": _METHOD, "tolAbs": tolerance, "tolRel": tolerance, "dtMax": longest},
            "world": {"gravity": np.concatenate([self._turn.apply(_GRAVITY), np.zeros(3)])},
            "contacts": {"model": "constraint", "friction": 0.0, "torsion": 0.0, "transitionEps": 0.0},
            "constraints": {"regularization": 0.0},
        }
        urdf = _limited(rig.urdf if rig.free else _standing(rig, angles, -self._up))
        self._joints = ask("make", urdf, rig.free, points, options)
        self._order = np.array([self._joints.index(name) for name in rig.joints], dtype=int)
        most = f"{_SPINNING:g} sqrt(h)" if rig.free else f"{_LONGEST:g}"
        self.settings = (
            f"continuous, {_METHOD} at tolerance max({_TOLERANCE:g}, {_JUMP:g} kd) and steps of at most {most} s, in a "
            "process of its own; constraint model; regularization, friction, torsion and transitionEps 0; "
            f"kp = omega^2 and kd = {2 * ratio:.3g} omega of contacts (omega h = {omega * h:.3g}), set after the start "
            "in place of a stabilizationFreq: throws back at e; contact points are the centres of balls over a plane "
            "as much higher, or the corners of a box; no joint limits"
        )

    def start(self, state: State) -> None:
        """Set the state."""
        angles, rates = np.zeros(len(self._order)), np.zeros(len(self._order))
        angles[self._order], rates[self._order] = state.angles, state.rates
        q, v = [angles], [rates]
        if self._free:
            turn = self._turn * Rotation.from_quat(state.quaternion)
            place = self._turn.apply(state.position) - self._up
            linear, spin = (turn.apply(self._turn.apply(w), inverse=True) for w in (state.linear, state.angular))
            q, v = [place, turn.as_quat(), angles], [linear, spin, rates]
        ask("start", np.concatenate(q), np.concatenate(v), *self._gains)

    def advance(self) -> None:
        """Advance by h."""
        self.many(1)

    def many(self, count: int) -> None:
        """Advance by several h, in the engine's own steps."""
        ask("go", count * self._h)

    def until(self, time: float) -> None:
        """Advance to a time after the start [s]."""
        ask("until", time)

    def clock(self) -> float:
        """Return the CPU time of its process [s]."""
        return float(ask("clock"))

    def read(self) -> State:
        """Return the state."""
        q, v = ask("read")
        still: Array = np.zeros(3)
        if not self._free:
            return State(still, np.array([0.0, 0.0, 0.0, 1.0]), q[self._order], still, still, v[self._order])
        turn = Rotation.from_quat(q[3:7])
        back = self._turn.inv()
        linear, spin = (back.apply(turn.apply(w)) for w in (v[:3], v[3:6]))
        place = back.apply(q[:3] + self._up)
        return State(place, (back * turn).as_quat(), q[7:][self._order], linear, spin, v[6:][self._order])


Peer = Jiminy


def damping_ratio(e: float) -> float:
    """Return the damping ratio at which a spring without tension has the restitution e."""
    if e >= 1.0:
        return 0.0
    if e <= _restitution(_MOST_DAMPED):
        return _MOST_DAMPED
    return float(brentq(lambda ratio: _restitution(ratio) - e, 1e-12, _MOST_DAMPED, xtol=1e-14))


def _restitution(ratio: float) -> float:
    """Return the restitution of a damped spring without tension; contact ends when its force vanishes."""
    root = np.sqrt(abs(1.0 - ratio**2))
    if root < 1e-6:
        return float(np.exp(-2.0))
    if ratio < 1.0:
        return float(np.exp(-ratio / root * (np.pi - np.arctan2(2 * ratio * root, 1 - 2 * ratio**2))))
    return float(np.exp(-2 * ratio / root * np.log(ratio + root)))


@lru_cache(maxsize=1)
def _child() -> subprocess.Popen[bytes]:
    """Start the child process: the same Python, without the libraries that conflict with jiminy's."""
    file = Path(__file__).with_name("jiminy_alone.py")
    return subprocess.Popen([sys.executable, "-P", str(file)], stdin=subprocess.PIPE, stdout=subprocess.PIPE)


def ask(name: str, *arguments: Any) -> Any:
    """Call a method of the simulation in the child process; only the last rig exists there.

    Raises
    ------
    RuntimeError
        If the call raised an error, or the process has ended.
    """
    child = _child()
    assert child.stdin is not None and child.stdout is not None
    try:
        pickle.dump((name, arguments), child.stdin)
        child.stdin.flush()
        good, answer = pickle.load(child.stdout)
    except (EOFError, OSError) as error:
        _child.cache_clear()
        raise RuntimeError("its process died") from error
    if not good:
        raise RuntimeError(answer)
    return answer


def _points(urdf: str) -> tuple[list[tuple[str, Array]], float]:
    """Return the contact points of links, and their radius: centres of balls, or corners of boxes."""
    balls: list[tuple[str, Array]] = []
    corners: list[tuple[str, Array]] = []
    radii = set()
    for link in ElementTree.fromstring(urdf).iter("link"):
        for solid in link.iter("collision"):
            origin, name = solid.find("origin"), link.attrib["name"]
            place = np.zeros(3) if origin is None else _numbers(origin.get("xyz", "0 0 0"))
            for ball in solid.iter("sphere"):
                balls.append((name, place))
                radii.add(float(ball.attrib["radius"]))
            for box in solid.iter("box"):
                half = 0.5 * _numbers(box.attrib["size"])
                corners += [(name, place + half * np.array(signs)) for signs in product((-1, 1), repeat=3)]
    if not balls:
        return corners, 0.0
    (radius,) = radii
    return balls, radius


def _numbers(text: str) -> Array:
    return np.array([float(word) for word in text.split()])


def _standing(rig: Rig, angles: Array, shift: Array) -> str:
    """Return the URDF of a fixed rig, rotated and moved by an additional link."""
    rpy, xyz = (" ".join(repr(float(x)) for x in w) for w in (angles, shift))
    hung = f'<parent link="ground"/><child link="{rig.base}"/><origin xyz="{xyz}" rpy="{rpy}"/>'
    return rig.urdf.replace("</robot>", f'<link name="ground"/><joint name="hung" type="fixed">{hung}</joint></robot>')


def _limited(urdf: str) -> str:
    # joints without limits would have other coordinates
    tree = ElementTree.fromstring(urdf)
    for joint in tree.iter("joint"):
        if joint.get("type") == "continuous":
            joint.set("type", "revolute")
            ElementTree.SubElement(joint, "limit", lower="-1e9", upper="1e9", effort="1e9", velocity="1e9")
    return ElementTree.tostring(tree, encoding="unicode")

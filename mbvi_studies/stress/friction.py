"""Stress scenes with Coulomb friction: creep, jamming, Painlevé's rod, cards, a slope, a turntable."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from mbvi.geometry.motion import Rotation
from mbvi.problem import Problem
from mbvi.results.trajectory import Trajectory
from mbvi.scene import Scene
from mbvi.scene.urdf.shipped import robot
from mbvi.system.system import Array

from .scene import StressScene, gain_or_penetration, moved

_G = 9.81
# half angle of the wedge [rad]
_WEDGE = 0.15
# lean of the cards from the vertical [rad]
_LEAN = 0.25
# joints of the standing quadruped [rad]; stiffness [N m/rad] and damping [N m s/rad] of its springs
_STANCE, _STIFFNESS, _DAMPING = np.tile([0.0, 0.6, -1.2], 4), 200.0, 1.5
# time after which the quadruped stands [s]
_STANDING = 8.0
# angular velocity of the turntable [rad/s], distance of the box from its axis [m]
_TURN, _PLACE = 2.0, 0.5


def _slope(mu: float, tangent: float, e: float = 0.0) -> Scene:
    """Return a scene with a floor that slopes along x; gravity is turned instead of the floor."""
    angle = np.arctan(tangent)
    scene = Scene(gravity=(_G * np.sin(angle), 0.0, -_G * np.cos(angle)), friction=mu, restitution=e)
    scene.add_halfspace((0, 0, 1), name="floor")
    return scene


def _block(h: float) -> Problem:
    scene = _slope(0.5, 0.9999 * 0.5)
    scene.add_box((0.2, 0.3, 0.1), 1.0, position=(0, 0, 0.05), name="block")
    return scene.build()


def _tower(h: float) -> Problem:
    """Return ten boxes on a slope; the tower would tip at a slope of 0.2."""
    scene = _slope(0.3, 0.15)
    for k in range(10):
        scene.add_box((0.2, 0.2, 0.1), 1.0, position=(0, 0, 0.05 + 0.1 * k), name=f"box {k}")
    return scene.build()


def _wedge(above: float, e: float, h: float) -> Problem:
    """Return a wedge that falls between two walls, to which its faces are parallel, from a height above its place."""
    c, s = np.cos(_WEDGE), np.sin(_WEDGE)
    scene = Scene(friction=0.5, restitution=e)
    scene.add_halfspace((c, 0, s), name="left")
    scene.add_halfspace((-c, 0, s), name="right")
    top, bottom = 0.4, 0.2
    corners = [(sign * z * s / c, y, z) for z in (bottom, top) for sign in (-1.0, 1.0) for y in (-0.1, 0.1)]
    scene.add_convex(np.array(corners), np.array([[0.0, 0.0, above]]), 1.0)
    return scene.build()


def _painleve(h: float) -> Problem:
    """Return a rod that slides on its end: 1 m long, at 30 degrees, mu = 2."""
    scene = Scene(friction=2.0, plane="xz")
    scene.add_halfspace((0, 0, 1), name="floor")
    angle, radius, length = np.pi / 6, 1e-3, 1.0
    scene.add_capsule(
        radius, length, 1.0, position=(0.0, 0.0, radius + 0.5 * length * np.sin(angle)),
        rotation=(0.0, 0.5 * np.pi + angle, 0.0), velocity=(1.0, 0.0, 0.0), name="rod",
    )  # fmt: skip
    return scene.build()


def _cards(h: float) -> Problem:
    """Return two cards that lean against each other; mu is larger than the tangent of their lean."""
    scene = Scene(friction=0.4)
    scene.add_halfspace((0, 0, 1), name="floor")
    height, thick = 0.1, 1e-3
    c, s = np.cos(_LEAN), np.sin(_LEAN)
    # the upper inner edge is at x = 0, the lower outer one on the floor
    for sign, name in ((-1.0, "left"), (1.0, "right")):
        place = (sign * 0.5 * (height * s + thick * c), 0.0, 0.5 * (height * c + thick * s))
        scene.add_box((thick, 0.06, height), 2e-3, position=place, rotation=(0.0, -sign * _LEAN, 0.0), name=name)
    return scene.build()


def _quadruped(h: float) -> Problem:
    """Return a quadruped on a slope, held by springs in its joints."""
    names = [f"{leg}_{joint}_joint" for leg in ("FL", "FR", "RL", "RR") for joint in ("hip", "thigh", "calf")]

    def hold(t: float, q: Array, v: Array) -> Array:
        return np.concatenate([np.zeros(6), _STIFFNESS * (_STANCE - q[7:]) - _DAMPING * v[6:]])

    scene = _slope(0.7, 0.3)
    joints = dict(zip(names, _STANCE.tolist(), strict=True))
    scene.add_urdf(robot("quadruped"), position=(0, 0, 0.36), joints=joints, control=hold)
    return scene.build()


def _crept(run: Trajectory) -> float:
    """Return the largest displacement of the base after it stands [m]."""
    late = run.q[run.t >= min(_STANDING, run.t[-1]), :3]
    return float(np.linalg.norm(late - late[0], axis=1).max())


def _turntable(h: float) -> Problem:
    """Return a box that turns with a turntable."""
    scene = Scene(friction=0.5)
    scene.add_halfspace((0, 0, 1), name="table", motion=Rotation((0, 0, 1), _TURN))
    scene.add_box((0.1, 0.1, 0.1), 1.0, position=(_PLACE, 0, 0.05), velocity=(0.0, _TURN * _PLACE, 0.0),
                  angular_velocity=(0.0, 0.0, _TURN), name="box")  # fmt: skip
    return scene.build()


def _off_the_table(run: Trajectory) -> float:
    """Return the largest distance of the box from its place on the turntable [m]."""
    place = _PLACE * np.column_stack([np.cos(_TURN * run.t), np.sin(_TURN * run.t)])
    return float(np.linalg.norm(run.q[:, :2] - place, axis=1).max())


def _displaced(name: str, make: Callable[[float], Problem], duration: float, held: float, failed: float) -> StressScene:
    return StressScene(name, make, duration, moved, "displacement [m, rad]", held, failed)


FRICTION = (
    _displaced("block at 0.9999 of its friction", _block, 2.0, 1e-9, 1e-3),
    _displaced("tower of ten on a slope", _tower, 0.5, 1e-6, 1e-2),
    _displaced("wedge between two walls", partial(_wedge, 0.0, 0.0), 1.0, 1e-6, 1e-3),
    StressScene(
        "wedge driven in, e = 0.5", partial(_wedge, 0.05, 0.5), 1.0, gain_or_penetration(1.0),
        "gain of energy or penetration [m]", 1e-3, 1e-2,
    ),
    StressScene(
        "rod of Painlevé", _painleve, 1.0, gain_or_penetration(1.0), "gain of energy or penetration [m]", 1e-2, 0.1
    ),
    _displaced("two cards", _cards, 1.0, 1e-4, 1e-2),
    StressScene("quadruped on a slope", _quadruped, 12.0, _crept, "creep of the base [m]", 1e-6, 1e-3),
    StressScene("box on a turntable", _turntable, 3.0, _off_the_table, "error of the place [m]", 1e-2, 0.1),
)  # fmt: skip

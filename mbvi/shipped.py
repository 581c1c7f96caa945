"""The scene of `mbvi demo`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from .scene import Scene
from .scene.urdf.shipped import robot

if TYPE_CHECKING:
    from .problem import Problem
    from .system.system import Array

# a crouch with legs slightly apart; stiffness [N m/rad] and damping [N m s/rad] of the springs that hold it
_CROUCH = {"hip": 0.1, "thigh": 0.7, "calf": -1.4}
_STIFFNESS, _DAMPING = 60.0, 2.0
_TILT = Rotation.from_euler("xyz", [0.15, 0.1, 0.0]).as_matrix()


def demo_problem() -> Problem:
    """Return the scene of `mbvi demo`: a tilted quadruped on sprung legs falls onto a floor, and a ball hits it."""
    joints: dict[str, float] = {}
    for leg in ("FL", "FR", "RL", "RR"):
        side = 1.0 if leg.endswith("L") else -1.0
        angles = {**_CROUCH, "hip": side * _CROUCH["hip"]}
        joints |= {f"{leg}_{joint}_joint": angle for joint, angle in angles.items()}
    # in the order of q
    rest = np.array(list(joints.values()))

    def legs(t: float, q: Array, v: Array) -> Array:
        # the free base comes first, 7 entries of q and 6 of v; it has no motor
        return np.concatenate([np.zeros(6), _STIFFNESS * (rest - q[7:]) - _DAMPING * v[6:]])

    scene = Scene(restitution=0.5)
    scene.add_halfspace((0.0, 0.0, 1.0), name="floor")
    scene.add_urdf(robot("quadruped"), position=(0.0, 0.0, 0.8), rotation=_TILT, joints=joints, control=legs)
    scene.add_sphere(0.1, 1.5, position=(-1.2, 0.08, 0.6), velocity=(2.0, 0.0, 2.5), name="ball")
    return scene.build()

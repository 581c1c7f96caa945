"""What can be charted, by name: problems with exact solutions, a robot, many spheres."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from ...reference import MAKERS
from ...reference.solution import Reference
from ...run.simulate import simulate
from ...scene import Scene
from ...schemes import EventDriven
from ..shipped import cube_of_spheres, robot_path
from .sweep import Case

_ROBOT_TOLERANCE = 1e-11
_TILT = Rotation.from_euler("xyz", [0.08, 0.12, 0.0]).as_matrix()
# a step of a pile takes tens of milliseconds [s]
_FEW = tuple((1e-2 * 10.0 ** -np.linspace(0.03, 0.53, 3)).tolist())


def quadruped_landing(e: float) -> Case:
    """Return the shipped quadruped landing on its feet one by one, before any limit or other link is struck.

    Its reference is a run of `EventDriven` at 1e-11: of mbvi itself, so that it shows convergence, not correctness;
    another engine that comes nearer and nearer to it shows both.
    """
    angles = {"hip": 0.0, "thigh": 0.6, "calf": -1.2}
    joints = {f"{leg}_{joint}_joint": x for leg in ("FL", "FR", "RL", "RR") for joint, x in angles.items()}
    scene = Scene(restitution=e)
    scene.add_halfspace((0.0, 0.0, 1.0), name="floor")
    velocity = {"FL_hip_joint": 0.5, "RR_thigh_joint": 1.0}
    scene.add_urdf(robot_path("quadruped"), position=(0.0, 0.0, 0.45), rotation=_TILT, joints=joints, velocity=velocity)
    problem, duration = scene.build(), 0.2
    run = simulate(problem, EventDriven(_ROBOT_TOLERANCE), duration=duration, progress=False)
    # what else would be struck, other engines have otherwise
    others = [i.time for i in run.impacts if not all(name.endswith("_foot | floor") for name in i.constraints)]
    duration = min([duration, *(0.98 * t for t in others)])
    impacts = np.array([impact.time for impact in run.impacts if impact.time <= duration])
    source = f"mbvi's own EventDriven({_ROBOT_TOLERANCE:g})"
    return Case.of(Reference("quadruped landing", problem, duration, run.at, impacts, source))


def elastic_666(e: float) -> Case:
    """Return 6 x 6 x 6 spheres dropped into an open box 2 m wide; only what energy at e = 1 does is known."""
    return Case("elastic 666", cube_of_spheres(1.0, 1.0), 1.0, "energy is kept at e = 1", plotted="energy")


def pile(e: float) -> Case:
    """Return the same spheres at e = 0, in a box that they fill, while they land; known is that nothing penetrates."""
    return Case("pile", cube_of_spheres(0.0, 0.65), 0.7, "nothing penetrates", None, "penetration", _FEW)


def _exact(make: Callable[[float], Reference], e: float) -> Case:
    return Case.of(make(e))


# each takes e; spheres have their own
CASES: dict[str, Callable[[float], Case]] = {
    **{name: partial(_exact, make) for name, make in MAKERS.items()},
    "quadruped landing": quadruped_landing,
    "elastic 666": elastic_666,
    "pile": pile,
}
# one of each kind
TELLING = ("bouncing ball", "double pendulum", "tumbling body", "quadruped landing")
# what error control is not for
MANY = ("elastic 666", "pile")

"""Cases of a chart, by name: problems with exact solutions, robots, many spheres."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from mbvi.reference import MAKERS
from mbvi.reference.solution import Reference
from mbvi.run.simulate import simulate
from mbvi.scene import Scene
from mbvi.scene.urdf.shipped import robot
from mbvi.schemes import EventDriven

from ..published_robots import PUBLISHED, published_robot
from ..spheres import cube_of_spheres
from .sweep import Case

_ROBOT_TOLERANCE = 1e-11
_TILT = Rotation.from_euler("xyz", [0.08, 0.12, 0.0]).as_matrix()
# few steps, because a step of a pile costs tens of milliseconds, and one of a robot's hulls some [s]
_FEW = tuple((1e-2 * 10.0 ** -np.linspace(0.03, 0.53, 3)).tolist())
_OF_ROBOTS = tuple((1e-2 * 10.0 ** -np.linspace(0.53, 1.03, 3)).tolist())


def quadruped_landing(e: float) -> Case:
    """Return the shipped quadruped landing on its feet one by one, until a joint limit or another link is struck.

    The reference is mbvi's own run of `EventDriven` at 1e-11. Errors of mbvi against it show convergence only; another
    engine that converges to it shows correctness, too.
    """
    angles = {"hip": 0.0, "thigh": 0.6, "calf": -1.2}
    joints = {f"{leg}_{joint}_joint": x for leg in ("FL", "FR", "RL", "RR") for joint, x in angles.items()}
    scene = Scene(restitution=e)
    scene.add_halfspace((0.0, 0.0, 1.0), name="floor")
    velocity = {"FL_hip_joint": 0.5, "RR_thigh_joint": 1.0}
    scene.add_urdf(robot("quadruped"), position=(0.0, 0.0, 0.45), rotation=_TILT, joints=joints, velocity=velocity)
    problem, duration = scene.build(), 0.2
    run = simulate(problem, EventDriven(_ROBOT_TOLERANCE), duration=duration, progress=False)
    # other engines model joint limits and link shapes differently, so the case ends before they matter
    others = [i.time for i in run.impacts if not all(name.endswith("_foot | floor") for name in i.constraints)]
    duration = min([duration, *(0.98 * t for t in others)])
    impacts = np.array([impact.time for impact in run.impacts if impact.time <= duration])
    source = f"mbvi's own EventDriven({_ROBOT_TOLERANCE:g})"
    return Case.of(Reference("quadruped landing", problem, duration, run.at, impacts, source))


def elastic_666(e: float) -> Case:
    """Return 6 x 6 x 6 spheres dropped into an open box 2 m wide, at e = 1; known is that the energy is constant."""
    return Case("elastic 666", cube_of_spheres(1.0, 1.0), 1.0, "energy is kept at e = 1", plotted="energy")


def pile(e: float) -> Case:
    """Return the same spheres at e = 0 landing in a box that they fill; known is that nothing penetrates."""
    return Case("pile", cube_of_spheres(0.0, 0.65), 0.7, "nothing penetrates", None, "penetration", _FEW)


def falling(robot: str, e: float) -> Case:
    """Return a published robot that falls from 2 cm; known is that nothing penetrates."""
    problem = published_robot(robot, 0.02, e)
    return Case(f"{robot} falling", problem, 0.5, "nothing penetrates", None, "penetration", _OF_ROBOTS)


def _exact(make: Callable[[float], Reference], e: float) -> Case:
    return Case.of(make(e))


# functions of e, which those of many spheres ignore
CASES: dict[str, Callable[[float], Case]] = {
    **{name: partial(_exact, make) for name, make in MAKERS.items()},
    "quadruped landing": quadruped_landing,
    "elastic 666": elastic_666,
    "pile": pile,
    **{f"{robot} falling": partial(falling, robot) for robot in PUBLISHED},
}
# charted by default, one of each kind
DEFAULT_CASES = ("bouncing ball", "double pendulum", "tumbling body", "quadruped landing")
# cases that EventDriven is not made for
MANY_CONSTRAINTS = ("elastic 666", "pile", *(f"{robot} falling" for robot in PUBLISHED))

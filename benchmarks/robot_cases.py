"""Cases of `robot_step.py`."""

from __future__ import annotations

import sysconfig
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import brentq

import mbvi
from mbvi.constraints import HalfSpaceContacts

Array = np.ndarray

_OWN = Path(__file__).resolve().parents[1] / "robots"
# example-robot-data's robots
_REAL = Path(sysconfig.get_path("purelib")) / "cmeel.prefix" / "share" / "example-robot-data" / "robots"
_LEGS = ("FL", "FR", "RL", "RR")
_GLIDE = 0.1


class Case(NamedTuple):
    """One case: the problem, and the torques its control returns at all times, shape (nv,) [N, N m]."""

    name: str
    problem: mbvi.Problem
    torque: Array


def again(problem: mbvi.Problem, q0: Array | None = None, v0: Array | None = None) -> mbvi.Problem:
    """Return a fresh problem, whose caches of distances hold no data of an earlier run."""
    return mbvi.Problem(
        problem.system,
        problem.constraints.constraints,
        problem.q0 if q0 is None else q0,
        problem.v0 if v0 is None else v0,
        restitution=problem.restitution,
        length=problem.length,
        scene=problem.scene,
    )


def flight() -> tuple[mbvi.Problem, Array]:
    """Swing all legs in free flight."""
    return _quadruped(1.5, _every_leg(0.0, 0.6, -1.2), velocity=_every_leg(0.3, 1.0, -1.0))


def two_feet() -> tuple[mbvi.Problem, Array]:
    """Stand on the left front and the right rear foot with bent knees; the other two feet are lifted."""
    lifted = {f"{leg}_thigh_joint": 1.9 for leg in ("FR", "RL")}

    def crouch(thigh: float) -> tuple[mbvi.Problem, Array]:
        return _quadruped(1.0, {**_every_leg(0.0, thigh, -2.4), **lifted}, held=True)

    # the centre of mass must be above the line between the feet
    return _held(*crouch(brentq(lambda thigh: _unsupported(_lowered(crouch(thigh)[0]))[4], 1.25, 1.45, xtol=1e-12)))


def four_feet() -> tuple[mbvi.Problem, Array]:
    """Stand on four feet."""
    return _held(*_quadruped(1.0, _every_leg(0.0, 0.6, -1.2), held=True))


def kneeling() -> tuple[mbvi.Problem, Array]:
    """Kneel on four feet and four knees; hips are turned so that each knee touches with one rim."""
    hip, thigh = 0.3, 0.6
    # the radii of foot and knee, half the knee's width and the calf's length are the URDF's
    rise = 0.02 * np.cos(hip) + 0.017 * np.sin(hip) - 0.023
    calf = -np.arccos(rise / (0.2 * np.cos(hip))) - thigh
    return _held(*_quadruped(1.0, _every_leg(hip, thigh, calf), held=True))


def folding() -> tuple[mbvi.Problem, Array]:
    """Collapse from a crouch on four feet, with no torque."""
    problem, torque = _quadruped(1.0, _every_leg(0.0, 0.6, -1.2))
    return _lowered(problem), torque


def flailing_in_air() -> tuple[mbvi.Problem, Array]:
    """Move the legs against each other until they collide."""
    return _quadruped(1.5, _every_leg(0.0, 0.6, -1.2), velocity=_FLAIL)


def flailing_on_floor() -> tuple[mbvi.Problem, Array]:
    """Move the legs against each other from a deep crouch on four feet."""
    problem, torque = _quadruped(0.3, _every_leg(0.0, 1.0, -2.0), velocity=_FLAIL)
    return _lowered(problem), torque


def pendulum_bouncing() -> tuple[mbvi.Problem, Array]:
    """Bounce with the tip against a wall at e = 0.5."""
    return _pendulum(distance=0.002, speed=0.3, restitution=0.5)


def pendulum_leaning() -> tuple[mbvi.Problem, Array]:
    """Lean on a wall with the tip, and slide down, at e = 0."""
    return _pendulum(distance=0.0, speed=0.0, restitution=0.0)


def panda() -> tuple[mbvi.Problem, Array]:
    """Press the sixth joint against its upper limit, others moving, gravity balanced at the start."""
    rest = {"1": 0.0, "2": -0.785, "3": 0.0, "4": -2.356, "5": 0.0, "6": 3.7525, "7": 0.785}
    joints = {f"panda_joint{k}": angle for k, angle in rest.items()}
    joints |= {"panda_finger_joint1": 0.02, "panda_finger_joint2": 0.02}
    velocity = {f"panda_joint{k}": rate for k, rate in (("1", 0.8), ("2", 0.4), ("3", -0.6), ("4", 0.5), ("7", 1.0))}
    file = _REAL / "panda_description" / "urdf" / "panda.urdf"
    problem, torque = _robot(mbvi.Scene(), file, 9, True, base="fixed", joints=joints, velocity=velocity)
    system = problem.system
    torque -= system.force(problem.t0, problem.q0, np.zeros(system.nv))
    torque[5] += 3.0
    return problem, torque


def talos() -> tuple[mbvi.Problem, Array]:
    """Stand on two flat feet of four corners each; soles are boxes, because those of other variants are convex."""
    legs = {f"leg_{side}_{k}_joint": a for side in ("left", "right") for k, a in ((3, -0.4), (4, 0.8), (5, -0.4))}
    arms = {f"arm_{side}_2_joint": sign * 0.3 for side, sign in (("left", 1), ("right", -1))}
    arms |= {f"arm_{side}_4_joint": -0.5 for side in ("left", "right")}
    arms |= {f"gripper_{side}_joint": -0.2 for side in ("left", "right")}
    file = _REAL / "talos_data" / "robots" / "talos_reduced_box.urdf"
    return _held(*_robot(_floor(), file, 38, True, position=(0.0, 0.0, 1.3), joints=legs | arms))


# gains of the joints of a robot that is pushed [N m/rad, N m s/rad]
STIFFNESS, DAMPING = 80.0, 1.0


def pushed(mu: float) -> tuple[mbvi.Problem, Array]:
    """Stand on four feet under a PD control with a push: it sways on its feet, or glides without friction."""
    still, torque = four_feet()
    control, scene = mbvi.PDControl(still.q0[7:], STIFFNESS, DAMPING, torque=torque[6:]), _floor(mu)
    scene.add_urdf(_OWN / "quadruped" / "quadruped.urdf", control=control, position=(0.0, 0.0, 1.0))
    return scene.build(reduce=()).at(still.q0, still.v0), torque


def _every_leg(hip: float, thigh: float, calf: float) -> dict[str, float]:
    """Return the same for each leg, by joint; a positive hip turns its leg outwards on either side."""
    return {
        f"{leg}_{joint}_joint": value * (-1.0 if joint == "hip" and leg[1] == "R" else 1.0)
        for leg in _LEGS
        for joint, value in (("hip", hip), ("thigh", thigh), ("calf", calf))
    }


_FLAIL = _every_leg(-4.0, 0.0, 0.0) | {
    f"{leg}_{joint}_joint": sign * rate
    for leg, sign in zip(_LEGS, (1, 1, -1, -1), strict=True)
    for joint, rate in (("thigh", 6.0), ("calf", -4.0))
}


def _floor(mu: float = 0.0) -> mbvi.Scene:
    scene = mbvi.Scene(restitution=0.0, friction=mu)
    scene.add_halfspace(normal=(0.0, 0.0, 1.0), offset=0.0)
    return scene


def _robot(scene: mbvi.Scene, file: Path, nv: int, held: bool = False, **options: Any) -> tuple[mbvi.Problem, Array]:
    """Return a robot and its torques, which are zero until a case sets them."""
    control = mbvi.ConstantTorque(np.zeros(nv))
    scene.add_urdf(file, control=control if held else None, mimic=False, **options)
    # the control's own array, which the cases write to
    return scene.build(reduce=()), control.table.torque[0]


def _quadruped(
    height: float, joints: dict[str, float], held: bool = False, **options: Any
) -> tuple[mbvi.Problem, Array]:
    file = _OWN / "quadruped" / "quadruped.urdf"
    return _robot(_floor(), file, 18, held, position=(0.0, 0.0, height), joints=joints, **options)


def _pendulum(distance: float, speed: float, restitution: float) -> tuple[mbvi.Problem, Array]:
    """Return the folded double pendulum, with distance [m] and speed [m/s] of its tip towards a wall."""
    scene = mbvi.Scene(restitution=restitution)
    scene.add_halfspace(normal=(1.0, 0.0, 0.0), offset=-0.2)
    # links of 1 m, the tip a ball of 55 mm
    upper = -0.7
    lower = np.pi - np.arcsin(0.145 - distance - np.sin(upper))
    joints, velocity = {"shoulder": upper, "elbow": lower - upper}, {"elbow": speed / np.cos(lower)}
    file = _OWN / "double_pendulum" / "double_pendulum.urdf"
    return _robot(scene, file, 2, base="fixed", joints=joints, velocity=velocity)


def _lowered(problem: mbvi.Problem) -> mbvi.Problem:
    """Return the problem with its robot lowered until it touches the floor."""
    (floor,) = (c for c in problem.constraints.constraints if isinstance(c, HalfSpaceContacts))
    q0 = problem.q0.copy()
    q0[2] -= floor.gap(problem.t0, q0).min()
    return again(problem, q0)


def _unsupported(problem: mbvi.Problem) -> Array:
    """Return the part of a robot's weight that contact forces cannot carry at rest, shape (nv,)."""
    system = problem.system
    weight = system.force(problem.t0, problem.q0, np.zeros(system.nv))
    J = problem.constraints.active(problem.t0, problem.q0, 1e-6).jacobian
    # contact forces carry the six directions of the base, motors the rest
    return weight + J.T @ np.linalg.lstsq(J[:, :6].T, -weight[:6], rcond=None)[0]


def _held(problem: mbvi.Problem, torque: Array) -> tuple[mbvi.Problem, Array]:
    """Lower a robot to the floor, set joint torques that hold it, and let it glide over the floor.

    At rest it would repeat the same q bit for bit and be served from what is kept per q.
    """
    problem = _lowered(problem)
    torque[6:] = -_unsupported(problem)[6:]
    v0 = problem.v0.copy()
    v0[0] = _GLIDE
    return again(problem, v0=v0), torque


# functions that build a case, by title, in the order of the table
CASES: dict[str, Callable[[], tuple[mbvi.Problem, Array]]] = {
    "quadruped, free flight": flight,
    "quadruped, two feet standing": two_feet,
    "quadruped, four feet standing": four_feet,
    "quadruped, kneeling": kneeling,
    "quadruped, legs folding": folding,
    "quadruped, flailing in the air": flailing_in_air,
    "quadruped, flailing on the floor": flailing_on_floor,
    "pendulum, bouncing at a wall": pendulum_bouncing,
    "pendulum, leaning on a wall": pendulum_leaning,
    "Panda, joint at its limit": panda,
    "Talos, standing": talos,
}

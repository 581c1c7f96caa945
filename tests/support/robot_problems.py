"""Robots of the project and published ones, each dropped onto a floor or moving at its joint limits."""

import pickle
import warnings
import xml.etree.ElementTree as ElementTree
from functools import cache, wraps

import numpy as np
import pinocchio as pin

import mbvi
from mbvi.constraints import HalfSpaceContacts
from support.paths import ROBOTS, real_robot

OWN = {"arm": "fixed", "biped": "free", "double_pendulum": "fixed", "hopper": "free", "quadruped": "free"}
REAL = {
    "ur5": ("ur_description/urdf/ur5_robot.urdf", "fixed"),
    "panda": ("panda_description/urdf/panda.urdf", "fixed"),
    "solo12": ("solo_description/robots/solo12.urdf", "free"),
    "talos": ("talos_data/robots/talos_reduced.urdf", "free"),
}
# in the middle of its joints' ranges a self-collision of the UR5 and of Talos is inadmissible
KINDS = {name: ("fall",) if name in ("ur5", "talos") else ("fall", "limits") for name in (*OWN, *REAL)}


def is_free(name):
    return (OWN[name] if name in OWN else REAL[name][1]) == "free"


def path_of(name):
    return ROBOTS / name / f"{name}.urdf" if name in OWN else real_robot(REAL[name][0])


def built_once(make):
    """Return copies of the problem that a function makes once of its arguments: a published robot takes seconds."""
    pickled = cache(lambda *given, **named: pickle.dumps(make(*given, **named)))
    return wraps(make)(lambda *given, **named: pickle.loads(pickled(*given, **named)))


@built_once
def problem_of(name, kind, e, mimic=True):
    """A robot one centimetre above a floor, or a fixed one; with `limits` four in ten joints run into one."""
    path, free = path_of(name), is_free(name)
    # loaders of some descriptions warn about what they leave out
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        joints, velocity = state_of(path, free, kind, np.random.default_rng(len(name)), mimic)

        def build(height):
            scene = mbvi.Scene(restitution=e)
            if free:
                scene.add_halfspace(normal=(0, 0, 1), offset=0.0)
            if name == "double_pendulum":
                scene.add_halfspace(normal=(-1, 0, 0), offset=-0.2)
            where = {"position": (0, 0, height)} if free else {}
            start = {"joints": joints, "velocity": velocity} if kind == "limits" else {}
            scene.add_urdf(path, base="free" if free else "fixed", mimic=mimic, **start, **where)
            return scene.build()

        if not free:
            return build(0.0)
        above = build(5.0)
        floor = next(c for c in above.constraints.constraints if isinstance(c, HalfSpaceContacts))
        problem = build(5.01 - floor.gap(0.0, above.q0).min())
    v0 = problem.v0.copy()
    v0[2] = -0.5
    return mbvi.Problem(
        problem.system, problem.constraints.constraints, problem.q0, v0, restitution=problem.restitution,
        length=problem.length, scene=problem.scene,
    )  # fmt: skip


def state_of(path, free, kind, rng, mimic):
    """Positions and velocities of the joints by name, where joints mimic others without those."""
    model = pin.buildModelFromUrdf(str(path), *([pin.JointModelFreeFlyer()] if free else []))
    joints, velocity = {}, {}
    for joint in range(2 if free else 1, model.njoints):
        if model.nqs[joint] != 1:
            continue
        name, k = model.names[joint], model.idx_qs[joint]
        lower, upper = model.lowerPositionLimit[k], model.upperPositionLimit[k]
        if kind == "limits" and np.isfinite(lower) and np.isfinite(upper) and upper - lower < 20.0:
            near = rng.random() < 0.4
            joints[name] = upper - 0.02 * (upper - lower) * rng.random() if near else 0.5 * (lower + upper)
            velocity[name] = 1.0 if near else 0.3 * rng.normal()
        else:
            velocity[name] = 0.3 * rng.normal()
    for joint in ElementTree.parse(path).getroot().findall("joint"):
        if mimic and joint.find("mimic") is not None:
            joints.pop(joint.get("name"), None)
            velocity.pop(joint.get("name"), None)
    return joints, velocity


def tilted_quadruped():
    """A quadruped 5 cm above a floor whose feet land one after the other, e = 0."""
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf("robot:quadruped", position=(0, 0, 0.6))
    problem = scene.build()
    turn = np.zeros(problem.system.nv)
    turn[3:5] = 0.03, 0.021
    q, rows = problem.system.integrate(problem.q0, turn), problem.constraints
    floor = [k for k in range(len(rows)) if "floor" in rows.name(k)]
    q = q.copy()
    q[2] += 0.05 - float(rows.gap(0.0, q)[floor].min())
    return problem.at(q, problem.v0)

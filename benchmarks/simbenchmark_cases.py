"""The tests of SimBenchmark: scenes for mbvi and for MuJoCo, and the error of each, a mean of squares over all steps.

Definitions: github.com/leggedrobotics/SimBenchmark at commit 3fd1764, benchmark/include/*Benchmark.hpp and
benchmark/res/yaml. Each function `observe_...` gets the states before each step, as an engine's adapter returns them.
The robot is ANYmal B of example-robot-data, not the file of that repository; at 0.54 m its feet are 47 mm above the
ground. Bodies start in contact exactly, not 2e-5 m deep; grains have numpy's random numbers.
"""

from __future__ import annotations

import sysconfig
import xml.etree.ElementTree as ET
from collections.abc import Callable
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from scipy.spatial import cKDTree

import mbvi

Array = np.ndarray

ANYMAL = Path("cmeel.prefix/share/example-robot-data/robots/anymal_b_simple_description/robots/anymal.urdf")
G = 9.81

# rolling: a box under a force on the ground, balls on the box
BALL_MASS, BOX_MASS, BALLS, PUSH = 1.0, 10.0, 5, 150.0
MU_GROUND_BOX, MU_BOX_BALL, MU_GROUND_BALL = 0.4, 0.8, 0.5
DIRECTION = np.array([0.5, 0.5 * np.sqrt(3.0), 0.0])
# bouncing, 666, elastic 666
RADIUS, MASS, BOUNCING, HEIGHT = 0.1, 10.0, 7, 5.0
SIX, GRID, PERTURBATION, LOW, HIGH, SEED = 6, 0.21, 1e-3, 0.101, 1.101, 42
# ANYmal: angles of each leg in the order of the file's legs, gains, places and speeds
LEGS = {"LF": (0.03, 0.4, -0.8), "RF": (-0.03, 0.4, -0.8), "LH": (0.03, -0.4, 0.8), "RH": (-0.03, -0.4, 0.8)}
JOINTS = {f"{leg}_{joint}": a for leg, s in LEGS.items() for joint, a in zip(("HAA", "HFE", "KFE"), s, strict=True)}
STIFFNESS, DAMPING, FRICTION, STAND = 40.0, 1.0, 0.8, 0.54
ALOFT, BALL_RADIUS, FAR, SPEED, PUSHED, DROPPED = 2.0, 0.2, -5.0, 5.0, 1.0, 2.0
# joint limits that no leg reaches
NO_LIMIT = "1000"


class States(NamedTuple):
    """What an engine knows before each of n steps, of a test's bodies; what a test does not read may be left out.

    Attributes
    ----------
    centres, velocities : ndarray, shape (n, bodies, 3)
        Of the bodies in the order of the test [m, m/s].
    energy : ndarray, shape (n,)
        Kinetic and potential [J].
    momentum : ndarray, shape (n, 3)
        Of all bodies [kg m/s].
    """

    centres: Array = np.empty((0, 0, 3))
    velocities: Array = np.empty((0, 0, 3))
    energy: Array = np.empty(0)
    momentum: Array = np.empty((0, 3))


def rolling_accelerations() -> tuple[float, float]:
    """Return the accelerations of the box and of each ball along the force, while the box slides and balls roll.

    Each ball has m a = f and, about its centre, (2/5) m r^2 alpha = f r. It rolls, a + r alpha = A, so that
    f = (2/7) m A, and A is that of the box: M A = F - mu (M + n m) g - n f.
    """
    n = BALLS**2
    box = (PUSH - MU_GROUND_BOX * (BOX_MASS + n * BALL_MASS) * G) / (BOX_MASS + n * BALL_MASS * 2.0 / 7.0)
    return box, 2.0 / 7.0 * box


def rolling_error(states: States, h: float) -> float:
    """Return the error of rolling [m^2/s^2]: the squared errors of the velocities of the box and the first ball."""
    times = h * np.arange(len(states.velocities))
    exact = times[:, None, None] * np.array(rolling_accelerations())[:, None] * DIRECTION
    return float(((states.velocities - exact) ** 2).sum(axis=(1, 2)).mean())


def bouncing_error(states: States, h: float) -> float:
    """Return the error of bouncing [J^2], from the energy m g H of all balls."""
    return float(((states.energy - BOUNCING**2 * MASS * G * HEIGHT) ** 2).mean())


def drift_error(states: States, h: float) -> float:
    """Return the error of the energy [J^2], from that of the first state."""
    return float(((states.energy - states.energy[0]) ** 2).mean())


def overlap_error(states: States, h: float) -> float:
    """Return the error of 666 [m^2]: the sum of the squared depths of all pairs and at the floor."""
    return float(np.mean([_overlaps(centres) for centres in states.centres]))


def _overlaps(centres: Array) -> float:
    pairs = cKDTree(centres).query_pairs(2.0 * RADIUS, output_type="ndarray")
    apart = np.linalg.norm(centres[pairs[:, 0]] - centres[pairs[:, 1]], axis=1)
    sunk = np.maximum(RADIUS - centres[:, 2], 0.0)
    return float(((2.0 * RADIUS - apart) ** 2).sum() + (sunk**2).sum())


def momentum_error(states: States, h: float) -> float:
    """Return the error of the momentum [kg^2 m^2/s^2], from that of the ball at the start."""
    return float(((states.momentum - [0.0, MASS * SPEED, 0.0]) ** 2).sum(axis=1).mean())


def creep_error(states: States, h: float) -> float:
    """Return the mean square of the way of the base from where it was after a fifth of the run [m^2]."""
    place = states.centres[len(states.centres) // 5 :, 0]
    return float(((place - place[0]) ** 2).sum(axis=1).mean())


def six_centres(height: float) -> Array:
    """Return the centres of the 216 balls, shape (216, 3) [m]."""
    grid = np.array(list(np.ndindex(SIX, SIX, SIX)), float)
    centres = GRID * grid + PERTURBATION * np.random.default_rng(SEED).random(grid.shape)
    return centres + np.array([0.0, 0.0, height])


def bouncing_centres() -> Array:
    """Return the centres of the 49 balls, shape (49, 3) [m]."""
    return np.array([(2.0 * i, 2.0 * j, HEIGHT) for i, j in np.ndindex(BOUNCING, BOUNCING)])


def rolling_centres() -> Array:
    """Return the centres of the box and the 25 balls, shape (26, 3) [m]."""
    return np.array([(0.0, 0.0, 0.5), *((2.0 * i - 4.0, 2.0 * j - 4.0, 1.5) for i, j in np.ndindex(BALLS, BALLS))])


def rolling_problem() -> mbvi.Problem:
    """Return the box that is pushed, with its balls."""
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1), name="ground")
    box, *balls = rolling_centres()
    scene.add_box((20, 20, 1), mass=BOX_MASS, position=box, name="box")
    names = [scene.add_sphere(radius=0.5, mass=BALL_MASS, position=ball) for ball in balls]
    scene.set_friction("box", "ground", MU_GROUND_BOX)
    for name in names:
        scene.set_friction(name, "box", MU_BOX_BALL)
        scene.set_friction(name, "ground", MU_GROUND_BALL)
    force = np.concatenate([PUSH * DIRECTION, np.zeros(3)])
    scene.add_force("box", lambda t, q, v: force)
    return scene.build()


def balls_problem(centres: Array, e: float) -> mbvi.Problem:
    """Return balls above a floor without friction."""
    scene = mbvi.Scene(restitution=e)
    scene.add_halfspace((0, 0, 1), name="ground")
    scene.add_spheres(positions=centres, radius=RADIUS, mass=MASS)
    return scene.build()


@cache
def anymal_text(shapes: bool = True) -> str:
    """Return the file of ANYmal B without joint limits and meshes, and without shapes if they are not wanted.

    Raises
    ------
    SystemExit
        If example-robot-data is not installed.
    """
    file = Path(sysconfig.get_path("purelib")) / ANYMAL
    if not file.is_file():
        raise SystemExit("ANYmal comes with example-robot-data, which is not installed: pip install mbvi[test]")
    root = ET.parse(file).getroot()
    # the link that carries the inertia of the base is fixed to it in the same place; MuJoCo wants it in the base
    carrier = root.find("link[@name='base_inertia']")
    base = root.find("link[@name='base']")
    for weightless in base.findall("inertial"):
        base.remove(weightless)
    base.append(carrier.find("inertial"))
    root.remove(carrier)
    root.remove(next(j for j in root.findall("joint") if j.find("child").get("link") == "base_inertia"))
    for link in root.iter("link"):
        for part in link.findall("visual") + ([] if shapes else link.findall("collision")):
            link.remove(part)
    for limit in root.iter("limit"):
        limit.set("lower", "-" + NO_LIMIT)
        limit.set("upper", NO_LIMIT)
    return ET.tostring(root, encoding="unicode")


def anymal_scene(
    height: float,
    control: mbvi.PDControl | mbvi.CompiledControl | None = None,
    *,
    shapes: bool = True,
    **options: object,
) -> mbvi.Scene:
    """Return ANYmal with its base at a height over the ground; without shapes there is no ground.

    Other options are those of `Scene`.
    """
    scene = mbvi.Scene(**options)
    if shapes:
        scene.add_halfspace((0, 0, 1), name="ground")
    with TemporaryDirectory() as folder:
        file = Path(folder, "anymal.urdf")
        file.write_text(anymal_text(shapes))
        scene.add_urdf(file, position=(0, 0, height), joints=JOINTS, control=control, name="anymal")
    return scene


def standing_problem() -> mbvi.Problem:
    """Return ANYmal above its feet under its control."""
    names = anymal_scene(ALOFT).build().model("anymal").names
    target = np.array([JOINTS[name] for name in names if name in JOINTS])
    control = mbvi.PDControl(target, STIFFNESS, DAMPING)
    return anymal_scene(STAND, control, friction=FRICTION).build()


def momentum_problem() -> mbvi.Problem:
    """Return ANYmal without weight, and the ball that will strike it."""
    scene = anymal_scene(ALOFT, gravity=(0, 0, 0))
    place, velocity = (0.0, FAR, ALOFT), (0.0, SPEED, 0.0)
    scene.add_sphere(radius=BALL_RADIUS, mass=MASS, position=place, velocity=velocity, name="ball")
    return scene.build()


def lifting_torque(mass: float) -> Callable[[float, Array, Array, Array], None]:
    """Return a control that pushes the base up with twice the weight of the robot, in the world frame."""
    force = 2.0 * mass * G

    def push(t: float, q: Array, v: Array, tau: Array) -> None:
        x, y, z, w = q[3], q[4], q[5], q[6]
        # the third row of the rotation matrix of the base, whose velocity is in its own axes
        tau[0] = 2.0 * (x * z - w * y) * force
        tau[1] = 2.0 * (y * z + w * x) * force
        tau[2] = (1.0 - 2.0 * (x * x + y * y)) * force

    return push


def energy_problems() -> tuple[mbvi.Problem, mbvi.Problem]:
    """Return ANYmal while it is pushed up, and while it flies; its legs do not meet."""
    flying = anymal_scene(ALOFT, shapes=False).build()
    model = flying.model("anymal")
    control = mbvi.CompiledControl(lifting_torque(pin.computeTotalMass(model)), model.nq, model.nv)
    return anymal_scene(ALOFT, control, shapes=False).build(), flying


class Trial(NamedTuple):
    """A test of SimBenchmark, under a name that pytest does not collect.

    Attributes
    ----------
    title : str
        Its name there.
    duration : float
        Simulated time, of the last part where there are two [s].
    step, steps
        The step of the table, and those of the picture [s].
    error : callable
        error(states, h), and `unit`, its unit.
    what : str
        What its error is.
    """

    title: str
    duration: float
    step: float
    steps: tuple[float, ...]
    error: Callable[[States, float], float]
    unit: str
    what: str


MANY, FEW = (4e-4, 1e-3, 4e-3, 1e-2), (1e-3, 4e-3, 1e-2)
TRIALS = {
    "rolling": Trial("rolling", 4.0, 1e-3, FEW, rolling_error, "m^2/s^2", "velocities of the box and one ball"),
    "bouncing": Trial("bouncing, e = 1", 20.0, 1e-3, MANY, bouncing_error, "J^2", "energy"),
    "666": Trial("666", 10.0, 1e-3, FEW, overlap_error, "m^2", "depths, summed over all contacts"),
    "elastic 666": Trial("elastic 666", 10.0, 1e-3, FEW, drift_error, "J^2", "energy"),
    "momentum": Trial("ANYmal momentum", 10.0, 1e-3, FEW, momentum_error, "kg^2 m^2/s^2", "momentum"),
    "energy": Trial("ANYmal energy", DROPPED, 1e-3, MANY, drift_error, "J^2", "energy"),
    "PD": Trial("ANYmal PD control", 250.0, 5e-3, (1e-3, 5e-3), creep_error, "m^2", "way of the base"),
}

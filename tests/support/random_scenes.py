"""Random scenes with everything that the API offers, the same at any unit of length and of mass.

`random_scene(seed)` draws its parts; `random_scene(seed, length=s, mass=k)` is the same scene with lengths, velocities
and gravity times s and masses times k, whose motion is that of the first times s.
"""

from __future__ import annotations

import tempfile
import xml.etree.ElementTree as ElementTree
from functools import cache
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import mbvi
from support.paths import ROBOTS

SHAPES = ("sphere", "box", "ellipsoid", "capsule", "cylinder", "hull")
BASES = {"arm": "fixed", "biped": "free", "double_pendulum": "fixed", "hopper": "free", "quadruped": "free"}
# no body added by `add_shape` reaches farther from its origin [m]
BOUND = 0.19


@cache
def scaled_robot(name: str, length: float, mass: float) -> Path:
    """Return a URDF of one of the project's robots with lengths and masses in other units."""
    root = ElementTree.parse(ROBOTS / name / f"{name}.urdf").getroot()
    units = {
        "xyz": length, "size": length, "radius": length, "length": length, "value": mass,
        **{f"i{axes}": mass * length**2 for axes in ("xx", "xy", "xz", "yy", "yz", "zz")},
    }  # fmt: skip
    for joint in root.iter("joint"):
        # of a sliding joint limits are lengths and damping is a force over a speed
        turns = joint.get("type") != "prismatic"
        for limit in joint.iter("limit"):
            for key in ("lower", "upper"):
                if not turns and limit.get(key):
                    limit.set(key, repr(float(limit.get(key)) * length))
        for dynamics in joint.iter("dynamics"):
            for key in ("damping", "friction"):
                if dynamics.get(key):
                    factor = mass * length**2 if turns else mass
                    dynamics.set(key, repr(float(dynamics.get(key)) * factor))
    for element in root.iter():
        if element.tag == "axis":
            continue
        for key, factor in units.items():
            if element.get(key) and not (key == "value" and element.tag != "mass"):
                element.set(key, " ".join(repr(float(x) * factor) for x in element.get(key).split()))
    folder = Path(tempfile.mkdtemp(prefix="mbvi-robot-"))
    file = folder / f"{name}.urdf"
    ElementTree.ElementTree(root).write(file)
    return file


@cache
def stl() -> Path:
    """Return a mesh file: an octahedron of three different half axes."""
    corners = np.array([[0.15, 0, 0], [-0.15, 0, 0], [0, 0.1, 0], [0, -0.1, 0], [0, 0, 0.12], [0, 0, -0.12]])
    faces = [(0, 2, 4), (2, 1, 4), (1, 3, 4), (3, 0, 4), (2, 0, 5), (1, 2, 5), (3, 1, 5), (0, 3, 5)]
    lines = ["solid part"]
    for face in faces:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += [f"vertex {x!r} {y!r} {z!r}" for x, y, z in corners[list(face)].tolist()]
        lines += ["endloop", "endfacet"]
    file = Path(tempfile.mkdtemp(prefix="mbvi-part-")) / "part.stl"
    file.write_text("\n".join([*lines, "endsolid part", ""]))
    return file


def add_shape(scene, kind, rng, length=1.0, mass=1.0, *, fixed=False, motion=None, still=False, at=(0.0, 0.0, 0.0)):
    """Add one body of a random size, pose and, unless it is to be still, velocity; return its name."""
    a, b, c = 0.05 + 0.05 * rng.random(3)
    turn = Rotation.from_rotvec(rng.normal(size=3)).as_matrix()
    velocity, spin = np.zeros((2, 3)) if still or fixed or motion else rng.normal(size=(2, 3))
    place = {"position": length * np.asarray(at), "fixed": fixed, "motion": motion}
    if kind == "sphere":
        return scene.add_sphere(length * a, mass, velocity=length * velocity, **place)
    body = {"rotation": turn, "velocity": length * velocity, "angular_velocity": spin, **place}
    if kind == "box":
        return scene.add_box((2 * length * a, 2 * length * b, 2 * length * c), mass, **body)
    if kind == "ellipsoid":
        return scene.add_ellipsoid((length * a, length * b, length * c), mass, **body)
    if kind == "capsule":
        return scene.add_capsule(length * a, length * b, mass, **body)
    if kind == "cylinder":
        return scene.add_cylinder(length * a, 2 * length * b, mass, **body)
    if kind == "hull":
        return scene.add_mesh(stl(), mass, length, **body)
    raise ValueError(kind)


def add_boxes_of(scene, count, rng, length=1.0, mass=1.0, at=(0.0, 0.0, 0.3), speed=1.0):
    """Add a cubic heap of boxes with room between them."""
    side = int(np.ceil(count ** (1 / 3)))
    sites = 2.2 * BOUND * np.indices((side, side, side)).reshape(3, -1).T[:count] + np.asarray(at)
    size = 0.1 + 0.08 * rng.random(3)
    scene.add_boxes(
        length * sites, length * size, mass,
        rotations=Rotation.random(count, random_state=rng.integers(1 << 30)).as_matrix(),
        velocities=length * speed * rng.normal(size=(count, 3)),
    )  # fmt: skip


def add_robot(scene, name, rng, length=1.0, mass=1.0, at=(0.0, 0.0, 0.0), control=None):
    """Add one of the project's robots."""
    where = {"position": length * np.asarray(at)}
    return scene.add_urdf(
        scaled_robot(name, length, mass),
        base=BASES[name],
        name=f"{name}{rng.integers(1 << 20)}",
        control=control,
        **where,
    )


def random_scene(seed, length=1.0, mass=1.0, restitution=None):
    """Return a scene drawn from everything that scenes may hold: a `mbvi.Scene` that is not built yet.

    Parameters
    ----------
    seed : int
        What is drawn.
    length, mass : float
        What lengths, velocities and gravity, and what masses are multiplied by.
    restitution : float, optional
        Of all contacts; by default drawn, with some pairs of their own.
    """
    rng = np.random.default_rng(seed)
    e = float(rng.choice([0.0, 0.3, 0.5, 0.9])) if restitution is None else restitution
    plane = "xz" if rng.random() < 0.15 else None
    scene = mbvi.Scene(gravity=(0.0, 0.0, -9.81 * length), restitution=e, plane=plane)
    if plane:
        _planar(scene, rng, length, mass)
        return scene
    floor = _floor(scene, rng, length)
    kind = rng.choice(["bodies", "heap", "grains", "robot", "mixed"], p=[0.4, 0.15, 0.15, 0.2, 0.1])
    names = []
    if kind in ("bodies", "mixed"):
        for k in range(int(rng.integers(2, 9))):
            at = (0.45 * (k % 3) - 0.45, 0.45 * (k // 3) - 0.45, 0.5 + 0.1 * rng.random())
            names.append(add_shape(scene, rng.choice(SHAPES), rng, length, mass, at=at))
        for k in range(int(rng.integers(0, 3))):
            motion = None
            if rng.random() < 0.4:
                motion = mbvi.motion.Oscillation(length * np.array([0.0, 0.0, 0.02]), 3.0)
            at = (0.5 * k - 0.4, 0.2, 0.1)
            add_shape(scene, rng.choice(SHAPES), rng, length, mass, fixed=motion is None, motion=motion, at=at)
    if kind in ("heap", "mixed"):
        add_boxes_of(scene, int(rng.integers(4, 16)), rng, length, mass, at=(-0.5, -0.5, 1.0))
    if kind in ("grains", "mixed"):
        _grains(scene, rng, length, mass)
    if kind == "robot":
        name = str(rng.choice(sorted(BASES)))
        names.append(add_robot(scene, name, rng, length, mass, at=(0.0, 0.0, 1.0)))
        names.append(add_shape(scene, rng.choice(SHAPES), rng, length, mass, at=(0.6, 0.6, 0.6)))
    if restitution is None and names and rng.random() < 0.3:
        scene.set_restitution(names[0], floor, float(rng.random()))
    return scene


def _floor(scene, rng, length):
    """Add a floor, a container, or a moving floor; return its name."""
    kind = rng.choice(["floor", "tilted", "container", "shaken"])
    if kind == "container":
        return scene.add_container(length * np.array([-2.0, -2.0, 0.0]), length * np.array([2.0, 2.0]))
    if kind == "shaken":
        motion = mbvi.motion.Oscillation(length * np.array([0.0, 0.0, 0.02]), 4.0)
        return scene.add_halfspace((0, 0, 1), -0.05 * length, motion=motion)
    return scene.add_halfspace((0.1 * (kind == "tilted"), 0, 1), -0.15 * length)


def _grains(scene, rng, length, mass):
    """Add spheres in bulk, on a mesh, and from a packing."""
    shape = rng.integers(2, 5, size=3)
    radius = 0.05 if rng.random() < 0.5 else mbvi.packing.uniform(0.03, 0.05)
    centres, radii = mbvi.packing.lattice(
        shape, radius, 0.125, (-0.2, -0.2, 2.0), jitter=0.01, seed=int(rng.integers(1000))
    )
    scene.add_spheres(length * centres, length * radii, mass)
    if rng.random() < 0.5 and not scene._items.bodies:
        vertices, triangles = mbvi.surfaces.funnel(0.8, 0.15, 0.6)
        scene.add_surface(length * vertices, triangles, position=length * np.array([0.0, 0.0, 1.2]))


def _planar(scene, rng, length, mass):
    """Fill a planar scene."""
    scene.add_halfspace((0, 0, 1), 0.0)
    for k in range(int(rng.integers(2, 6))):
        at = length * np.array([0.45 * k, 0.0, 0.3 + 0.2 * rng.random()])
        move = {"position": at, "velocity": length * np.array([rng.normal(), 0.0, rng.normal()])}
        if rng.random() < 0.5:
            scene.add_sphere(0.1 * length, mass, **move)
        else:
            turn = Rotation.from_euler("y", rng.normal()).as_matrix()
            scene.add_box(length * np.array([0.2, 0.1, 0.15]), mass, rotation=turn, **move)

"""Models of free bodies for other engines: shapes, masses, planes, and the map between coordinates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np

from mbvi.errors import MbviError
from mbvi.geometry.shapes.shapes import Box, Sphere
from mbvi.problem import Problem
from mbvi.run.simulate import steps
from mbvi.schemes import Centered

from .rig import Array

# step for computing the speed of the first impact [s]
_STEP = 1e-3


class NoModelError(MbviError):
    """A problem has no model in another engine."""


class Poses(NamedTuple):
    """Poses and velocities of bodies in the world: shapes (n, 3), (n, 4) as x, y, z, w, (n, 3) and (n, 3)."""

    position: Array
    quaternion: Array
    linear: Array
    angular: Array


@dataclass(frozen=True)
class Body:
    """A free body; its frame is at the centre of mass, along the principal axes.

    Attributes
    ----------
    shape : Sphere or Box
        Collision shape.
    mass : float
        [kg].
    inertia : ndarray, shape (3,)
        Principal moments [kg m^2].
    places : ndarray, shape (k, 3)
        Positions of k copies of the shape in the body [m].
    """

    shape: Sphere | Box
    mass: float
    inertia: Array
    places: Array = field(default_factory=lambda: np.zeros((1, 3)))

    @property
    def turns(self) -> bool:
        """Whether the rotation matters; without friction that of a single ball does not."""
        return not (isinstance(self.shape, Sphere) and len(self.places) == 1)


@dataclass(frozen=True)
class Bodies:
    """Free bodies without friction, as a model for other engines.

    Attributes
    ----------
    bodies : tuple of Body
        In the order of `Poses`.
    planes : tuple of (ndarray, float)
        Normal and offset; bodies are where normal . x >= offset.
    gravity : ndarray, shape (3,)
        [m/s^2].
    e : float
        Restitution of all contacts.
    state : callable
        (q, v) -> Poses.
    coordinates : callable
        Poses -> (q, v).
    closing : float
        Speed of the first impact [m/s], for engines whose restitution depends on it.
    fixed : tuple of (Box, ndarray)
        Boxes of the world and their centres, along its axes.
    """

    bodies: tuple[Body, ...]
    planes: tuple[tuple[Array, float], ...]
    gravity: Array
    e: float
    state: Callable[[Array, Array], Poses]
    coordinates: Callable[[Poses], tuple[Array, Array]]
    closing: float
    fixed: tuple[tuple[Box, Array], ...] = ()


def rotated(quaternion: Array, vector: Array, sense: float = 1.0) -> Array:
    """Return vectors, shape (n, 3), rotated by unit quaternions, or inversely if `sense` is -1; NaN stays NaN."""
    axis, w = sense * quaternion[:, :3], quaternion[:, 3:]
    across = 2.0 * np.cross(axis, vector)
    return np.asarray(vector + w * across + np.cross(axis, across))


class BodiesEngine(Protocol):
    """An adapter of an engine with free bodies, at one step; see `Engine`."""

    settings: str
    continuous: bool

    def __init__(self, model: Bodies, h: float) -> None: ...

    def start(self, state: Poses) -> None:
        """Set poses and velocities."""

    def advance(self) -> None:
        """Advance by one step."""

    def read(self) -> Poses:
        """Return poses and velocities."""


def of_scene(problem: Problem, duration: float) -> Bodies:
    """Return the bodies of a problem that a `Scene` built.

    Raises
    ------
    NoModelError
        If the scene has anything but spheres, boxes, half-spaces and fixed boxes with one restitution, or walls that
        move, or friction.
    """
    scene = problem.scene
    if scene is None:
        raise NoModelError("the problem is given by functions, which have no bodies in other engines")
    items = scene.items
    if items.frictional:
        raise NoModelError("friction was not written for other engines")
    free, fixed = [b for b in items.bodies if not b.fixed], [b for b in items.bodies if b.fixed]
    if items.robots or items.surfaces or items.pair_restitution or scene.motions:
        raise NoModelError("robots, meshes, moving walls and restitution of pairs have no model in other engines")
    if any(not isinstance(b.shape, Box) for b in items.bodies) or any((b.rotation != np.eye(3)).any() for b in fixed):
        raise NoModelError("shapes other than spheres and boxes have no model in other engines")
    bodies = [Body(b.shape, b.mass, np.diag(b.inertia)) for b in free if isinstance(b.shape, Box)]
    for item in items.spheres:
        for r, m in zip(item.radii.tolist(), item.masses.tolist(), strict=True):
            bodies.append(Body(Sphere(r), m, np.full(3, 0.4 * m * r**2)))
    count, balls = len(free), len(bodies) - len(free)
    walls = tuple((np.array(wall.normal), wall.offset) for wall in items.walls.values())
    still = np.tile([0.0, 0.0, 0.0, 1.0], (balls, 1))

    def state(q: Array, v: Array) -> Poses:
        poses, rates = q[: 7 * count].reshape(-1, 7), v[: 6 * count].reshape(-1, 6)
        turns = poses[:, 3:]
        spins = rotated(turns, rates[:, 3:])
        centres, speeds = q[7 * count :].reshape(-1, 3), v[6 * count :].reshape(-1, 3)
        return Poses(
            np.concatenate([poses[:, :3], centres]), np.concatenate([turns, still]),
            np.concatenate([rates[:, :3], speeds]), np.concatenate([spins, np.zeros((balls, 3))]),
        )  # fmt: skip

    def coordinates(s: Poses) -> tuple[Array, Array]:
        turns = s.quaternion[:count]
        spins = rotated(turns, s.angular[:count], -1.0)
        q, v = np.hstack([s.position[:count], turns]), np.hstack([s.linear[:count], spins])
        return np.append(q, s.position[count:]), np.append(v, s.linear[count:])

    return Bodies(
        tuple(bodies), walls, items.gravity, items.restitution, state, coordinates, closing(problem, duration),
        tuple((b.shape, b.position) for b in fixed if isinstance(b.shape, Box)),
    )  # fmt: skip


def closing(problem: Problem, duration: float) -> float:
    """Return the speed of the first impact [m/s]; 1 if e is 0 or 1, because it does not matter then."""
    if not 0.0 < problem.constraints.largest_restitution < 1.0:
        return 1.0
    for step in steps(problem, Centered(), step=_STEP):
        if step.percussion.any():
            return max(1e-9, -float(step.before.min()))
        if step.t > problem.t0 + duration:
            break
    return 1.0

"""Piles: many bodies poured into an open box, as scenes of mbvi and as lists of shapes for other engines."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from mbvi.geometry.shapes.shapes import Box, Capsule, Sphere
from mbvi.problem import Problem
from mbvi.scene import Scene

from .errors import Array

# positions [m] and quaternions (x, y, z, w) of all bodies, shapes (n, 3) and (n, 4)
PilePoses = tuple[Array, Array]

# radius of the spheres and capsules, half edge of the boxes [m]
_RADIUS = 0.02
_MASS = 1.0
# distance of the centres of bodies that turn [m], and their number along a side of the container
_PITCH, _ALONG = 0.075, 5
# coefficient of friction of the rough piles
_MU = 0.5


@dataclass(frozen=True, eq=False)
class Pile:
    """Bodies of 1 kg that fall into an open box without restitution.

    Attributes
    ----------
    name : str
        Name of the panel, such as "200 boxes".
    shapes : tuple of Box, Capsule or Sphere
        One for each body; spheres come last, as in q.
    centres, turns : ndarray, shapes (n, 3) and (n, 4)
        Initial positions [m] and quaternions (x, y, z, w).
    walls : tuple of float
        Least and largest x and y of the container, whose floor is z = 0 [m].
    duration : float
        Simulated time [s].
    unit : tuple of str and float
        The length that depths are relative to: its name in the plural, and its size [m].
    mu : float
        Coefficient of friction of all contacts.
    """

    name: str
    shapes: tuple[Box | Capsule | Sphere, ...]
    centres: Array
    turns: Array
    walls: tuple[float, float]
    duration: float
    unit: tuple[str, float]
    mu: float = 0.0

    @property
    def turning(self) -> int:
        """The number of bodies that turn: without friction those that are not spheres."""
        return len(self.shapes) if self.mu else self.others

    @property
    def others(self) -> int:
        """The number of bodies that are not spheres."""
        return sum(not isinstance(shape, Sphere) for shape in self.shapes)

    @property
    def planes(self) -> list[tuple[Array, float]]:
        """Normal and offset of the floor and the four walls."""
        low, high = self.walls
        sides = [(sign * axis, offset) for axis in np.eye(3)[:2] for sign, offset in ((1.0, low), (-1.0, -high))]
        return [(np.array([0.0, 0.0, 1.0]), 0.0), *sides]

    def problem(self) -> Problem:
        """Return the problem that mbvi solves."""
        scene, (low, high) = Scene(friction=self.mu), self.walls
        scene.add_container((low, low, 0.0), (high, high))
        for shape, centre, turn in zip(self.shapes, self.centres, self.turns, strict=True):
            if isinstance(shape, Sphere):
                continue
            pose = {"position": centre, "rotation": Rotation.from_quat(turn).as_matrix()}
            if isinstance(shape, Box):
                scene.add_box(shape.size, _MASS, **pose)
            else:
                scene.add_capsule(shape.radius, shape.length, _MASS, **pose)
        radii = [shape.radius for shape in self.shapes if isinstance(shape, Sphere)]
        if radii:
            scene.add_spheres(self.centres[self.others :], radii, _MASS, name="sphere")
        return scene.build()

    def configuration(self, centres: Array, turns: Array) -> Array:
        """Return q of the poses of all bodies: positions [m] and quaternions (x, y, z, w)."""
        n = self.turning
        unit = turns[:n] / np.linalg.norm(turns[:n], axis=1, keepdims=True)
        return np.append(np.hstack([centres[:n], unit]), centres[n:])


def spheres(count: int) -> Pile:
    """Return spheres that fall from a lattice into a box as wide as the lattice; r = 0.02 m."""
    n = int(np.ceil(count ** (1 / 3)))
    grid = np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), -1).reshape(-1, 3)
    grid = grid[np.argsort(grid[:, 2], kind="stable")][:count]
    spacing = 2.2 * _RADIUS
    centres = spacing * (grid + 0.5) + 1e-3 * (2.0 * np.random.default_rng(0).random((count, 3)) - 1.0)
    centres[:, 2] += 0.1
    still = np.tile([0.0, 0.0, 0.0, 1.0], (count, 1))
    shapes = (Sphere(_RADIUS),) * count
    return Pile(f"{count} spheres", shapes, centres, still, (0.0, n * spacing), 1.0, ("radii", _RADIUS))


def boxes(count: int) -> Pile:
    """Return cubes of 0.04 m in random poses that fall into a box 0.4 m wide."""
    edge = 2.0 * _RADIUS
    return _poured(f"{count} boxes", (Box((edge, edge, edge)),) * count, ("edges", edge))


def mixed(count: int) -> Pile:
    """Return boxes, capsules and spheres, a third each, in random poses that fall into a box."""
    edge, third = 2.0 * _RADIUS, count // 3
    shapes: list[Box | Capsule | Sphere] = [Box((edge, edge, edge))] * third
    shapes += [Capsule(_RADIUS, 1.2 * _RADIUS)] * third
    shapes += [Sphere(_RADIUS)] * (count - len(shapes))
    return _poured(f"{count} boxes, capsules, spheres", tuple(shapes), ("radii", _RADIUS))


def _poured(name: str, shapes: tuple[Box | Capsule | Sphere, ...], unit: tuple[str, float]) -> Pile:
    """Return a pile of bodies in layers of 5 x 5, in random order and poses."""
    count = len(shapes)
    place = np.random.default_rng(0).permutation(count) if len(set(map(type, shapes))) > 1 else np.arange(count)
    layer, row, column = np.unravel_index(place, (-(-count // _ALONG**2), _ALONG, _ALONG))
    middle = (_ALONG - 1) / 2
    centres = _PITCH * np.stack([row - middle, column - middle, layer], axis=1) + [0.0, 0.0, 0.05]
    turns = Rotation.random(count, random_state=0).as_quat()
    half = 0.2
    return Pile(name, shapes, centres, turns, (-half, half), 0.6, unit)


class Scenes(NamedTuple):
    """The scenes of one picture: its title, and what makes the pile of each panel, by the panel's name."""

    title: str
    scenes: dict[str, Callable[[], Pile]]


# pictures by their names on the command line
PICTURES = {
    "piles": Scenes(
        "Poured without friction, e = 0",
        {"spheres": lambda: spheres(1000), "boxes": lambda: boxes(200), "mixed": lambda: mixed(200)},
    ),
    "rough-piles": Scenes(
        "Poured with friction, mu = 0.5, e = 0",
        {
            "spheres": lambda: replace(spheres(216), mu=_MU),
            "boxes": lambda: replace(boxes(60), mu=_MU),
            "mixed": lambda: replace(mixed(60), mu=_MU),
        },
    ),
}

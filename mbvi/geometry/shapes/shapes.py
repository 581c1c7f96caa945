"""Convex shapes: Coal geometry, support points above half-spaces, and inertia as homogeneous solids.

Every shape but a hull is centred on its own frame. Capsules and cylinders lie along z. Lengths are in metres.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import frexp
from typing import Any

import coal
import numpy as np

from ..motion import Motion
from .hull_graph import FEW_VERTICES, neighbours, no_graph
from .polyhedra import Box, Hull

Array = np.ndarray

# fixed support points on a rim of unit radius: a cylinder on its end stands on them
_RIM = np.array([[np.cos(a), np.sin(a), 0.0] for a in np.arange(12) * (np.pi / 6)])
# sine of the tilt of a rim from which on only its lowest point can touch a face: the others would brake a wheel that
# rolls, because along the velocity of a step they move into the face, and along their circle they do not
TILTED = 0.1


@dataclass(frozen=True)
class Sphere:
    """A ball of a radius [m]."""

    radius: float
    smooth = True

    @property
    def bound(self) -> float:
        """Radius of a ball about the frame's origin that holds the shape [m]."""
        return self.radius

    @property
    def inner(self) -> float:
        """Radius of a ball that fits into the shape [m]."""
        return self.radius

    def coal(self, unit: float = 1.0) -> Any:
        """Return the Coal geometry, in units of `unit` [m]."""
        return coal.Sphere(self.radius / unit)

    def support_points(self) -> tuple[Array, Array, float]:
        """Return centres and half axes of support points, shapes (k, 3), and the radius of a ball about each.

        A support point is the lowest point, above a half-space, of the ellipsoid with this centre and these half axes.
        If the half axes are zero, it is the centre. The gap is its height above the half-space, less the radius.
        """
        return np.zeros((1, 3)), np.zeros((1, 3)), self.radius

    def inertia(self, mass: float) -> Array:
        """Return the inertia about the centre, shape (3, 3) [kg m^2]."""
        return 0.4 * mass * self.radius**2 * np.eye(3)


@dataclass(frozen=True)
class Ellipsoid:
    """An ellipsoid of three semi-axes [m]."""

    radii: tuple[float, float, float]
    smooth = True

    @property
    def bound(self) -> float:
        """Radius of a ball about the frame's origin that holds the shape [m]."""
        return max(self.radii)

    @property
    def inner(self) -> float:
        """Radius of a ball that fits into the shape [m]."""
        return min(self.radii)

    def coal(self, unit: float = 1.0) -> Any:
        """Return the Coal geometry, in units of `unit` [m]."""
        return coal.Ellipsoid(*(r / unit for r in self.radii))

    def support_points(self) -> tuple[Array, Array, float]:
        """Return the ellipsoid itself, whose lowest point moves over the surface; see `Sphere.support_points`."""
        return np.zeros((1, 3)), np.array([self.radii]), 0.0

    def inertia(self, mass: float) -> Array:
        """Return the inertia about the centre, shape (3, 3) [kg m^2]."""
        a, b, c = np.square(self.radii)
        return 0.2 * mass * np.diag([b + c, a + c, a + b])


@dataclass(frozen=True)
class Capsule:
    """A cylinder of a length between two half balls of a radius [m]."""

    radius: float
    length: float
    smooth = False

    @property
    def bound(self) -> float:
        """Radius of a ball about the frame's origin that holds the shape [m]."""
        return self.radius + 0.5 * self.length

    @property
    def inner(self) -> float:
        """Radius of a ball that fits into the shape [m]."""
        return self.radius

    def coal(self, unit: float = 1.0) -> Any:
        """Return the Coal geometry, in units of `unit` [m]."""
        return coal.Capsule(self.radius / unit, self.length / unit)

    def support_points(self) -> tuple[Array, Array, float]:
        """Return the ends of the axis and the radius; see `Sphere.support_points`."""
        return np.array([[0, 0, -0.5], [0, 0, 0.5]]) * self.length, np.zeros((2, 3)), self.radius

    def inertia(self, mass: float) -> Array:
        """Return the inertia about the centre, shape (3, 3) [kg m^2]."""
        r, length = self.radius, self.length
        ball, tube = 4 / 3 * r, length
        m_ball, m_tube = mass * ball / (ball + tube), mass * tube / (ball + tube)
        axial = m_tube * r**2 / 2 + m_ball * 0.4 * r**2
        side = m_tube * (length**2 / 12 + r**2 / 4) + m_ball * (0.4 * r**2 + length**2 / 4 + 0.375 * length * r)
        return np.diag([side, side, axial])


@dataclass(frozen=True)
class Cylinder:
    """A solid cylinder of a radius and a length [m]."""

    radius: float
    length: float
    smooth = False

    @property
    def bound(self) -> float:
        """Radius of a ball about the frame's origin that holds the shape [m]."""
        return float(np.hypot(self.radius, 0.5 * self.length))

    @property
    def inner(self) -> float:
        """Radius of a ball that fits into the shape [m]."""
        return min(self.radius, 0.5 * self.length)

    def coal(self, unit: float = 1.0) -> Any:
        """Return the Coal geometry, in units of `unit` [m]."""
        return coal.Cylinder(self.radius / unit, self.length / unit)

    def support_points(self) -> tuple[Array, Array, float]:
        """Return twelve fixed points of each rim, and the rims themselves; see `Sphere.support_points`."""
        end = np.array([0.0, 0.0, 0.5 * self.length])
        fixed = np.concatenate([self.radius * _RIM - end, self.radius * _RIM + end])
        rim = np.array([[self.radius, self.radius, 0.0]])
        half_axes = np.concatenate([np.zeros(fixed.shape), rim, rim])
        return np.concatenate([fixed, [-end, end]]), half_axes, 0.0

    def inertia(self, mass: float) -> Array:
        """Return the inertia about the centre, shape (3, 3) [kg m^2]."""
        side = mass * (self.length**2 / 12 + self.radius**2 / 4)
        return np.diag([side, side, 0.5 * mass * self.radius**2])


def length_unit(sizes: Iterable[float]) -> float:
    """Return the power of two above the median of sizes [m]; 1 if there are none."""
    known = list(sizes)
    return 2.0 ** frexp(float(np.median(known)))[1] if known else 1.0


@dataclass(frozen=True)
class HalfSpace:
    """The free side of a wall or floor: normal . x >= offset in the world [m], displaced by its motion, if any."""

    normal: tuple[float, float, float]
    offset: float
    motion: Motion | None = None


Convex = Sphere | Ellipsoid | Box | Hull | Capsule | Cylinder


def graph_of(shape: Convex, count: int) -> tuple[Array, Array]:
    """Return the graph of the `count` points that describe a shape: without neighbours unless it is a large hull."""
    if isinstance(shape, Hull) and count > FEW_VERTICES:
        return shape.kept(_graph)
    return no_graph(count)


def _graph(hull: Hull) -> tuple[Array, Array]:
    return neighbours(hull.triangles, len(hull.vertices))


@dataclass(frozen=True)
class PlacedShape:
    """A shape fixed to a body.

    Attributes
    ----------
    name : str
        Unique in the scene: "hopper/foot", "floor".
    shape : Convex
        The shape.
    body : int
        The body it is fixed to; 0 is the world.
    rotation : ndarray, shape (3, 3)
    position : ndarray, shape (3,)
        Rotation and position of the shape's frame in the body's [m].
    color : tuple of float
        Red, green, blue, opacity in [0, 1].
    motion : Motion, optional
        Prescribed motion of a shape of the world.
    beside : tuple of (ndarray, ndarray)
        Vertices, shape (v, 3), and planes, shape (f, 4), in the world, of what is solid beside a fixed polyhedron.
    """

    name: str
    shape: Convex
    body: int
    rotation: Array
    position: Array
    color: tuple[float, float, float, float] = (0.6, 0.65, 0.72, 1.0)
    motion: Motion | None = None
    beside: tuple[tuple[Array, Array], ...] = ()

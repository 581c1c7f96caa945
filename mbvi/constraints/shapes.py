"""Convex shapes: their Coal geometry, the points they stand on, and their inertia as homogeneous solids.

Every shape is centred on its own frame; lengths in metres; capsules and cylinders lie along z.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import coal
import numpy as np

from ..errors import InputError
from ..motion import Motion
from .faces import FACING, leave

Array = np.ndarray

_RIM = np.array([[np.cos(a), np.sin(a), 0.0] for a in np.arange(12) * (np.pi / 6)])
_CORNERS = 0.5 * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
_MOST_NEIGHBOURS = 200


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

    def coal(self) -> Any:
        """Return the Coal geometry."""
        return coal.Sphere(self.radius)

    def standing_points(self) -> tuple[Array, Array, float]:
        """Return centres and half axes, shapes (k, 3), and a radius: the shape's reach below a plane is theirs.

        Of an ellipsoid of these half axes about the centre, the lowest point counts; where they vanish, the centre.
        To it comes a ball of the radius.
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

    def coal(self) -> Any:
        """Return the Coal geometry."""
        return coal.Ellipsoid(*self.radii)

    def standing_points(self) -> tuple[Array, Array, float]:
        """Return itself: its lowest point moves over the surface."""
        return np.zeros((1, 3)), np.array([self.radii]), 0.0

    def inertia(self, mass: float) -> Array:
        """Return the inertia about the centre, shape (3, 3) [kg m^2]."""
        a, b, c = np.square(self.radii)
        return 0.2 * mass * np.diag([b + c, a + c, a + b])


class _Polyhedron:
    """What boxes and hulls share: vertices to stand on, and faces `normal . x <= offset`."""

    smooth = False
    vertices: Array
    faces: tuple[Array, Array]

    @property
    def bound(self) -> float:
        """Radius of a ball about the frame's origin that holds the shape [m]."""
        return float(np.sqrt((self.vertices**2).sum(axis=1).max()))

    @property
    def inner(self) -> float:
        """Radius of a ball that fits into the shape [m]."""
        normals, offsets = self.faces
        return float((offsets - normals @ self.vertices.mean(axis=0)).min())

    def standing_points(self) -> tuple[Array, Array, float]:
        """Return the vertices."""
        return self.vertices, np.zeros(self.vertices.shape), 0.0

    def exit(self, points: Array, direction: Array) -> Array:
        """Return how far from each point, shape (k, 3), a line along `direction` leaves the shape, shape (k,) [m]."""
        return leave(points, direction, self.faces)


@dataclass(frozen=True)
class Box(_Polyhedron):
    """A box of three edge lengths [m]."""

    size: tuple[float, float, float]

    @cached_property
    def vertices(self) -> Array:  # type: ignore[override]
        """The corners, shape (8, 3)."""
        return _CORNERS * np.asarray(self.size)

    @cached_property
    def faces(self) -> tuple[Array, Array]:  # type: ignore[override]
        """Outward normals, shape (6, 3), and offsets, shape (6,)."""
        half = 0.5 * np.asarray(self.size)
        return np.concatenate([np.eye(3), -np.eye(3)]), np.concatenate([half, half])

    def coal(self) -> Any:
        """Return the Coal geometry."""
        return coal.Box(*self.size)

    def inertia(self, mass: float) -> Array:
        """Return the inertia about the centre, shape (3, 3) [kg m^2]."""
        a, b, c = np.square(self.size)
        return mass / 12 * np.diag([b + c, a + c, a + b])


class Hull(_Polyhedron):
    """The convex hull of points.

    Parameters
    ----------
    points : array_like, shape (n, 3)
        Points in the shape's frame [m]; only the hull's vertices are kept.

    Raises
    ------
    InputError
        If the points span no volume.
    """

    def __init__(self, points: Array) -> None:
        points = np.asarray(points, dtype=float)
        hull = _qhull(points)
        directions = 1000
        while np.bincount(hull.simplices.ravel()).max() > _MOST_NEIGHBOURS:
            # Coal stores neighbours in bytes: keep the outermost points of many directions instead of all
            directions //= 2
            points = points[np.unique(np.argmax(points @ _sphere_directions(directions).T, axis=0))]
            hull = _qhull(points)
        self.vertices = np.ascontiguousarray(points[hull.vertices])
        number = np.full(len(points), -1)
        number[hull.vertices] = np.arange(len(hull.vertices))
        self.triangles = number[hull.simplices]
        self.faces = np.ascontiguousarray(hull.equations[:, :3]), -hull.equations[:, 3]
        corner = self.vertices[self.triangles]
        outward = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        inward = (outward * self.faces[0]).sum(axis=1) < 0.0
        self.triangles[inward] = self.triangles[inward][:, ::-1]

    def coal(self) -> Any:
        """Return the Coal geometry."""
        points, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
        points.extend(list(self.vertices))
        triangles.extend([coal.Triangle(*map(int, t)) for t in self.triangles])
        return coal.Convex(points, triangles)

    @property
    def volume(self) -> float:
        """Volume [m^3]."""
        corner = self.vertices[self.triangles]
        return float(np.vecdot(corner[:, 0], np.cross(corner[:, 1], corner[:, 2])).sum() / 6)

    def mass_properties(self, mass: float) -> tuple[Array, Array]:
        """Return centre of mass, shape (3,), and inertia about it, shape (3, 3), at constant density."""
        # tetrahedra from the origin, signed by the outward triangles
        corner = self.vertices[self.triangles]
        volume = np.einsum("ti,ti->t", corner[:, 0], np.cross(corner[:, 1], corner[:, 2])) / 6
        centre = np.einsum("t,ti->i", volume, corner.sum(axis=1)) / (4 * volume.sum())
        total = corner.sum(axis=1)
        second = np.einsum("t,tki,tkj->ij", volume, corner, corner) + np.einsum("t,ti,tj->ij", volume, total, total)
        covariance = mass * (second / (20 * volume.sum()) - np.outer(centre, centre))
        return centre, np.trace(covariance) * np.eye(3) - covariance

    def inertia(self, mass: float) -> Array:
        """Return the inertia about the centre of mass, shape (3, 3) [kg m^2]."""
        return self.mass_properties(mass)[1]


def _qhull(points: Array) -> Any:
    # half of this package's import time, for meshes only
    from scipy.spatial import ConvexHull, QhullError

    try:
        return ConvexHull(points)
    except (QhullError, ValueError) as error:
        raise InputError(f"the convex hull of {len(points)} points has no volume") from error


def _sphere_directions(n: int) -> Array:
    """Return n directions spread evenly, shape (n, 3): a Fibonacci spiral."""
    z = 1.0 - (2.0 * np.arange(n) + 1.0) / n
    angle = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(n)
    return np.stack([np.sqrt(1.0 - z**2) * np.cos(angle), np.sqrt(1.0 - z**2) * np.sin(angle), z], axis=1)


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

    def coal(self) -> Any:
        """Return the Coal geometry."""
        return coal.Capsule(self.radius, self.length)

    def standing_points(self) -> tuple[Array, Array, float]:
        """Return the centres of the two ends and the radius."""
        return np.array([[0, 0, -0.5], [0, 0, 0.5]]) * self.length, np.zeros((2, 3)), self.radius

    def exit(self, points: Array, direction: Array) -> Array:
        """Return how far from each point, shape (k, 3), a line along `direction` leaves the shape, shape (k,) [m]."""
        z = np.clip(points[:, 2], -0.5 * self.length, 0.5 * self.length)
        from_axis = points - z[:, None] * np.array([0.0, 0.0, 1.0])
        return _leave_ball(from_axis, direction, self.radius)

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

    def coal(self) -> Any:
        """Return the Coal geometry."""
        return coal.Cylinder(self.radius, self.length)

    def standing_points(self) -> tuple[Array, Array, float]:
        """Return twelve points of each rim, and the rims themselves, whose lowest points move."""
        end = np.array([0.0, 0.0, 0.5 * self.length])
        fixed = np.concatenate([self.radius * _RIM - end, self.radius * _RIM + end])
        rim = np.array([[self.radius, self.radius, 0.0]])
        half_axes = np.concatenate([np.zeros(fixed.shape), rim, rim])
        return np.concatenate([fixed, [-end, end]]), half_axes, 0.0

    @cached_property
    def faces(self) -> tuple[Array, Array]:
        """Outward normals of the two ends, shape (2, 3), and their offsets, shape (2,)."""
        return np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]), np.full(2, 0.5 * self.length)

    def exit(self, points: Array, direction: Array) -> Array:
        """Return how far from each point, shape (k, 3), a line along `direction` leaves the shape, shape (k,) [m]."""
        way = np.full(len(points), np.inf)
        if abs(direction[2]) > FACING:
            way = (0.5 * self.length - np.sign(direction[2]) * points[:, 2]) / abs(direction[2])
        across = np.hypot(direction[0], direction[1])
        if across > FACING:
            flat = points * np.array([1.0, 1.0, 0.0])
            unit = np.array([direction[0], direction[1], 0.0]) / across
            way = np.minimum(way, _leave_ball(flat, unit, self.radius) / across)
        return way

    def inertia(self, mass: float) -> Array:
        """Return the inertia about the centre, shape (3, 3) [kg m^2]."""
        side = mass * (self.length**2 / 12 + self.radius**2 / 4)
        return np.diag([side, side, 0.5 * mass * self.radius**2])


def _leave_ball(points: Array, direction: Array, radius: float) -> Array:
    """Return how far from points, shape (k, 3), a line along a unit direction leaves a ball about the origin."""
    along = points @ direction
    inside = along**2 - (points**2).sum(axis=1) + radius**2
    return np.sqrt(np.maximum(inside, 0.0)) - along


@dataclass(frozen=True)
class HalfSpace:
    """What a wall or floor leaves free: normal . x >= offset in the world [m], displaced by its motion if any."""

    normal: tuple[float, float, float]
    offset: float
    motion: Motion | None = None


Convex = Sphere | Ellipsoid | Box | Hull | Capsule | Cylinder


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
        Where the shape's frame stands in the body's [m].
    color : tuple of float
        Red, green, blue, opacity in [0, 1].
    motion : Motion, optional
        How a shape of the world moves, if it does.
    """

    name: str
    shape: Convex
    body: int
    rotation: Array
    position: Array
    color: tuple[float, float, float, float] = (0.6, 0.65, 0.72, 1.0)
    motion: Motion | None = None

"""Boxes and convex hulls: vertices, faces, volume and inertia."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import coal
import numpy as np

from ...errors import InputError

Array = np.ndarray
Made = TypeVar("Made")

_CORNERS = 0.5 * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
# triangles at one vertex, of a hull that Coal can hold
_MOST_NEIGHBOURS = 200


class Polyhedron:
    """Base class of boxes and hulls: vertices, and faces `normal . x <= offset`."""

    smooth = False
    vertices: Array
    faces: tuple[Array, Array]

    @cached_property
    def bound(self) -> float:
        """Radius of a ball about the frame's origin that holds the shape [m]."""
        return float(np.sqrt((self.vertices**2).sum(axis=1).max()))

    @cached_property
    def inner(self) -> float:
        """Radius of a ball that fits into the shape [m]."""
        normals, offsets = self.faces
        return float((offsets - normals @ self.vertices.mean(axis=0)).min())

    def support_points(self) -> tuple[Array, Array, float]:
        """Return the vertices, fixed points without a ball; see `Sphere.support_points`."""
        return self.vertices, np.zeros(self.vertices.shape), 0.0


@dataclass(frozen=True)
class Box(Polyhedron):
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

    def coal(self, unit: float = 1.0) -> Any:
        """Return the Coal geometry, in units of `unit` [m]."""
        return coal.Box(*(edge / unit for edge in self.size))

    def inertia(self, mass: float) -> Array:
        """Return the inertia about the centre, shape (3, 3) [kg m^2]."""
        a, b, c = np.square(self.size)
        return mass / 12 * np.diag([b + c, a + c, a + b])


class Hull(Polyhedron):
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
        points, hull = _qhull(np.asarray(points, dtype=float))
        directions = 1000
        while np.bincount(hull.simplices.ravel()).max() > _MOST_NEIGHBOURS:
            # Coal counts the neighbours of a vertex in one byte: keep only the outermost points in many directions
            directions //= 2
            points = points[np.unique(np.argmax(points @ _sphere_directions(directions).T, axis=0))]
            points, hull = _qhull(points)
        self.vertices = np.ascontiguousarray(points)
        self.triangles = hull.simplices.astype(np.int64)
        self.faces = np.ascontiguousarray(hull.equations[:, :3]), -hull.equations[:, 3]
        corner = self.vertices[self.triangles]
        outward = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        inward = (outward * self.faces[0]).sum(axis=1) < 0.0
        self.triangles[inward] = self.triangles[inward][:, ::-1]
        self._kept: dict[str, Any] = {}

    def kept(self, make: Callable[[Hull], Made]) -> Made:
        """Return what a function of a module makes of the hull, which it makes once for the hull and its copies."""
        name = f"{make.__module__}.{make.__qualname__}"
        if name not in self._kept:
            self._kept[name] = make(self)
        found: Made = self._kept[name]
        return found

    def coal(self, unit: float = 1.0) -> Any:
        """Return the Coal geometry, in units of `unit` [m]."""
        # a mesh accepts arrays, which Convex does not
        mesh = coal.BVHModelOBBRSS()
        mesh.beginModel(len(self.triangles), len(self.vertices))
        mesh.addVertices(self.vertices / unit)
        mesh.addTriangles(self.triangles)
        mesh.buildConvexRepresentation(False)
        return mesh.convex

    @property
    def volume(self) -> float:
        """Volume [m^3]."""
        return enclosed_volume(self.vertices, self.triangles)

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


def enclosed_volume(vertices: Array, triangles: Array) -> float:
    """Return the volume within closed triangles that run anticlockwise seen from outside [m^3]."""
    corner = vertices[triangles]
    return float(np.vecdot(corner[:, 0], np.cross(corner[:, 1], corner[:, 2])).sum() / 6)


def _qhull(points: Array) -> tuple[Array, Any]:
    """Return the vertices of a hull and the hull of these, which is again the same when it is made from them alone."""
    # only meshes need it, and its import is slow
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(points)
        while len(hull.vertices) < len(points):
            points = points[hull.vertices]
            hull = ConvexHull(points)
    except (QhullError, ValueError) as error:
        raise InputError(f"the convex hull of {len(points)} points has no volume") from error
    return points, hull


def _sphere_directions(n: int) -> Array:
    """Return n directions spread evenly, shape (n, 3): a Fibonacci spiral."""
    z = 1.0 - (2.0 * np.arange(n) + 1.0) / n
    angle = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(n)
    return np.stack([np.sqrt(1.0 - z**2) * np.cos(angle), np.sqrt(1.0 - z**2) * np.sin(angle), z], axis=1)

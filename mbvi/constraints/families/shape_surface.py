"""The family of boxes, hulls and capsules against a triangle mesh that is solid behind its triangles."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np

from ...geometry.closed_form.surface_distances import surface_distances
from ...geometry.closed_form.surface_rows import surface_contacts
from ...geometry.meshes.creases import creases_of
from ...geometry.meshes.triangles import Surface
from ...geometry.shapes.convex_cores import cores_of
from ...geometry.shapes.shapes import Capsule, PlacedShape
from ...system import System
from ..family import ConstraintFamily
from ..rows import Array, Rows
from .pairs import Contacts

# rounding of lengths, relative to the size of mesh and shapes
_ROUNDING = 1e-12


def _is_round(placed: PlacedShape) -> bool:
    return isinstance(placed.shape, Capsule)


class ShapeSurface(ConstraintFamily):
    """A mesh of the world, the first body of every pair, against convex shapes, the second bodies.

    Parameters
    ----------
    system : System
        What moves the shapes.
    shapes : sequence of PlacedShape
        Boxes, hulls and capsules on their bodies.
    surface : Surface
        The mesh, in the world's frame; the free side is where the corners of its triangles run anticlockwise.
    name : str
        Name of the mesh.
    restitution : ndarray, shape (n,)
        e of each shape with it.
    friction : ndarray, shape (n,), or float
        Coefficient of friction of each shape with it, or of all.

    Notes
    -----
    Constraint i is shape i. Its rows are those of the features that touch: vertices of the shape on triangles, vertices
    of the mesh in faces, edges of both that cross. Flat edges and valleys of the mesh have none of their own. A shape
    deeper than the radius of the largest ball that fits into it has passed the mesh.
    """

    # the features that touch change along the motion
    smooth = False
    parted = False

    def __init__(
        self,
        system: System,
        shapes: Sequence[PlacedShape],
        surface: Surface,
        name: str,
        restitution: Array,
        friction: Array | float = 0.0,
    ) -> None:
        self.system, self.size = system, len(shapes)
        self.restitution: Array = restitution
        self.friction = friction
        self._names, self._surface_name = [s.name for s in shapes], name
        self._shapes = list(shapes)
        self._bodies = np.array([s.body for s in shapes], dtype=np.int64)
        self._frames, frame = np.unique(self._bodies, return_inverse=True)
        self._cores, self._creases = tuple(cores_of(shapes, frame)), tuple(creases_of(surface))
        bounds = np.array([s.shape.bound for s in shapes])
        self._eps = _ROUNDING * (float(bounds.max()) + surface.bound)
        # rows are found to twice this depth: a step may begin deep already
        self.thickness: Array = np.array([s.shape.inner * (1.0 if _is_round(s) else 0.5) for s in shapes])
        self._every = np.arange(self.size)
        corners, faces = (int(np.diff(first).max()) for first in (self._cores[2], self._cores[7]))
        self._scratch = np.empty((corners, 3)), np.empty((max(faces, 1), 4))
        self._make_room(200, 100)

    def describe(self) -> str:
        """Return one line of `Problem.report()`, in words."""
        return f"{self.size} shape{'s' * (self.size != 1)} at a mesh"

    def name(self, constraint: int) -> str:
        """Return the name of one pair."""
        return f"{self._names[constraint]} | {self._surface_name}"

    def contacts(self, t: float, q: Array, tolerance: float) -> Rows | None:
        """Return the rows within the tolerance, or None."""
        pair, gap, point, normal = self._measure(q, self._every, tolerance)
        if not len(pair):
            return None
        rows = self._gradients(q, pair, point, normal)
        return Rows(pair, gap, rows, self.restitution[pair], point, normal)

    def bodies_of(self, numbers: Array) -> tuple[Array, Array]:
        """Return the mesh's body, which is the world, and the bodies of some shapes, shapes (k,)."""
        return np.zeros(len(numbers), np.int64), self._bodies[numbers]

    def nearest(self, q: Array, shapes: Array) -> Contacts:
        """Return the deepest contact of each of some shapes in ascending order, or where it is nearest to the mesh."""
        count, numbers = len(shapes), np.asarray(shapes, dtype=np.int64)
        gap, point, normal = np.full(count, np.inf), np.empty((count, 3)), np.empty((count, 3))
        for i, deep, at, n in zip(*self._measure(q, numbers, 0.0), strict=True):
            k = int(np.searchsorted(numbers, i))
            if deep < gap[k]:
                gap[k], point[k], normal[k] = deep, at, n
        # what has no row does not touch: its distance takes longer
        apart = np.flatnonzero(gap == np.inf)
        if apart.size:
            found = np.empty(len(apart)), np.empty((len(apart), 3)), np.empty((len(apart), 3))
            arguments = self._places(q), self._creases, self._cores, numbers[apart]
            surface_distances(*arguments, *self._scratch, np.empty(12), *found)
            gap[apart], point[apart], normal[apart] = found
        return Contacts(shapes, gap, point, normal)

    def nearest_points(self, q: Array) -> tuple[Array, Array]:
        """Return the nearest point of every shape and the normal there, shapes (n, 3)."""
        return self.nearest(q, self._every)[2:]

    def row_points(self, t: float, q: Array, rows: Array) -> tuple[Array, Array]:
        """Return the nearest points of some shapes and the normals there, shapes (k, 3)."""
        return self.nearest(q, rows)[2:]

    def gap(self, t: float, q: Array) -> Array:
        """Return the distance of every shape, minus its depth where it touches, shape (n,) [m]."""
        return self.nearest(q, self._every).gap

    def pair_gap(self, t: float, q: Array, pairs: Array) -> Array:
        """Return the distances of some shapes in ascending order, shape (k,) [m]."""
        return self.nearest(q, pairs).gap

    def gradient(self, t: float, q: Array) -> Any:
        """Return the gradient of every shape's distance, shape (n, nv)."""
        shape, _, point, normal = self.nearest(q, self._every)
        return self._gradients(q, shape, point, normal)

    def reach(self) -> Array:
        """Return the reach of each pair, shape (n, nv)."""
        return self._reach

    @cached_property
    def _reach(self) -> Array:
        return np.array([self.system.reach(s.body, s.position, s.shape.bound) for s in self._shapes])

    def _gradients(self, q: Array, shape: Array, point: Array, normal: Array) -> Any:
        bodies = self._bodies[shape]
        return self.system.separation_rows(q, np.zeros_like(bodies), bodies, point, normal)

    def _places(self, q: Array) -> Array:
        return np.ascontiguousarray(self.system.placements(q, self._frames))

    def _make_room(self, triangles: int, rows: int) -> None:
        """Make arrays for triangles about a shape, and for rows."""
        self._near, self._rows = np.empty(max(triangles, rows), np.int64), np.empty((rows, 7))
        count = max(rows, 20 * self.size)
        self._found = np.empty(count, np.int64), np.empty(count), np.empty((count, 3)), np.empty((count, 3))

    def _measure(self, q: Array, shapes: Array, tolerance: float) -> Contacts:
        """Return the contacts of some shapes within the tolerance."""
        places, some = self._places(q), np.asarray(shapes, dtype=np.int64)
        while True:
            count, triangles, rows = surface_contacts(
                places, self._creases, self._cores, some, tolerance, self._eps, self._near, *self._scratch,
                self._rows, np.empty(12), *self._found,
            )  # fmt: skip
            if triangles <= len(self._near) and rows <= len(self._rows) and count <= len(self._found[0]):
                return Contacts(*(part[:count].copy() for part in self._found))
            self._make_room(2 * triangles, 2 * max(count, rows, len(self._rows)))

"""The family of boxes, hulls and capsules against a triangle mesh that is solid behind its triangles."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...geometry.closed_form.surface_distances import surface_distances
from ...geometry.closed_form.surface_rows import surface_contacts
from ...geometry.meshes.creases import creases_of
from ...geometry.meshes.triangles import Surface
from ...geometry.shapes.convex_cores import cores_of
from ...geometry.shapes.shapes import Capsule, PlacedShape
from ...system import System
from ..rows import Array
from .pairs import Contacts
from .surface import ROUNDING, SurfaceContacts


class ShapeSurface(SurfaceContacts):
    """Boxes, hulls and capsules at a mesh; the parameters are those of `SurfaceContacts`.

    Notes
    -----
    The free side is where the corners of triangles run anticlockwise. Rows are those of the features that touch:
    vertices of the shape on triangles, vertices of the mesh in faces, edges of both that cross. Flat edges and valleys
    of the mesh have none of their own. A shape deeper than the radius of the largest ball that fits into it has passed
    the mesh.
    """

    def __init__(
        self,
        system: System,
        shapes: Sequence[PlacedShape],
        surface: Surface,
        name: str,
        restitution: Array,
        friction: Array | float = 0.0,
    ) -> None:
        super().__init__(system, shapes, surface, name, restitution, friction)
        self._frames, frame = np.unique(self._bodies, return_inverse=True)
        self._cores, self._creases = tuple(cores_of(shapes, frame)), tuple(creases_of(surface))
        bounds = np.array([s.shape.bound for s in shapes])
        self._eps = ROUNDING * (float(bounds.max()) + surface.bound)
        # rows are found to twice this depth: a step may begin deep already
        self.thickness: Array = np.array([s.shape.inner * (1 if isinstance(s.shape, Capsule) else 0.5) for s in shapes])
        corners, faces = (int(np.diff(first).max()) for first in (self._cores[2], self._cores[7]))
        # the lowest points of two rims come behind the vertices
        self._scratch = np.empty((corners + 2, 3)), np.empty((max(faces, 1), 4))
        self._make_room(200, 100)

    def carried(self, shape: PlacedShape) -> float:
        """Return the radius of a ball that holds the shape [m]."""
        return shape.shape.bound

    def nearest(self, q: Array, shapes: Array) -> Contacts:
        """Return the deepest contact of each of some shapes in ascending order, or where it is nearest to the mesh."""
        count = len(shapes)
        gap, point, normal = np.full(count, np.inf), np.empty((count, 3)), np.empty((count, 3))
        for i, deep, at, n in zip(*self.measure(q, shapes, 0.0), strict=True):
            k = int(np.searchsorted(shapes, i))
            if deep < gap[k]:
                gap[k], point[k], normal[k] = deep, at, n
        # what has no row does not touch: its distance takes longer
        apart = np.flatnonzero(gap == np.inf)
        if apart.size:
            found = np.empty(len(apart)), np.empty((len(apart), 3)), np.empty((len(apart), 3))
            arguments = self._places(q), self._creases, self._cores, shapes[apart]
            surface_distances(*arguments, *self._scratch, np.empty(12), *found)
            gap[apart], point[apart], normal[apart] = found
        return Contacts(shapes, gap, point, normal)

    def _places(self, q: Array) -> Array:
        return np.ascontiguousarray(self.system.placements(q, self._frames))

    def _make_room(self, triangles: int, rows: int) -> None:
        """Make arrays for triangles about a shape, and for rows."""
        self._near, self._rows = np.empty(max(triangles, rows), np.int64), np.empty((rows, 7))
        count = max(rows, 20 * self.size)
        self._found = np.empty(count, np.int64), np.empty(count), np.empty((count, 3)), np.empty((count, 3))

    def measure(self, q: Array, shapes: Array, tolerance: float) -> Contacts:
        """Return the contacts of some shapes within the tolerance."""
        places = self._places(q)
        while True:
            count, triangles, rows = surface_contacts(
                places, self._creases, self._cores, shapes, tolerance, self._eps, self._near, *self._scratch,
                self._rows, np.empty(12), *self._found,
            )  # fmt: skip
            if triangles <= len(self._near) and rows <= len(self._rows) and count <= len(self._found[0]):
                return Contacts(*(part[:count].copy() for part in self._found))
            self._make_room(2 * triangles, 2 * max(count, rows, len(self._rows)))

"""The family of boxes, hulls, capsules and cylinders against a triangle mesh that is solid behind its triangles."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...compiled import held
from ...errors import InadmissibleStartError
from ...geometry.at_meshes.cores_at_mesh import CoresAtMesh, free_way
from ...geometry.at_meshes.surface_distances import surface_distances
from ...geometry.at_meshes.surface_rows import surface_contacts
from ...geometry.meshes.creases import creases_of
from ...geometry.meshes.triangles import Surface
from ...geometry.shapes.convex_cores import cores_of
from ...geometry.shapes.shapes import Capsule, PlacedShape
from ...system import System
from ..rows import Array
from .pairs import Contacts
from .surface import ROUNDING, SurfaceContacts

# how far a shape may move until its features are listed again: parts of the mean radius of balls about the shapes, and
# the least and the greatest part of its own
_SKIN, _MOST_SKIN = 0.05, 0.25
# a gap or a distance that is less by this part of the radius of the ball inside a shape is no rounding
_WITHIN = 1e-6


class ShapeSurface(SurfaceContacts):
    """Boxes, hulls, capsules and cylinders at a mesh; the parameters are those of `SurfaceContacts`.

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
        self.frames, frame = np.unique(self._bodies, return_inverse=True)
        cores, bounds = cores_of(shapes, frame), np.array([s.shape.bound for s in shapes])
        # rows are found to twice this depth: a step may begin deep already
        self.thickness: Array = np.array([s.shape.inner * (1 if isinstance(s.shape, Capsule) else 0.5) for s in shapes])
        # the lowest points of two rims come behind the vertices
        n, corners, edges, faces = self.size, *(int(np.diff(cores[k]).max(initial=0)) for k in (2, 5, 7))
        room: Any = (
            np.zeros(n), np.full(n, -1.0), np.zeros((n, 4, 3)), np.zeros((n, 0, 3), np.int64), np.zeros(n, np.int64),
            np.zeros((n, 4, 3)), np.zeros(n), np.zeros((n, 0)), np.zeros(0, np.int64), np.zeros((corners + 2, 3)),
            np.zeros((max(faces, 1), 4)), np.zeros((2, max(edges, faces)), np.int64), np.zeros((edges, 6)),
            np.zeros((0, 7)), np.zeros(0, np.int64), np.zeros(12), *_contacts(0),
        )  # fmt: skip
        own = cores.sizes[:, 5].copy()
        skin = np.clip(_SKIN * own.sum() / max(n, 1), _SKIN * own, _MOST_SKIN * own)
        eps = ROUNDING * (float(bounds.max(initial=0.0)) + surface.bound)
        # the state of the lists, which the compiled loop shares
        self.at_mesh: Any = held(CoresAtMesh(creases_of(surface), cores, eps, skin, skin.copy(), *room))
        self._make_room(200, 1000, 200)

    def check(self, t: float, q: Array) -> None:
        """Raise `InadmissibleStartError` if the mesh has no row with a shape because it is too deep in it."""
        radius, (_, distance) = self.at_mesh.cores.sizes[:, 4], self._distances(q, self._every)
        found = self.measure(q, self._every, 0.0)
        # what has a row is refused with its depth
        sunk = np.zeros(self.size)
        np.minimum.at(sunk, found.pair, found.gap)
        within = (distance < (1.0 - _WITHIN) * radius) & (sunk > -_WITHIN * radius)
        if within.any():
            k = int(np.flatnonzero(within)[0])
            raise InadmissibleStartError(
                f"the initial configuration is not admissible: {self.surface_name} reaches deep into "
                f"{self.shapes[k].name}, to {distance[k]:.3g} m from its middle; start them farther apart"
            )

    def middles(self) -> Array:
        """Return the middles of the vertices, shape (n, 3)."""
        return np.asarray(self.at_mesh.cores.sizes[:, :3])

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
            surface_distances(self.at_mesh, self._places(q), shapes[apart], *found)
            gap[apart], point[apart], normal[apart] = found
        return Contacts(shapes, gap, point, normal)

    def are_within(self, q: Array, shapes: Array, distance: Array) -> Array:
        """Return which of some shapes in ascending order are nearer than a distance each [m], shape (k,)."""
        self.measure(q, shapes, 0.0)
        # distances take longer than bounds of them
        places = self._places(q)
        near = np.array([free_way(self.at_mesh, places, s) <= far for s, far in zip(shapes, distance, strict=True)])
        near[near] = super().are_within(q, shapes[near], distance[near])
        return near

    def _places(self, q: Array) -> Array:
        return np.ascontiguousarray(self.system.placements(q, self.frames))

    def _make_room(self, triangles: int, features: int, rows: int) -> None:
        """Make arrays for triangles and features of a shape, and for rows; features are listed again."""
        count = max(rows, 20 * self.size)
        shape, gap, point, normal = _contacts(count)
        self.at_mesh.slack[:] = -1.0
        self.at_mesh.replace(
            near=np.zeros(triangles, np.int64), features=np.zeros((self.size, features, 3), np.int64),
            clear_to=np.zeros((self.size, features)), rows=np.zeros((rows, 7)), group=np.zeros(rows, np.int64),
            shape=shape, gap=gap, point=point, normal=normal,
        )  # fmt: skip

    def measure(self, q: Array, shapes: Array, tolerance: float) -> Contacts:
        """Return the contacts of some shapes within the tolerance."""
        places, at = self._places(q), self.at_mesh
        while True:
            count, triangles, features, rows = surface_contacts(at, places, shapes, tolerance)
            room = len(at.near), at.features.shape[1], min(len(at.rows), len(at.shape))
            needed = triangles, features, max(rows, count)
            if all(each <= there for each, there in zip(needed, room, strict=True)):
                return Contacts(*(part[:count].copy() for part in (at.shape, at.gap, at.point, at.normal)))
            self._make_room(*(2 * max(pair) for pair in zip(needed, room, strict=True)))


def _contacts(count: int) -> tuple[Array, Array, Array, Array]:
    """Return room for contacts."""
    return np.zeros(count, np.int64), np.zeros(count), np.zeros((count, 3)), np.zeros((count, 3))

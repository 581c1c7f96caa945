"""The family of spheres against a triangle mesh, which may be concave or open, in closed form."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..compiled import plain_array
from ..geometry.shapes import PlacedShape
from ..geometry.triangles import Cells, Surface, near_triangles, nearest_on_triangles, sorted_into_cells
from ..system import System
from .family import ConstraintFamily
from .pairs import Contacts
from .rows import Array, Rows

# cells hold triangles within a reach: at least this part of the largest radius, and this many times the tolerance
_MARGIN, _ROOM = 0.1, 1.5
# rounding of distances, relative to the size of mesh and spheres
_ROUNDING = 1e-12


class SphereSurface(ConstraintFamily):
    """A mesh of the world, the first body of every pair, against many spheres, the second bodies.

    Parameters
    ----------
    system : System
        What moves the spheres.
    spheres : sequence of PlacedShape
        Spheres on their bodies.
    surface : Surface
        The mesh, in the world's frame.
    name : str
        Name of the mesh.
    restitution : ndarray, shape (n,)
        e of each sphere with it.
    friction : ndarray, shape (n,), or float
        Coefficient of friction of each sphere with it, or of all.

    Notes
    -----
    Constraint i is sphere i. Its rows are the points of the mesh whose distance from its centre is a local minimum. A
    point on an edge or at a corner counts only if it is the nearest point of every triangle that shares it: otherwise a
    sphere that penetrates slightly would collide with the edges between coplanar triangles. A sphere whose centre has
    passed the mesh is pushed out on the other side. The tunnelling guard does not check meshes: a sphere must travel
    less than its radius within a step.
    """

    # the nearest feature of the mesh changes along the motion
    smooth = False

    def __init__(
        self,
        system: System,
        spheres: Sequence[PlacedShape],
        surface: Surface,
        name: str,
        restitution: Array,
        friction: Array | float = 0.0,
    ) -> None:
        self.system, self._surface = system, surface
        self.restitution: Array = restitution
        self.friction = friction
        self._names, self._surface_name = [s.name for s in spheres], name
        self._bodies = np.array([s.body for s in spheres], dtype=np.int64)
        self._local = np.array([s.position for s in spheres])
        self._radii = np.array([s.shape.bound for s in spheres])
        self._corners = surface.vertices[surface.triangles]
        self._largest = float(self._radii.max())
        self._reach, self._room = -np.inf, 4 * len(spheres)
        self._cells: Cells | None = None
        self.size = len(self._radii)

    def describe(self) -> str:
        """Return one line of `Problem.report()`, in words."""
        return f"{self.size} spheres at a mesh"

    def name(self, constraint: int) -> str:
        """Return the name of one pair."""
        return f"{self._names[constraint]} | {self._surface_name}"

    def contacts(self, t: float, q: Array, tolerance: float) -> Rows | None:
        """Return the rows within the tolerance, or None."""
        found = self._measure(q, tolerance)
        near = np.flatnonzero(found.gap <= tolerance)
        if not near.size:
            return None
        sphere, gap, point, normal = (part[near] for part in found)
        rows = self._gradients(q, sphere, point, normal)
        return Rows(sphere, gap, rows, self.restitution[sphere], point, normal)

    def bodies_of(self, numbers: Array) -> tuple[Array, Array]:
        """Return the mesh's body, which is the world, and the bodies of some spheres, shapes (k,)."""
        return np.zeros(len(numbers), np.int64), self._bodies[numbers]

    def nearest(self, q: Array, spheres: Array) -> Contacts:
        """Return the nearest contact of each of some spheres in ascending order."""
        found = self._measure(q, np.inf)
        order = np.lexsort((found.gap, found.pair))
        first = order[np.searchsorted(found.pair[order], spheres)]
        return Contacts(*(part[first] for part in found))

    def nearest_points(self, q: Array) -> tuple[Array, Array]:
        """Return the nearest point of every sphere and the normal there, shapes (n, 3)."""
        return self.nearest(q, np.arange(self.size))[2:]

    def row_points(self, t: float, q: Array, rows: Array) -> tuple[Array, Array]:
        """Return the nearest points of some spheres and the normals there, shapes (k, 3)."""
        point, normal = self.nearest_points(q)
        return point[rows], normal[rows]

    def gap(self, t: float, q: Array) -> Array:
        """Return the distance of every sphere, shape (n,) [m]."""
        return self.nearest(q, np.arange(self.size)).gap

    def gradient(self, t: float, q: Array) -> Any:
        """Return the gradient of every sphere's distance, shape (n, nv)."""
        sphere, _, point, normal = self.nearest(q, np.arange(self.size))
        return self._gradients(q, sphere, point, normal)

    def _gradients(self, q: Array, sphere: Array, point: Array, normal: Array) -> Any:
        bodies = self._bodies[sphere]
        return self.system.separation_rows(q, np.zeros_like(bodies), bodies, point, normal)

    def _measure(self, q: Array, tolerance: float) -> Contacts:
        """Return the points of locally least distance, at least all those within the tolerance."""
        places = self.system.placements(q, self._bodies)
        centres = np.vecmat(self._local, places[:, :3]) + places[:, 3]
        sphere, triangle, feature, foot = self._near(centres, tolerance)
        away = centres[sphere] - foot
        distance = np.sqrt(np.vecdot(away, away))
        number = self._surface.features[triangle, feature]
        # one row for each feature; the nearest point of a sphere is kept even if rounding hides one that shares it
        order = np.lexsort((distance, number, sphere))
        key = sphere[order] * len(self._surface.sharers) + number[order]
        _, first, count = np.unique(key, return_index=True, return_counts=True)
        kept = order[first]
        closest = np.full(self.size, np.inf)
        np.minimum.at(closest, sphere, distance)
        kept = kept[(count >= self._surface.sharers[number[kept]]) | (distance[kept] == closest[sphere[kept]])]
        sphere, away, distance, triangle = sphere[kept], away[kept], distance[kept], triangle[kept]
        a, b, c = self._corners[triangle].transpose(1, 0, 2)
        face = np.cross(b - a, c - a)
        face /= np.linalg.norm(face, axis=1)[:, None]
        apart = distance > 0.0
        normal = np.where(apart[:, None], away / np.where(apart, distance, 1.0)[:, None], face)
        gap = distance - self._radii[sphere]
        point = centres[sphere] - (self._radii[sphere] + 0.5 * gap)[:, None] * normal
        return Contacts(sphere, gap, point, normal)

    def _near(self, centres: Array, tolerance: float) -> tuple[Array, Array, Array, Array]:
        """Return pairs of a sphere and a triangle within the tolerance, as arrays.

        The arrays hold the spheres, the triangles, the features that the nearest points lie on, and these points.
        All triangles that share such a feature are included.
        """
        count = len(self._corners)
        if not np.isfinite(tolerance):
            sphere, triangle = np.repeat(np.arange(self.size), count), np.tile(np.arange(count), self.size)
            a, b, c = self._corners[triangle].transpose(1, 0, 2)
            foot, feature = nearest_on_triangles(a, b, c, centres[sphere])
            return sphere, triangle, feature, foot
        # triangles that share a feature have its nearest point at the same distance, up to rounding
        tolerance += _ROUNDING * (self._largest + self._surface.bound)
        if self._cells is None or tolerance > self._reach:
            # a larger reach than needed now, because later tolerances may be larger
            self._reach = max(_ROOM * tolerance, _MARGIN * self._largest)
            self._cells = sorted_into_cells(self._corners, self._largest + self._reach)
        centres = plain_array(centres)
        while True:
            k = self._room
            sphere, triangle, feature = np.empty(k, np.int64), np.empty(k, np.int64), np.empty(k, np.int64)
            foot = np.empty((k, 3))
            found = near_triangles(
                centres, self._radii, self._corners, *self._cells, tolerance, sphere, triangle, feature, foot
            )
            if found <= k:
                return sphere[:found], triangle[:found], feature[:found], foot[:found]
            self._room = 2 * found

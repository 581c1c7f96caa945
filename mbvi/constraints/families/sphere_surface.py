"""The family of spheres against a triangle mesh, which may be concave or open, in closed form."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...compiled import plain_array
from ...geometry.closed_form.mesh_contacts import mesh_contacts, mesh_distances
from ...geometry.shapes.shapes import PlacedShape
from ...geometry.shapes.triangles import Surface
from ...system import System
from ..family import ConstraintFamily
from ..rows import Array, Rows
from .pairs import Contacts

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
        self._rounding = _ROUNDING * (float(self._radii.max()) + surface.bound)
        self._tree = (surface.vertices, surface.triangles, *surface.tree)
        self._features = surface.features, surface.sharers
        self._make_room(4 * len(spheres))
        self.size = len(self._radii)

    def describe(self) -> str:
        """Return one line of `Problem.report()`, in words."""
        return f"{self.size} spheres at a mesh"

    def name(self, constraint: int) -> str:
        """Return the name of one pair."""
        return f"{self._names[constraint]} | {self._surface_name}"

    def contacts(self, t: float, q: Array, tolerance: float) -> Rows | None:
        """Return the rows within the tolerance, or None."""
        found = self._measure(self._centres(q), self._radii + tolerance, tolerance)
        if not len(found.pair):
            return None
        rows = self._gradients(q, found.pair, found.point, found.normal)
        return Rows(found.pair, found.gap, rows, self.restitution[found.pair], found.point, found.normal)

    def bodies_of(self, numbers: Array) -> tuple[Array, Array]:
        """Return the mesh's body, which is the world, and the bodies of some spheres, shapes (k,)."""
        return np.zeros(len(numbers), np.int64), self._bodies[numbers]

    def nearest(self, q: Array, spheres: Array) -> Contacts:
        """Return the nearest contact of each of some spheres in ascending order."""
        centres = self._centres(q)
        distance = np.zeros(self.size)
        mesh_distances(*self._tree, centres, distance)
        found = self._measure(centres, distance, np.inf)
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

    def _centres(self, q: Array) -> Array:
        places = self.system.placements(q, self._bodies)
        return plain_array(np.vecmat(self._local, places[:, :3]) + places[:, 3])

    def _make_room(self, triangles: int) -> None:
        """Make arrays for triangles about a sphere, and for contacts."""
        k = self._room = triangles
        whole, real = np.empty((4, k), np.int64), np.empty((2, k))
        self._scratch = whole[0], whole[1], real[0], np.empty((k, 3)), whole[2]
        self._found = whole[3], real[1], np.empty((k, 3)), np.empty((k, 3))

    def _measure(self, centres: Array, reach: Array, tolerance: float) -> Contacts:
        """Return the contacts within a tolerance whose distance from each centre is at most its reach."""
        # triangles that share a feature have its nearest point at the same distance, up to rounding
        reach = reach + self._rounding
        while True:
            count, most = mesh_contacts(
                *self._tree, *self._features, centres, self._radii, reach, tolerance, *self._scratch, *self._found
            )
            if max(count, most) <= self._room:
                return Contacts(*(part[:count].copy() for part in self._found))
            self._make_room(2 * max(count, most))

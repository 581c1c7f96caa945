"""The family of spheres against a triangle mesh, which may be concave or open, in closed form."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np

from ...compiled import plain_array
from ...errors import InadmissibleStartError
from ...geometry.closed_form.mesh_contacts import mesh_contacts, mesh_distances
from ...geometry.meshes.triangles import Surface
from ...geometry.shapes.shapes import PlacedShape
from ...system import System
from ..family import ConstraintFamily
from ..rows import Array, Rows
from .pairs import Contacts

# rounding of distances, relative to the size of mesh and spheres
_ROUNDING = 1e-12
# how many radii a centre is behind an open one-sided mesh that pushes it back
_DEEPEST = 0.5
# entries of the table of reaches up to which it is a dense array
_MOST_DENSE = 200_000


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
    passed a sheet is pushed out on the other side; a one-sided mesh pushes it back, if it is open up to a depth of the
    centre of half a radius, below which the sphere is behind it.
    """

    # the nearest feature of the mesh changes along the motion
    smooth = False
    hollow = True

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
        rim = surface.rim if surface.one_sided else np.ones(len(surface.sharers), bool)
        self._features = surface.features, surface.sharers, rim
        self._deepest = np.inf if surface.one_sided and surface.closed else _DEEPEST
        # the least travel from a contact after which a centre has passed
        self.thickness: Array = self._radii
        self._make_room(4 * len(spheres))
        self.size = len(self._radii)

    def describe(self) -> str:
        """Return one line of `Problem.report()`, in words."""
        return f"{self.size} spheres at a mesh"

    def name(self, constraint: int) -> str:
        """Return the name of one pair."""
        return f"{self._names[constraint]} | {self._surface_name}"

    def check(self, t: float, q: Array) -> None:
        """Raise `InadmissibleStartError` if a sphere is wholly within a closed mesh: it has no contact with it."""
        if self._deepest == np.inf:
            gap = self.gap(t, q)
            k = int(gap.argmin())
            if gap[k] < -2.0 * self._radii[k]:
                raise InadmissibleStartError(
                    f"{self._names[k]} is within {self._surface_name}, whose triangles face outwards: if the inside is "
                    f"free, turn their corners around, or take a sheet by add_surface"
                )

    def contacts(self, t: float, q: Array, tolerance: float) -> Rows | None:
        """Return the rows within the tolerance, or None."""
        found = self._measure(self._centres(q), self._radii, self._radii + tolerance, tolerance)
        if not len(found.pair):
            return None
        rows = self._gradients(q, found.pair, found.point, found.normal)
        return Rows(found.pair, found.gap, rows, self.restitution[found.pair], found.point, found.normal)

    def bodies_of(self, numbers: Array) -> tuple[Array, Array]:
        """Return the mesh's body, which is the world, and the bodies of some spheres, shapes (k,)."""
        return np.zeros(len(numbers), np.int64), self._bodies[numbers]

    def nearest(self, q: Array, spheres: Array) -> Contacts:
        """Return the nearest contact of each of some spheres in ascending order."""
        centres, radii = np.ascontiguousarray(self._centres(q)[spheres]), self._radii[spheres]
        distance = np.zeros(len(spheres))
        mesh_distances(*self._tree, centres, distance)
        found = self._measure(centres, radii, distance, np.inf)
        order = np.lexsort((found.gap, found.pair))
        first = order[np.searchsorted(found.pair[order], np.arange(len(spheres)))]
        return Contacts(spheres, *(part[first] for part in found[1:]))

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

    @cached_property
    def _reach(self) -> Any:
        """How far each velocity can carry each centre, sparse, shape (n, nv)."""
        # only the tunnelling guard needs it, and its import is slow
        from scipy.sparse import csr_array, vstack

        each = (self.system.reach(int(b), x, 0.0) for b, x in zip(self._bodies, self._local, strict=True))
        return vstack([csr_array(r[None]) for r in each], format="csr")

    def least_displacement(self) -> float:
        """Return a bound: no centre travels its radius if no entry of a displacement is larger."""
        return float((self._radii / self._reach.sum(axis=1)).min())

    def passed_share(self) -> Array | None:
        """Return the reach divided by the thickness, shape (nv, n); None where there are too many spheres."""
        if self._reach.shape[0] * self._reach.shape[1] > _MOST_DENSE:
            return None
        return np.asarray(self._reach.toarray().T / self._radii)

    def passable(self, q: Array, displacement: Array) -> tuple[Array, Array, Array]:
        """Return the spheres that may pass through the mesh, their travel and their radii; see the base class."""
        travel = np.asarray(self._reach @ np.abs(displacement))
        swift = np.flatnonzero(travel > self._radii)
        if swift.size:
            distance = np.zeros(swift.size)
            mesh_distances(*self._tree, np.ascontiguousarray(self._centres(q)[swift]), distance)
            swift = swift[distance - self._radii[swift] < travel[swift]]
        return swift, travel[swift], self._radii[swift]

    def pair_gap(self, t: float, q: Array, pairs: Array) -> Array:
        """Return the distances of some spheres in ascending order, shape (k,) [m]."""
        return self.nearest(q, pairs).gap

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

    def _measure(self, centres: Array, radii: Array, reach: Array, tolerance: float) -> Contacts:
        """Return the contacts of some spheres within a tolerance, no farther from each centre than its reach."""
        # triangles that share a feature have its nearest point at the same distance, up to rounding
        reach = reach + self._rounding
        while True:
            count, most = mesh_contacts(
                *self._tree, *self._features, centres, radii, reach, tolerance, self._deepest,
                *self._scratch, *self._found,
            )  # fmt: skip
            if max(count, most) <= self._room:
                return Contacts(*(part[:count].copy() for part in self._found))
            self._make_room(2 * max(count, most))

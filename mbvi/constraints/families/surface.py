"""The families of shapes against a triangle mesh of the world: what they share, and spheres in closed form."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np

from ...compiled import plain_array
from ...errors import InadmissibleStartError
from ...geometry.at_meshes.mesh_contacts import mesh_contacts
from ...geometry.at_meshes.near_triangles import mesh_distances
from ...geometry.meshes.triangles import Surface
from ...geometry.shapes.shapes import PlacedShape
from ...system import System
from ..family import ConstraintFamily
from ..mechanism.meshes import BallsAtMesh
from ..rebuilt import Rebuilt
from ..relative_ways import shared_lengths
from ..rows import Array, Rows
from .pairs import Contacts

# rounding of distances, relative to the size of mesh and shapes
ROUNDING = 1e-12
# how many radii a centre is behind an open one-sided mesh that pushes it back
_DEEPEST = 0.5
# entries of the table of reaches up to which it is a dense array
_MOST_DENSE = 200_000
# the most triangles near a sphere that are kept from step to step
_MOST_LISTED = 64


class SurfaceContacts(Rebuilt, ConstraintFamily):
    """A mesh of the world, the first body of every pair, against shapes, the second bodies; constraint i is shape i.

    Parameters
    ----------
    system : System
        What moves the shapes.
    shapes : sequence of PlacedShape
        Shapes on their bodies.
    surface : Surface
        The mesh, in the world's frame.
    name : str
        Name of the mesh.
    restitution : ndarray, shape (n,)
        e of each shape with it.
    friction : ndarray, shape (n,), or float
        Coefficient of friction of each shape with it, or of all.
    """

    # the features that touch change along the motion
    smooth = False
    hollow = True
    isotropic = True
    # what the shapes are called
    kind = "shape"

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
        self.surface_name, self.shapes = name, list(shapes)
        self._bodies = np.array([s.body for s in shapes], dtype=np.int64)
        self._every = np.arange(self.size)
        self._tree = surface.vertices, surface.triangles, *surface.tree

    def describe(self) -> str:
        """Return one line of `Problem.report()`, in words."""
        return f"{self.size} {self.kind}{'s' * (self.size != 1)} at a mesh"

    def name(self, constraint: int) -> str:
        """Return the name of one pair."""
        return f"{self.shapes[constraint].name} | {self.surface_name}"

    @abstractmethod
    def measure(self, q: Array, shapes: Array, tolerance: float) -> Contacts:
        """Return the contacts of some shapes within the tolerance."""

    @abstractmethod
    def nearest(self, q: Array, shapes: Array) -> Contacts:
        """Return the nearest contact of each of some shapes in ascending order."""

    @abstractmethod
    def carried(self, shape: PlacedShape) -> float:
        """Return the radius about its frame of what the tunnelling guard follows of a shape [m]."""

    def contacts(self, t: float, q: Array, tolerance: float) -> Rows | None:
        """Return the rows within the tolerance, or None."""
        pair, gap, point, normal = self.measure(q, self._every, tolerance)
        if not len(pair):
            return None
        rows = self._gradients(q, pair, point, normal)
        return Rows(pair, gap, rows, self.restitution[pair], point, normal)

    def bodies_of(self, numbers: Array) -> tuple[Array, Array]:
        """Return the mesh's body, which is the world, and the bodies of some shapes, shapes (k,)."""
        return np.zeros(len(numbers), np.int64), self._bodies[numbers]

    def nearest_points(self, q: Array) -> tuple[Array, Array]:
        """Return the nearest point of every shape and the normal there, shapes (n, 3)."""
        return self.nearest(q, self._every)[2:]

    def row_points(self, t: float, q: Array, rows: Array) -> tuple[Array, Array]:
        """Return the nearest points of some shapes and the normals there, shapes (k, 3)."""
        return self.nearest(q, rows)[2:]

    def gap(self, t: float, q: Array) -> Array:
        """Return the distance of every shape, shape (n,) [m]."""
        return self.nearest(q, self._every).gap

    def nearest_of(self, t: float, q: Array, pairs: Array) -> tuple[Array, None]:
        """Return the distances of some shapes in ascending order, shape (k,) [m]; no normals."""
        return self.nearest(q, pairs).gap, None

    def gradient(self, t: float, q: Array) -> Any:
        """Return the gradient of every shape's distance, shape (n, nv)."""
        shape, _, point, normal = self.nearest(q, self._every)
        return self._gradients(q, shape, point, normal)

    @abstractmethod
    def middles(self) -> Array:
        """Return the middle of each shape in its body's frame, shape (n, 3)."""

    def _placed(self, q: Array, shapes: Array) -> Array:
        """Return the middles of some shapes, shape (k, 3)."""
        places = self.system.placements(q, self._bodies[shapes])
        return plain_array(np.vecmat(self.middles()[shapes], places[:, :3]) + places[:, 3])

    def _distances(self, q: Array, shapes: Array) -> tuple[Array, Array]:
        """Return the middles of some shapes, and their distances from the mesh, shapes (k, 3) and (k,) [m]."""
        centres, distance = self._placed(q, shapes), np.zeros(len(shapes))
        mesh_distances(*self._tree, centres, distance)
        return centres, distance

    def _gradients(self, q: Array, shape: Array, point: Array, normal: Array) -> Any:
        bodies = self._bodies[shape]
        return self.system.separation_rows(q, np.zeros_like(bodies), bodies, point, normal)

    def reach_of(self, numbers: Array) -> Array:
        """Return the reach of some shapes, shape (k, nv): what is followed of each."""
        return np.asarray(self._reach[numbers].toarray())

    def bending_envelope(self) -> Array:
        """Return the largest reach of any shape, shape (nv,)."""
        return np.asarray(self._reach.max(axis=0).toarray()).ravel() if self.size else np.zeros(self.system.nv)

    @cached_property
    def _reach(self) -> Any:
        """How far each velocity can carry what is followed of each shape, sparse, shape (n, nv)."""
        # its import is slow
        from scipy.sparse import csr_array, vstack

        each = (self.system.reach(s.body, s.position, self.carried(s)) for s in self.shapes)
        return vstack([csr_array(r[None]) for r in each], format="csr")

    def least_displacement(self) -> float:
        """Return a bound: no shape travels its thickness if no entry of a displacement is larger."""
        return float((self.thickness / self._reach.sum(axis=1)).min())

    def passed_share(self) -> Array | None:
        """Return the reach divided by the thickness, shape (nv, n); None where there are too many shapes."""
        if self._reach.shape[0] * self._reach.shape[1] > _MOST_DENSE:
            return None
        return np.asarray(self._reach.toarray().T / self.thickness)

    def passable(self, q: Array, displacement: Array) -> tuple[Array, Array, Array]:
        """Return the shapes that may pass through the mesh, their travel and thickness; see the base class."""
        travel = np.asarray(self._reach @ shared_lengths(self.system, displacement))
        thickness = np.asarray(self.thickness)
        swift = np.flatnonzero(travel > thickness)
        if swift.size:
            swift = swift[self.are_within(q, swift, travel[swift])]
        return swift, travel[swift], thickness[swift]

    def are_within(self, q: Array, shapes: Array, distance: Array) -> Array:
        """Return which of some shapes in ascending order are nearer than a distance each [m], shape (k,)."""
        return np.asarray(self.nearest(q, shapes).gap < distance)


class SphereSurface(SurfaceContacts):
    """Many spheres at a mesh; the parameters are those of `SurfaceContacts`.

    Notes
    -----
    Rows are the points of the mesh whose distance from the centre is a local minimum. A point on an edge or at a corner
    counts only if it is the nearest point of every triangle that shares it: otherwise a sphere that penetrates slightly
    would collide with the edges between coplanar triangles. A sphere whose centre has passed a sheet is pushed out on
    the other side; a one-sided mesh pushes it back, if it is open up to a depth of the centre of half a radius, below
    which the sphere is behind it.
    """

    kind = "sphere"

    def __init__(
        self,
        system: System,
        spheres: Sequence[PlacedShape],
        surface: Surface,
        name: str,
        restitution: Array,
        friction: Array | float = 0.0,
    ) -> None:
        super().__init__(system, spheres, surface, name, restitution, friction)
        self._local = np.array([s.position for s in spheres]).reshape(-1, 3)
        self._radii = np.array([s.shape.bound for s in spheres], dtype=float)
        self._rounding = ROUNDING * (float(self._radii.max(initial=0.0)) + surface.bound)
        self._tree = (surface.vertices, surface.triangles, *surface.tree)
        rim = surface.rim if surface.one_sided else np.ones(len(surface.sharers), bool)
        self._features = surface.features, surface.sharers, rim
        self._deepest = np.inf if surface.one_sided and surface.closed else _DEEPEST
        # the least travel from a contact after which a centre has passed
        self.thickness: Array = self._radii
        self._make_room(4 * len(spheres))

    def check(self, t: float, q: Array) -> None:
        """Raise `InadmissibleStartError` if a sphere is wholly within a closed mesh: it has no contact with it."""
        if self._deepest == np.inf:
            gap = self.gap(t, q)
            k = int(gap.argmin())
            if gap[k] < -2.0 * self._radii[k]:
                inside = f"{self.shapes[k].name} is within {self.surface_name}, whose triangles face outwards"
                raise InadmissibleStartError(
                    f"{inside}: if the inside is free, turn their corners around, or take a sheet by add_surface"
                )

    def middles(self) -> Array:
        """Return the centres of the spheres, shape (n, 3)."""
        return self._local

    def carried(self, shape: PlacedShape) -> float:
        """Return 0: the centre is followed."""
        return 0.0

    def measure(self, q: Array, shapes: Array, tolerance: float) -> Contacts:
        """Return the contacts of some spheres within the tolerance."""
        radii = self._radii[shapes]
        return self._contacts(self._placed(q, shapes), shapes, radii + tolerance, tolerance)

    def nearest(self, q: Array, shapes: Array) -> Contacts:
        """Return the nearest contact of each of some spheres in ascending order."""
        centres, distance = self._distances(q, shapes)
        found = self._contacts(centres, shapes, distance, np.inf)
        order = np.lexsort((found.gap, found.pair))
        first = order[np.searchsorted(found.pair[order], shapes)]
        return Contacts(*(part[first] for part in found))

    def loop_table(self) -> BallsAtMesh:
        """Return what the compiled loop needs, with room of its own."""
        n, k = self.size, max(256, 16 * self.size)
        listed: Any = np.zeros((n, 1 + _MOST_LISTED), np.int64), np.zeros((n, 4))
        room: Any = np.zeros((n, 3)), np.zeros(n), *listed, *np.zeros((2, k), np.int64), np.zeros(k), np.zeros((k, 3))
        found: Any = np.zeros(k, np.int64), np.zeros(k), *np.zeros((2, k, 3))
        rank = np.zeros(k, np.int64)
        fields: Any = (
            *self._tree, *self._features, self._deepest, self._rounding, self._local, self._radii, *room, rank, *found,
        )  # fmt: skip
        return BallsAtMesh(*fields)

    def _make_room(self, triangles: int) -> None:
        """Make arrays for triangles about a sphere, and for contacts."""
        k = self._room = triangles
        whole, real = np.empty((4, k), np.int64), np.empty((2, k))
        self._scratch = whole[0], whole[1], real[0], np.empty((k, 3)), whole[2]
        self._found = whole[3], real[1], np.empty((k, 3)), np.empty((k, 3))

    def _contacts(self, centres: Array, shapes: Array, reach: Array, tolerance: float) -> Contacts:
        """Return the contacts of some spheres within a tolerance, no farther from each centre than its reach."""
        # triangles that share a feature have its nearest point at the same distance, up to rounding
        reach, radii = reach + self._rounding, self._radii[shapes]
        # each call is for other spheres: no lists of near triangles are kept
        kept = np.zeros((len(shapes), 0), np.int64), np.zeros((len(shapes), 4))
        while True:
            count, most = mesh_contacts(
                *self._tree, *self._features, centres, radii, reach, tolerance, self._deepest,
                *kept, *self._scratch, *self._found,
            )  # fmt: skip
            if max(count, most) <= self._room:
                own, *others = (part[:count].copy() for part in self._found)
                return Contacts(shapes[own], *others)
            self._make_room(2 * max(count, most))

"""Triangle meshes as they are, hollows and all, against frictionless spheres in closed form."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ..errors import InputError
from ..system import System
from .active import Array, Rows
from .pairs import Contacts
from .shapes import PlacedShape

# vertices nearer than this are one, in extents of the mesh; triangles of less than its square have no face
_SAME_VERTEX = 1e-9
# cells that triangles are sorted into, at most about; room for tolerances that grow, in largest radii
_MOST_CELLS, _MARGIN = 200_000, 0.1


class Surface:
    """A triangle mesh: a sheet without thickness, solid from both sides.

    Parameters
    ----------
    vertices : array_like, shape (v, 3)
        Points [m]; those that coincide become one.
    triangles : array_like of int, shape (t, 3)
        Which three points each face has; those without an area are left out.

    Attributes
    ----------
    features : ndarray of int, shape (t, 7)
        Numbers of each triangle's corners, of its edges ab, bc and ca, and of its face.
    sharers : ndarray of int, shape (f,)
        How many triangles have each feature.

    Raises
    ------
    InputError
        On wrong shapes, numbers that are not finite, or no triangle with an area.
    """

    smooth = False

    def __init__(self, vertices: Array, triangles: Array) -> None:
        points, corners = np.array(vertices, dtype=float), np.array(triangles)
        if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all() or not len(points):
            raise InputError(f"vertices has shape {points.shape}; finite numbers of shape (v, 3) are asked for")
        if corners.ndim != 2 or corners.shape[1] != 3 or corners.dtype.kind not in "iu":
            raise InputError(f"triangles has shape {corners.shape}; integers of shape (t, 3) are asked for")
        if corners.size and not 0 <= corners.min() <= corners.max() < len(points):
            raise InputError(f"triangles name vertices that are not there: there are {len(points)}")
        extent = float(np.ptp(points, axis=0).max())
        # an STL file repeats a vertex for each of its triangles
        grid = np.round((points - points.min(axis=0)) / max(_SAME_VERTEX * extent, 1e-300))
        _, first, welded = np.unique(grid, axis=0, return_index=True, return_inverse=True)
        points, corners = points[first], welded.reshape(-1)[corners]
        a, b, c = (points[corners[:, k]] for k in range(3))
        area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
        kept = area > (_SAME_VERTEX * extent) ** 2
        if not kept.any():
            raise InputError("the mesh has no triangle with an area")
        self.vertices, self.triangles = points, corners[kept].astype(np.int64)
        self.features, self.sharers = _features(self.triangles, len(points))

    @property
    def bound(self) -> float:
        """Radius of a ball about the frame's origin that holds the mesh [m]."""
        return float(np.sqrt((self.vertices**2).sum(axis=1).max()))


def _features(triangles: Array, vertices: int) -> tuple[Array, Array]:
    sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2)
    edges, which = np.unique(sides.reshape(-1, 2), axis=0, return_inverse=True)
    faces = vertices + len(edges) + np.arange(len(triangles))
    features = np.column_stack([triangles, vertices + which.reshape(-1, 3), faces])
    return features, np.bincount(features.ravel(), minlength=faces[-1] + 1)


def nearest_on_triangles(a: Array, b: Array, c: Array, x: Array) -> tuple[Array, Array]:
    """Return the point of each triangle abc nearest to x, shapes (k, 3), and on which of its features it lies.

    Features are numbered as the columns of `Surface.features`.

    Notes
    -----
    C. Ericson, Real-Time Collision Detection (2005), section 5.1.5.
    """
    ab, ac = b - a, c - a
    (d1, d2), (d3, d4), (d5, d6) = ((np.vecdot(ab, x - p), np.vecdot(ac, x - p)) for p in (a, b, c))
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    cases = [
        (d1 <= 0.0) & (d2 <= 0.0),
        (d3 >= 0.0) & (d4 <= d3),
        (vc <= 0.0) & (d1 >= 0.0) & (d3 <= 0.0),
        (d6 >= 0.0) & (d5 <= d6),
        (vb <= 0.0) & (d2 >= 0.0) & (d6 <= 0.0),
        (va <= 0.0) & (d4 >= d3) & (d5 >= d6),
    ]
    feature = np.select(cases, [0, 1, 3, 2, 5, 4], 6)
    with np.errstate(divide="ignore", invalid="ignore"):
        along_ab, along_ac, along_bc = d1 / (d1 - d3), d2 / (d2 - d6), (d4 - d3) / ((d4 - d3) + (d5 - d6))
        inside = 1.0 / (va + vb + vc)
        zero = np.zeros(len(x))
        v = np.select(cases, [zero, zero + 1.0, along_ab, zero, zero, 1.0 - along_bc], vb * inside)
        w = np.select(cases, [zero, zero, zero, zero + 1.0, along_ac, along_bc], vc * inside)
    return a + v[:, None] * ab + w[:, None] * ac, feature


class _Cells(NamedTuple):
    """Which triangles are within a reach of the points of each cell of a grid."""

    low: Array
    edge: float
    shape: Array
    start: Array
    triangle: Array


def _sorted_into_cells(corners: Array, reach: float) -> _Cells:
    """Sort triangles, shape (t, 3, 3), into cells."""
    lower, upper = corners.min(axis=1) - reach, corners.max(axis=1) + reach
    low, size = lower.min(axis=0), upper.max(axis=0) - lower.min(axis=0)
    edge = max(reach, float(np.cbrt(size.prod() / _MOST_CELLS)))
    shape = np.floor(size / edge).astype(np.int64) + 1
    first, last = np.floor((lower - low) / edge).astype(np.int64), np.floor((upper - low) / edge).astype(np.int64)
    cell = []
    for begin, end in zip(first, last, strict=True):
        x, y, z = (np.arange(b, e + 1) for b, e in zip(begin, end, strict=True))
        cell.append(((x[:, None, None] * shape[1] + y[:, None]) * shape[2] + z).ravel())
    triangle, cells = np.repeat(np.arange(len(corners)), [len(part) for part in cell]), np.concatenate(cell)
    order = np.argsort(cells, kind="stable")
    start = np.searchsorted(cells[order], np.arange(int(shape.prod()) + 1))
    return _Cells(low, edge, shape, start, triangle[order])


class SphereSurface:
    """A mesh of the world (first) against many spheres (second).

    Parameters
    ----------
    system : System
        What moves the spheres.
    spheres : sequence of PlacedShape
        Spheres on their bodies.
    surface : Surface
        The mesh, in the world's frame.
    name : str
        The mesh's.
    restitution : ndarray, shape (n,)
        e of each sphere with it.

    Notes
    -----
    Constraint i is sphere i. Its rows are the points of the mesh that are nearer to its centre than all about them: on
    an edge or at a corner only where every triangle that has it says so, for else a sphere that has sunk in by a hair
    would catch at the edges between coplanar triangles. A centre that has passed the sheet is pushed on: steps are to
    be shorter than a radius.
    """

    def __init__(
        self,
        system: System,
        spheres: Sequence[PlacedShape],
        surface: Surface,
        name: str,
        restitution: Array,
    ) -> None:
        self.system, self._surface, self.restitution = system, surface, restitution
        self._names, self._surface_name = [s.name for s in spheres], name
        self._bodies = np.array([s.body for s in spheres], dtype=np.int64)
        self._local = np.array([s.position for s in spheres])
        self._radii = np.array([s.shape.bound for s in spheres])
        self._corners = surface.vertices[surface.triangles]
        self._largest = float(self._radii.max())
        self._reach = -np.inf
        self._cells: _Cells | None = None

    @property
    def size(self) -> int:
        """How many spheres there are."""
        return len(self._radii)

    def name(self, constraint: int) -> str:
        """Return the name of one pair."""
        return f"{self._names[constraint]} | {self._surface_name}"

    def active(self, t: float, q: Array, tolerance: float, travel: Array | None) -> Rows | None:
        """Return the rows within the tolerance, or None."""
        found = self._contacts(q, tolerance)
        near = np.flatnonzero(found.gap <= tolerance)
        if not near.size:
            return None
        sphere, gap, point, normal = (part[near] for part in found)
        rows = self._gradients(q, sphere, point, normal)
        return Rows(sphere, gap, rows, self.restitution[sphere], point, normal)

    def nearest(self, q: Array, spheres: Array) -> Contacts:
        """Return the nearest contact of each of some spheres in ascending order."""
        found = self._contacts(q, np.inf)
        order = np.lexsort((found.gap, found.pair))
        first = order[np.searchsorted(found.pair[order], spheres)]
        return Contacts(*(part[first] for part in found))

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

    def _contacts(self, q: Array, tolerance: float) -> Contacts:
        """Return the points that are nearest among those about them, of all within the tolerance at least."""
        places = self.system.placements(q, self._bodies)
        centres = np.vecmat(self._local, places[:, :3]) + places[:, 3]
        sphere, triangle = self._candidates(centres, tolerance)
        a, b, c = self._corners[triangle].transpose(1, 0, 2)
        foot, feature = nearest_on_triangles(a, b, c, centres[sphere])
        away = centres[sphere] - foot
        distance = np.sqrt(np.vecdot(away, away))
        number = self._surface.features[triangle, feature]
        # one row a feature; the nearest of all has nothing nearer about it, whatever the rounding
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

    def _candidates(self, centres: Array, tolerance: float) -> tuple[Array, Array]:
        """Return spheres and triangles that may be within the tolerance of each other."""
        count = len(self._corners)
        if not np.isfinite(tolerance):
            return np.repeat(np.arange(self.size), count), np.tile(np.arange(count), self.size)
        if self._cells is None or tolerance > self._reach:
            self._reach = max(tolerance, _MARGIN * self._largest)
            self._cells = _sorted_into_cells(self._corners, self._largest + self._reach)
        low, edge, shape, start, triangle = self._cells
        place = np.floor((centres - low) / edge).astype(np.int64)
        inside = np.flatnonzero(((place >= 0) & (place < shape)).all(axis=1))
        x, y, z = place[inside].T
        cell = (x * shape[1] + y) * shape[2] + z
        number = start[cell + 1] - start[cell]
        first = np.repeat(start[cell] - np.cumsum(number) + number, number)
        return np.repeat(inside, number), triangle[first + np.arange(int(number.sum()))]

"""Triangle meshes: faces, edges and vertices, nearest points of triangles, and cells of triangles."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..arguments import Array
from ..compiled import kernel
from ..errors import InputError

# vertices nearer than this part of the mesh's extent are merged; triangles of less than its square have no area
_SAME_VERTEX = 1e-9
# about the most cells of a grid, by its volume
_MOST_CELLS = 200_000
# cells are enlarged while there are more than this many times that number
_TOO_MANY = 8


class Surface:
    """A triangle mesh: a sheet without thickness that spheres touch from both sides.

    Parameters
    ----------
    vertices : array_like, shape (v, 3)
        Points [m]; coincident ones are merged.
    triangles : array_like of int, shape (t, 3)
        The three vertices of each triangle; triangles without an area are left out.

    Attributes
    ----------
    features : ndarray of int, shape (t, 7)
        Numbers of each triangle's corners, of its edges ab, bc and ca, and of its face.
    sharers : ndarray of int, shape (f,)
        Number of triangles that share each feature.

    Raises
    ------
    InputError
        On wrong shapes, numbers that are not finite, or no triangle with an area.
    """

    smooth = False

    def __init__(self, vertices: Array, triangles: Array) -> None:
        points, corners = np.array(vertices, dtype=float), np.array(triangles)
        if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all() or not len(points):
            raise InputError(f"vertices has shape {points.shape}; finite numbers of shape (v, 3) are expected")
        if corners.ndim != 2 or corners.shape[1] != 3 or corners.dtype.kind not in "iu":
            raise InputError(f"triangles has shape {corners.shape}; integers of shape (t, 3) are expected")
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
    """Return `Surface.features` and `Surface.sharers` of triangles over a number of vertices."""
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


class Cells(NamedTuple):
    """For each cell of a grid, the triangles that may be within a reach of its points.

    Attributes
    ----------
    low : ndarray, shape (3,)
        Corner of the grid [m].
    edge : float
        Edge of a cell [m].
    shape : ndarray of int, shape (3,)
        Numbers of cells along x, y and z; cell (x, y, z) has the number (x shape[1] + y) shape[2] + z.
    start : ndarray of int, shape (c + 1,)
        The triangles of cell k are triangle[start[k]:start[k + 1]].
    triangle : ndarray of int, shape (n,)
        Triangles, cell after cell.
    """

    low: Array
    edge: float
    shape: Array
    start: Array
    triangle: Array


def sorted_into_cells(corners: Array, reach: float) -> Cells:
    """Sort triangles, shape (t, 3, 3), into cells; a triangle is in every cell within `reach` of its bounding box."""
    lower, upper = corners.min(axis=1) - reach, corners.max(axis=1) + reach
    low, size = lower.min(axis=0), upper.max(axis=0) - lower.min(axis=0)
    edge = max(reach, float(np.cbrt(size.prod() / _MOST_CELLS)))
    # a wide, flat mesh has little volume but one layer of many cells
    while (np.floor(size / edge) + 1.0).prod() > _TOO_MANY * _MOST_CELLS:
        edge *= 1.5
    shape = np.floor(size / edge).astype(np.int64) + 1
    first, last = np.floor((lower - low) / edge).astype(np.int64), np.floor((upper - low) / edge).astype(np.int64)
    cell = []
    for begin, end in zip(first, last, strict=True):
        x, y, z = (np.arange(b, e + 1) for b, e in zip(begin, end, strict=True))
        cell.append(((x[:, None, None] * shape[1] + y[:, None]) * shape[2] + z).ravel())
    triangle, cells = np.repeat(np.arange(len(corners)), [len(part) for part in cell]), np.concatenate(cell)
    order = np.argsort(cells, kind="stable")
    start = np.searchsorted(cells[order], np.arange(int(shape.prod()) + 1))
    return Cells(low, edge, shape, start, triangle[order])


@kernel(
    "i8(f8[:,::1], f8[::1], f8[:,:,::1], f8[::1], f8, i8[::1], i8[::1], i8[::1], f8, i8[::1], i8[::1], i8[::1],"
    " f8[:,::1])"
)
def near_triangles(
    centres: Array, radii: Array, corners: Array, low: Array, edge: float, shape: Array, start: Array, listed: Array,
    tolerance: float, sphere: Array, triangle: Array, feature: Array, foot: Array,
) -> int:  # fmt: skip
    """Write the pairs of a sphere and a triangle within a tolerance; return how many there are.

    If they are more than the arrays have room for, only the first are written.

    Parameters
    ----------
    centres, radii : ndarray, shapes (n, 3) and (n,)
        The spheres [m].
    corners : ndarray, shape (t, 3, 3)
        The triangles [m].
    low, edge, shape, start, listed
        The fields of `Cells`, in this order.
    tolerance : float
        Largest gap [m].
    sphere, triangle, feature, foot : ndarray, shapes (k,), (k,), (k,), (k, 3)
        Receive the sphere, the triangle, the column of `Surface.features` on which the triangle's nearest point lies,
        and that point; in the order of spheres.
    """
    count = 0
    ab, ac, rest = np.empty(3), np.empty(3), np.empty(3)
    for i in range(len(radii)):
        x = np.int64(np.floor((centres[i, 0] - low[0]) / edge))
        y = np.int64(np.floor((centres[i, 1] - low[1]) / edge))
        z = np.int64(np.floor((centres[i, 2] - low[2]) / edge))
        if not (0 <= x < shape[0] and 0 <= y < shape[1] and 0 <= z < shape[2]):
            continue
        cell = (x * shape[1] + y) * shape[2] + z
        far = radii[i] + tolerance
        for k in range(start[cell], start[cell + 1]):
            t, apart = listed[k], False
            d1 = d2 = d3 = d4 = d5 = d6 = 0.0
            for c in range(3):
                A, B, C, X = corners[t, 0, c], corners[t, 1, c], corners[t, 2, c], centres[i, c]
                apart = apart or X < min(A, B, C) - far or X > max(A, B, C) + far
                ab[c], ac[c] = B - A, C - A
                d1 += ab[c] * (X - A)
                d2 += ac[c] * (X - A)
                d3 += ab[c] * (X - B)
                d4 += ac[c] * (X - B)
                d5 += ab[c] * (X - C)
                d6 += ac[c] * (X - C)
            if apart:
                continue
            va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
            if d1 <= 0.0 and d2 <= 0.0:
                what, v, w = 0, 0.0, 0.0
            elif d3 >= 0.0 and d4 <= d3:
                what, v, w = 1, 1.0, 0.0
            elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
                what, v, w = 3, d1 / (d1 - d3), 0.0
            elif d6 >= 0.0 and d5 <= d6:
                what, v, w = 2, 0.0, 1.0
            elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
                what, v, w = 5, 0.0, d2 / (d2 - d6)
            elif va <= 0.0 and d4 >= d3 and d5 >= d6:
                w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
                what, v = 4, 1.0 - w
            else:
                inside = 1.0 / (va + vb + vc)
                what, v, w = 6, vb * inside, vc * inside
            square = 0.0
            for c in range(3):
                rest[c] = corners[t, 0, c] + v * ab[c] + w * ac[c]
                square += (centres[i, c] - rest[c]) ** 2
            if np.sqrt(square) - radii[i] <= tolerance:
                if count < len(sphere):
                    sphere[count], triangle[count], feature[count] = i, t, what
                    foot[count, 0], foot[count, 1], foot[count, 2] = rest[0], rest[1], rest[2]
                count += 1
    return count

"""Hulls of fewer vertices within a tolerance of a hull: some of its own vertices, so that they lie within it."""

from __future__ import annotations

import numpy as np

from ...errors import InputError
from .polyhedra import Array, Hull

# part of the vertices that is kept at most
_WORTH = 0.9
# points compared with all faces at a time, so that the matrix stays in the processor's cache
_AT_ONCE = 32
_DIRECTIONS = np.array([[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if x or y or z])


def fewer_vertices(hull: Hull, tolerance: float) -> tuple[Hull, float] | None:
    """Return a hull of some of a hull's vertices, and an upper bound of the Hausdorff distance of the two [m].

    It starts from the vertices that the tolerance [m] asks for, and the outermost ones in 26 directions. Then of
    the vertices beyond the tolerance the farthest over each face is added, until there are none.

    Returns
    -------
    tuple of Hull and float, or None
        None if more than nine tenths of the vertices would be kept.
    """
    points = hull.vertices
    most = int(_WORTH * len(points))
    kept = _needed(hull) > tolerance
    kept[np.argmax(points @ _DIRECTIONS.T, axis=0)] = True
    left = np.flatnonzero(~kept)
    while np.count_nonzero(kept) <= most:
        try:
            fewer = Hull(points[kept])
        except InputError:
            return None
        distance, face = _outside(fewer, points[left])
        far = distance > tolerance
        if not far.any():
            # a point within the tolerance stays there as the hull grows, but Qhull may have dropped one that was kept
            distance = _outside(fewer, points)[0]
            return (fewer, float(distance.max())) if distance.max() <= tolerance else None
        left, distance, face = left[far], distance[far], face[far]
        order = np.lexsort((-distance, face))
        kept[left[order[np.unique(face[order], return_index=True)[1]]]] = True
        left = left[~kept[left]]
    return None


def _needed(hull: Hull) -> Array:
    """Return lower bounds of the distances from each vertex to the hull of the others, shape (n,) [m].

    Along a normal of the hull at a vertex the second outermost vertex is a neighbour of it.
    """
    points, triangles = hull.vertices, hull.triangles
    a, b, c = (points[triangles[:, k]] for k in range(3))
    area = np.cross(b - a, c - a)
    corner = triangles.ravel()
    total = np.stack([np.bincount(corner, np.repeat(x, 3), len(points)) for x in area.T], axis=1)
    # a vertex whose triangles have no area has NaN, and is not needed
    with np.errstate(invalid="ignore"):
        normal = total / np.linalg.norm(total, axis=1)[:, None]
    # each edge is a side of two triangles, once in each direction
    other = np.roll(triangles, -1, axis=1).ravel()
    gap = np.full(len(points), np.inf)
    np.minimum.at(gap, corner, np.vecdot(normal[corner], points[corner] - points[other]))
    return gap


def _outside(hull: Hull, points: Array) -> tuple[Array, Array]:
    """Return upper bounds of the distances of points to a hull [m], and the face that each is farthest above, (n,)."""
    normals, offsets = hull.faces
    distance, above = np.zeros(len(points)), np.zeros(len(points), np.int64)
    for start in range(0, len(points), _AT_ONCE):
        part = slice(start, start + _AT_ONCE)
        height = points[part] @ normals.T
        height -= offsets
        above[part] = height.argmax(axis=1)
        # the nearest point lies on a face that is seen from the point
        point, face = np.nonzero(height > 0.0)
        point += start
        distance[point] = np.inf
        corners = hull.vertices[hull.triangles[face]]
        np.minimum.at(distance, point, _distances(points[point], *(corners[:, k] for k in range(3))))
    return distance, above


def _distances(x: Array, a: Array, b: Array, c: Array) -> Array:
    """Return the distances of points to triangles, shape (n,), from points that rounding leaves on the triangles."""
    across = np.cross(b - a, c - a)
    parts = [np.vecdot(across, np.cross(q - p, x - p)) for p, q in ((b, c), (c, a), (a, b))]
    weights = np.maximum(np.stack(parts, axis=1), 0.0)
    with np.errstate(invalid="ignore"):
        weights /= weights.sum(axis=1)[:, None]
    least = np.linalg.norm(x - np.einsum("nk,knj->nj", weights, np.stack([a, b, c])), axis=1)
    for p, q in ((a, b), (b, c), (c, a)):
        along = np.vecdot(x - p, q - p) / np.vecdot(q - p, q - p)
        foot = p + np.clip(along, 0.0, 1.0)[:, None] * (q - p)
        # a triangle without an area has NaN for its weights
        least = np.fmin(least, np.linalg.norm(x - foot, axis=1))
    return np.asarray(least)

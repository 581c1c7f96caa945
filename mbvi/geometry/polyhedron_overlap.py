"""Penetration depth of two polyhedra by the separating axis test over all faces and pairs of edges: slow and exact."""

from __future__ import annotations

import numpy as np

from ..arguments import Array
from .polyhedra import Hull, Polyhedron

# points within this part of the shape's extent of the outermost one count as outermost, too
_EQUALLY_FAR = 1e-7
# edges with a smaller sine of their angle are parallel: their cross product is no axis
_PARALLEL = 1e-9


def overlap(a: Polyhedron, place_a: Array, b: Polyhedron, place_b: Array) -> tuple[float, Array, Array]:
    """Return signed distance, unit normal from first to second, and the point midway, of two polyhedra that overlap.

    Parameters
    ----------
    a, b : Polyhedron
        The shapes.
    place_a, place_b : ndarray, shape (4, 3)
        Their placements: the columns of the rotation, then the origin, as rows.
    """
    points = [shape.vertices @ place[:3] + place[3] for shape, place in ((a, place_a), (b, place_b))]
    edges = [_edges(shape) @ place[:3] for shape, place in ((a, place_a), (b, place_b))]
    across = np.cross(edges[0][:, None], edges[1][None]).reshape(-1, 3)
    length = np.linalg.norm(across, axis=1)
    across = across[length > _PARALLEL] / length[length > _PARALLEL, None]
    axes = np.concatenate([a.faces[0] @ place_a[:3], -b.faces[0] @ place_b[:3], across, -across])
    apart = (axes @ points[1].T).min(axis=1) - (axes @ points[0].T).max(axis=1)
    best = int(np.argmax(apart))
    distance, normal = float(apart[best]), axes[best]
    first, second = _outermost(points[0], normal), _outermost(points[1], -normal)
    return distance, normal, _between(first, second, normal, distance)


def _edges(shape: Polyhedron) -> Array:
    """Return the directions of edges, shape (k, 3), parallel ones once."""
    if not isinstance(shape, Hull):
        return np.eye(3)
    corner = shape.vertices[shape.triangles]
    directions = (corner - np.roll(corner, 1, axis=1)).reshape(-1, 3)
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    # opposite directions are parallel: make the first entry that is not zero positive
    first = directions[np.arange(len(directions)), (np.abs(directions) > _PARALLEL).argmax(axis=1)]
    return np.unique(np.round(directions * np.sign(first)[:, None], 12), axis=0)


def _outermost(points: Array, direction: Array) -> Array:
    """Return the points farthest along a direction: a corner, the ends of an edge, or the corners of a face."""
    far = points @ direction
    return points[far >= far.max() - _EQUALLY_FAR * np.ptp(points, axis=0).max()]


def _between(first: Array, second: Array, normal: Array, distance: float) -> Array:
    """Return the point midway between two outermost features, each a corner, an edge, or a face."""
    if len(second) == 1 or len(first) > 2:
        return second.mean(axis=0) - 0.5 * distance * normal
    if len(first) == 1 or len(second) > 2:
        return first.mean(axis=0) + 0.5 * distance * normal
    # two edges: where they cross, seen along the normal
    one, other = first[1] - first[0], second[0] - second[1]
    share = np.linalg.lstsq(np.stack([one, other], axis=1), second[0] - first[0], rcond=None)[0][0]
    return first[0] + np.clip(share, 0.0, 1.0) * one + 0.5 * distance * normal

"""Penetration depth of two polyhedra by the separating axis test over all faces and pairs of edges: slow and exact."""

from __future__ import annotations

import numpy as np

from mbvi.arguments import Array
from mbvi.geometry.shapes.polyhedra import Hull, Polyhedron

# edges with a smaller sine of their angle are parallel: their cross product is no axis
_PARALLEL = 1e-9


def overlap(a: Polyhedron, place_a: Array, b: Polyhedron, place_b: Array) -> tuple[float, Array]:
    """Return signed distance and unit normal from first to second of two polyhedra that overlap.

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
    return float(apart[best]), axes[best]


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

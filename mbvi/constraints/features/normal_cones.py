"""Which vertex, edge or face of a polyhedron is nearest to a point, and where that changes."""

from __future__ import annotations

import numpy as np

from ..rows import Array

# how near faces pass by a vertex or an edge of theirs, relative to the smaller shape
_THROUGH = 1e-9
# sine of the angle between two faces above which they meet at an edge, and rounding of cosines
_MEET, _ROUNDING = 1e-6, 1e-9


def bounding_directions(part: Array, planes: Array, bound: float) -> tuple[Array, Array]:
    """Return the directions into the faces of an edge, or along the edges of a vertex, shape (m, 3), and those faces.

    A point above the edge or vertex is nearest to it if the way from it to the point has no part along any of these
    directions, and else to that face, or to that edge. The faces, shape (m, 4), are those of an edge; of a vertex none.

    Parameters
    ----------
    part : ndarray, shape (2, 3)
        The vertex and zero, or a point of the edge and its direction, in the frame of the body, as all directions here.
    planes : ndarray, shape (f, 4)
        Outward normals and offsets of all faces.
    bound : float
        Bounding radius of the smaller shape [m].
    """
    point, direction = part
    own = planes[np.abs(planes[:, :3] @ point - planes[:, 3]) <= _THROUGH * bound]
    if direction.any():
        own = own[np.abs(own[:, :3] @ direction) <= _MEET]
        across = np.cross(own[:, :3], direction)
        across *= -np.sign((across @ own[:, :3].T).sum(axis=1, keepdims=True))
        meets = (across @ own[:, :3].T).min(axis=1, initial=0.0) < -_MEET
        return across[meets], own[meets]
    first, second = np.triu_indices(len(own), 1)
    edges = np.cross(own[first, :3], own[second, :3])
    size = np.linalg.norm(edges, axis=1)
    edges = edges[size > _MEET] / size[size > _MEET, None]
    edges = np.concatenate([edges, -edges])
    return edges[(edges @ own[:, :3].T).max(axis=1, initial=-np.inf) <= _ROUNDING], own[:0]


def nearest_feature(part: Array, planes: Array, bound: float, point: Array) -> tuple[Array, Array | None]:
    """Return which of a vertex or an edge, its edges and its faces is nearest to a point outside of the polyhedron.

    Parameters
    ----------
    part, planes, bound
        See `bounding_directions`: where the search begins.
    point : ndarray, shape (3,)
        The point; nothing else of the polyhedron is nearer.

    Returns
    -------
    part : ndarray, shape (2, 3)
        The nearest vertex or edge; where a face is nearest, its edge.
    face : ndarray, shape (4,), or None
        The nearest face, if it is one.
    """
    for _ in range(2):
        directions, faces = bounding_directions(part, planes, bound)
        ahead = directions @ (point - part[0])
        if ahead.max(initial=0.0) <= 0.0:
            return part, None
        if part[1].any():
            return part, faces[ahead.argmax()]
        part = np.array([part[0], directions[ahead.argmax()]])
    return part, None

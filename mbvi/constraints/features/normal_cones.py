"""Which vertex, edge or face of a polyhedron is nearest to a point, and where that changes."""

from __future__ import annotations

import numpy as np

from ..rows import Array

# how near faces pass by a vertex or an edge of theirs, relative to the smaller shape
_THROUGH = 1e-9
# sine of the angle between two faces above which they meet at an edge, and rounding of cosines
_MEET, _ROUNDING = 1e-6, 1e-9


def bounding_directions(part: Array, planes: Array, bound: float) -> tuple[Array, Array]:
    """Return directions in which points nearest to a vertex or an edge do not lie from it, shape (m, 3).

    Of an edge these lead along its faces, across it, and of a vertex along its edges. A point that does lie in one of
    them is nearest to that face, or to that edge. With them the faces of an edge are returned, shape (m, 4).

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
    """Return the nearest vertex or edge to a point, as `part` is, or its face, shape (4,), that or what borders on it.

    The arguments are those of `bounding_directions`, and the point, shape (3,).
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

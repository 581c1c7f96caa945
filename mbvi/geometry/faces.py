"""Rays and directions against the faces of a convex polyhedron, normal . x <= offset."""

from __future__ import annotations

import numpy as np

from ..arguments import Array
from ..compiled import kernel

# least cosine of a line with the normal of a face through which it leaves: others are nearly parallel to it
FACING = 0.1


@kernel("void(f8[:,::1], f8[::1], f8[:,::1], f8[::1], f8[::1])")
def _leave(points: Array, direction: Array, normals: Array, offsets: Array, length: Array) -> None:
    """Write the distance from each point, shape (k, 3), to where a line along a direction leaves the polyhedron [m].

    Parameters
    ----------
    normals, offsets : ndarray, shapes (f, 3) and (f,)
        The faces.
    length : ndarray, shape (k,)
        Receives the result.
    """
    for i in range(len(points)):
        length[i] = np.inf
    for f in range(len(offsets)):
        x, y, z = normals[f, 0], normals[f, 1], normals[f, 2]
        slope = x * direction[0] + y * direction[1] + z * direction[2]
        if slope > FACING:
            for i in range(len(points)):
                room = offsets[f] - (x * points[i, 0] + y * points[i, 1] + z * points[i, 2])
                length[i] = min(length[i], room / slope)


@kernel("i8(f8[:,::1], f8[::1])")
def _most_facing(normals: Array, direction: Array) -> int:
    """Return the index of the normal, of those of shape (f, 3), that is nearest to a direction."""
    best, largest = 0, -np.inf
    for f in range(len(normals)):
        along = normals[f, 0] * direction[0] + normals[f, 1] * direction[1] + normals[f, 2] * direction[2]
        if along > largest:
            best, largest = f, along
    return best


def leave(points: Array, direction: Array, faces: tuple[Array, Array]) -> Array:
    """Return the distance from each point, shape (k, 3), to where a line leaves the polyhedron, shape (k,) [m]."""
    length = np.empty(len(points))
    _leave(np.ascontiguousarray(points), direction, *faces, length)
    return length


def most_facing(normals: Array, direction: Array) -> tuple[float, Array]:
    """Return the cosine and the normal, of those of shape (f, 3), that is nearest to a unit vector."""
    normal = normals[_most_facing(normals, direction)]
    return float(normal.dot(direction)), normal

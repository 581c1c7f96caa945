"""Plain numpy forms of the kernels in mbvi/geometry/faces.py."""

from __future__ import annotations

import numpy as np

from mbvi.arguments import Array
from mbvi.geometry.faces import FACING


def _leave_plain(points: Array, direction: Array, normals: Array, offsets: Array, way: Array) -> None:
    """Write how far from each point, shape (k, 3), a line along a direction leaves the faces' polyhedron [m]."""
    slope = normals @ direction
    met = slope > FACING
    way[:] = ((offsets[met] - points @ normals[met].T) / slope[met]).min(axis=1, initial=np.inf)


def _most_facing_plain(normals: Array, direction: Array) -> int:
    """Return the face whose normal, of those of shape (f, 3), is nearest to a direction."""
    return int(np.argmax(normals @ direction))

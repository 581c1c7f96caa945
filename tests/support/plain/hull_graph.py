"""Plain numpy forms of the kernels in mbvi/geometry/shapes/hull_graph.py."""

from __future__ import annotations

import numpy as np

from mbvi.arguments import Array


def outermost_plain(
    points: Array, begin: int, end: int, first: Array, neighbour: Array, x: float, y: float, z: float, start: int
) -> int:
    """Return the index of the point of one shape that is farthest along a direction."""
    return begin + int(np.argmax(points[begin:end, :3] @ np.array([x, y, z])))

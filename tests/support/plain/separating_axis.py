"""Plain numpy forms of the kernels in mbvi/geometry/separating_axis.py."""

from __future__ import annotations

import numpy as np

from mbvi.arguments import Array


def _reach_plain(place: Array, u: Array, sizes: Array, points: Array, begin: int, end: int) -> float:
    """Return how far a shape reaches from the world's origin along a unit vector [m]."""
    x = place[:3] @ u
    along = np.abs(x) @ sizes[:3] + sizes[3] + sizes[4] * np.hypot(x[0], x[1]) + np.linalg.norm(sizes[5:] * x)
    return float(place[3] @ u + along + (points[begin:end] @ x).max())


def _clear_plain(
    places: Array, frame: Array, fixed: Array, sizes: Array, points: Array, first_point: Array,
    sides: Array, axis: Array, due: Array, tolerance: float, budget: Array, asked: Array,
) -> int:  # fmt: skip
    """Clear the pairs that their axes keep apart: the bound becomes their budget."""
    count = 0
    for pair in due:
        a, b = sides[pair]
        where = [fixed[s] if frame[s] < 0 else _compose(places[frame[s]], fixed[s]) for s in (a, b)]
        n = axis[pair] if frame[a] < 0 else axis[pair] @ places[frame[a], :3]
        ends = [(first_point[s], first_point[s + 1]) for s in (a, b)]
        gap = -_reach_plain(where[1], -n, sizes[b], points, *ends[1])
        gap -= _reach_plain(where[0], n, sizes[a], points, *ends[0])
        if gap > tolerance:
            budget[pair] = gap
        else:
            asked[count] = pair
            count += 1
    return count


def _compose(outer: Array, inner: Array) -> Array:
    """Return where a shape is whose place is `inner` in a body at `outer`, both of shape (4, 3)."""
    place = inner @ outer[:3]
    place[3] += outer[3]
    return place


def _keep_plain(places: Array, frame: Array, sides: Array, axis: Array, pairs: Array, normals: Array) -> None:
    """Write normals, shape (k, 3), as the axes of some pairs; the other arguments as of `_clear_plain`."""
    for pair, normal in zip(pairs, normals, strict=True):
        body = frame[sides[pair, 0]]
        axis[pair] = normal if body < 0 else places[body, :3] @ normal

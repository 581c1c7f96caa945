"""Plain numpy forms of the kernels in mbvi/geometry/separating_axis.py."""

from __future__ import annotations

import numpy as np

from mbvi.arguments import Array


def reach_plain(
    place: Array, u: Array, sizes: Array, points: Array, begin: int, end: int, first: Array, neighbour: Array,
    start: Array, pair: int, side: int,
) -> float:  # fmt: skip
    """Return how far a shape reaches from the world's origin along a unit vector [m]."""
    x = place[:3] @ u
    along = np.abs(x) @ sizes[:3] + sizes[3] + sizes[4] * np.hypot(x[0], x[1]) + np.linalg.norm(sizes[5:] * x)
    start[pair, side] = begin + np.argmax(points[begin:end] @ x)
    return float(place[3] @ u + along + points[start[pair, side]] @ x)


def _clear_plain(
    places: Array, frame: Array, fixed: Array, sizes: Array, points: Array, first_point: Array, first: Array,
    neighbour: Array, sides: Array, start: Array, axis: Array, due: Array, tolerance: float, budget: Array,
    asked: Array,
) -> int:  # fmt: skip
    """Clear the pairs that their axes keep apart: the bound becomes their budget."""
    count = 0
    for pair in due:
        a, b = sides[pair]
        where = [fixed[s] if frame[s] < 0 else _compose(places[frame[s]], fixed[s]) for s in (a, b)]
        n = axis[pair] if frame[a] < 0 else axis[pair] @ places[frame[a], :3]
        gap = np.nan
        if not np.isnan(n).any():
            gap = 0.0
            for k, (s, u) in enumerate(((a, n), (b, -n))):
                ends = int(first_point[s]), int(first_point[s + 1])
                gap -= reach_plain(where[k], u, sizes[s], points, *ends, first, neighbour, start, int(pair), k)
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

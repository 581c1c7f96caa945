"""Plain numpy forms of the kernels in mbvi/geometry/broad/separating_axis.py."""

from __future__ import annotations

import numpy as np

from mbvi.arguments import Array
from mbvi.geometry.broad.separating_axis import Shapes


def reach_plain(place: Array, n: Array, shapes: Shapes, pair: int, side: int) -> float:
    """Return how far a shape of a pair reaches from the world's origin towards the other shape [m]."""
    s, u = shapes.sides[pair, side], n if side == 0 else -n
    begin, end, sizes = shapes.first_point[s], shapes.first_point[s + 1], shapes.sizes[s]
    x = place[:3] @ u
    along = np.abs(x) @ sizes[:3] + sizes[3] + sizes[4] * np.hypot(x[0], x[1]) + np.linalg.norm(sizes[5:] * x)
    shapes.start[pair, side] = best = begin + np.argmax(shapes.points[begin:end] @ x)
    return float(place[3] @ u + along + shapes.points[best] @ x)


def _clear_plain(
    places: Array, tables: tuple[Array, ...], axis: Array, due: Array, tolerance: float, budget: Array, asked: Array
) -> int:
    """Clear the pairs that their axes keep apart: the bound becomes their budget."""
    count, shapes = 0, Shapes(*tables)
    for pair in due:
        sides, frame = shapes.sides[pair], shapes.frame
        where = [shapes.fixed[s] if frame[s] < 0 else _compose(places[frame[s]], shapes.fixed[s]) for s in sides]
        n = axis[pair] if frame[sides[0]] < 0 else axis[pair] @ places[frame[sides[0]], :3]
        gap = np.nan
        if not np.isnan(n).any():
            gap = -sum(reach_plain(where[k], n, shapes, int(pair), k) for k in (0, 1))
        if gap > tolerance:
            budget[pair] = gap
        else:
            asked[count] = pair
            count += 1
    return count


def guess_axes_plain(
    places: Array, tables: tuple[Array, ...], axis: Array, candidates: Array, tolerance: float
) -> None:
    """Write the best axis of both frames, or between the centres, where it separates a pair that has none."""
    shapes = Shapes(*tables)
    for pair in candidates[np.isnan(axis[candidates]).any(axis=1)]:
        sides, frame = shapes.sides[pair], shapes.frame
        where = [shapes.fixed[s] if frame[s] < 0 else _compose(places[frame[s]], shapes.fixed[s]) for s in sides]
        inside = shapes.inside[sides, None, :3]
        first, second = (_compose(where[k], inside[k])[0] for k in (0, 1))
        between = (second - first) / np.linalg.norm(second - first)
        tried = [-u if u @ between < 0.0 else u for u in (*where[0][:3], *where[1][:3], between)]
        gaps = [-sum(reach_plain(where[k], n, shapes, int(pair), k) for k in (0, 1)) for n in tried]
        if max(gaps) > tolerance:
            n = tried[int(np.argmax(gaps))]
            axis[pair] = n if frame[sides[0]] < 0 else places[frame[sides[0]], :3] @ n


def _compose(outer: Array, inner: Array) -> Array:
    """Return where a shape is whose place is `inner` in a body at `outer`, both of shape (4, 3)."""
    place = inner @ outer[:3]
    place[-1] += outer[3]
    return place


def _keep_plain(places: Array, frame: Array, sides: Array, axis: Array, pairs: Array, normals: Array) -> None:
    """Write normals, shape (k, 3), as the axes of some pairs; the other arguments as of `_clear_plain`."""
    for pair, normal in zip(pairs, normals, strict=True):
        body = frame[sides[pair, 0]]
        axis[pair] = normal if body < 0 else places[body, :3] @ normal

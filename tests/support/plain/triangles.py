"""Plain numpy forms of the kernels in mbvi/geometry/triangles.py."""

from __future__ import annotations

import numpy as np

from mbvi.arguments import Array
from mbvi.geometry.triangles import nearest_on_triangles


def near_triangles_plain(
    centres: Array, radii: Array, corners: Array, low: Array, edge: float, shape: Array, start: Array, listed: Array,
    tolerance: float, sphere: Array, triangle: Array, feature: Array, foot: Array,
) -> int:  # fmt: skip
    """Write which spheres and triangles are within a tolerance; return how many there are, more than fit or not."""
    place = np.floor((centres - low) / edge).astype(np.int64)
    inside = np.flatnonzero(((place >= 0) & (place < shape)).all(axis=1))
    x, y, z = place[inside].T
    cell = (x * shape[1] + y) * shape[2] + z
    number = start[cell + 1] - start[cell]
    first = np.repeat(start[cell] - np.cumsum(number) + number, number)
    s, t = np.repeat(inside, number), listed[first + np.arange(int(number.sum()))]
    a, b, c = corners[t].transpose(1, 0, 2)
    feet, features = nearest_on_triangles(a, b, c, centres[s])
    away = centres[s] - feet
    near = np.flatnonzero(np.sqrt(np.vecdot(away, away)) - radii[s] <= tolerance)
    fit = near[: len(sphere)]
    count = len(fit)
    sphere[:count], triangle[:count], feature[:count], foot[:count] = s[fit], t[fit], features[fit], feet[fit]
    return len(near)

"""Plain numpy forms of the kernels in mbvi/geometry/narrow/collinear.py."""

from __future__ import annotations

import numpy as np

from mbvi.arguments import Array
from mbvi.geometry.narrow.collinear import _BESIDE


def first_of_lines_plain(points: Array, line: Array, kept: Array) -> int:
    """Write which points `unique_along` keeps into the first places of `kept`; return how many."""
    flat = points - (points @ line)[:, None] * line
    beside = np.abs(flat[:, None] - flat).max(axis=2)
    size = np.ptp(points, axis=0).max(initial=0.0)
    first = np.flatnonzero(~np.tril(beside <= _BESIDE * size, -1).any(axis=1))
    kept[: len(first)] = first
    return len(first)

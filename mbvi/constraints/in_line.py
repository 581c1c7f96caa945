"""Points that stand in line across the plane that all moves in: their rows are the same."""

from __future__ import annotations

import numpy as np

Array = np.ndarray

# how far points of one line lie apart beside it, in units of what they lie apart in all
_BESIDE = 1e-9


def one_of_each_line(points: Array, line: Array) -> Array:
    """Return the first of the points on each line along a direction, ascending.

    Parameters
    ----------
    points : ndarray, shape (k, 3)
        The points.
    line : ndarray, shape (3,)
        The unit direction.
    """
    flat = points - (points @ line)[:, None] * line
    beside = np.abs(flat[:, None] - flat).max(axis=2)
    size = np.ptp(points, axis=0).max(initial=0.0)
    known = np.tril(beside <= _BESIDE * size, -1).any(axis=1)
    return np.flatnonzero(~known)

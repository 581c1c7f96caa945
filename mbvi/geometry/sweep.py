"""Which of many bodies may pass through each other on a straight way of their configuration."""

from __future__ import annotations

import numpy as np

from ..arguments import Array


def may_pass(centres: Array, moved: Array, travel: Array, bound: Array, inner: Array) -> tuple[Array, Array]:
    """Return pairs i < j that may come to touch and travel further than both are thick, shapes (k,).

    Parameters
    ----------
    centres, moved : ndarray, shape (n, 3)
        Where the bodies are, and how far their centres get [m].
    travel : ndarray, shape (n,)
        The most that a point of each travels; beyond |moved| where it turns or its way bends [m].
    bound, inner : ndarray, shape (n,)
        Radii of balls about and in each [m].
    """
    # of two of which none travels as far as it is thick none passes the other
    swift = np.flatnonzero(travel > inner).tolist()
    if not swift:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    # within what balls the ways are that are not straight
    bent = np.sqrt(np.maximum(travel**2 - np.vecdot(moved, moved), 0.0))
    first, second = [], []
    for i in swift:
        apart, way = centres - centres[i], moved - moved[i]
        square = np.vecdot(way, way)
        share = np.clip(-np.vecdot(apart, way) / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
        nearest = np.linalg.norm(apart + share[:, None] * way, axis=1)
        far = np.sqrt(square) + bent + bent[i] > inner + inner[i]
        j = np.flatnonzero(far & (nearest < bound + bound[i] + bent + bent[i]))
        j = j[j != i]
        first.append(np.minimum(i, j))
        second.append(np.maximum(i, j))
    # where both are fast a pair is found twice
    pairs = np.unique(np.concatenate(first) * len(centres) + np.concatenate(second))
    return pairs // len(centres), pairs % len(centres)

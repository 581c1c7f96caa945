"""Pairs of many bodies that may pass through each other along a straight displacement."""

from __future__ import annotations

import numpy as np

from ..arguments import Array


def may_pass(centres: Array, moved: Array, travel: Array, bound: Array, inner: Array) -> tuple[Array, Array]:
    """Return the pairs i < j that may touch, and that travel further than their inner radii together, shapes (k,).

    Parameters
    ----------
    centres, moved : ndarray, shape (n, 3)
        Centres of the bodies, and the displacements of the centres [m].
    travel : ndarray, shape (n,)
        Upper bound of the travel of any point of each body [m]; more than |moved| if it turns or its path is curved.
    bound, inner : ndarray, shape (n,)
        Radii of spheres around and inside each body [m].
    """
    # two bodies that both travel less than their inner radii cannot pass through each other
    swift = np.flatnonzero(travel > inner).tolist()
    if not swift:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    # the most by which a curved path deviates from the straight one
    bent = np.sqrt(np.maximum(travel**2 - np.vecdot(moved, moved), 0.0))
    first, second = [], []
    for i in swift:
        apart, relative = centres - centres[i], moved - moved[i]
        square = np.vecdot(relative, relative)
        share = np.clip(-np.vecdot(apart, relative) / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
        nearest = np.linalg.norm(apart + share[:, None] * relative, axis=1)
        far = np.sqrt(square) + bent + bent[i] > inner + inner[i]
        j = np.flatnonzero(far & (nearest < bound + bound[i] + bent + bent[i]))
        j = j[j != i]
        first.append(np.minimum(i, j))
        second.append(np.maximum(i, j))
    # a pair of two fast bodies is found twice
    pairs = np.unique(np.concatenate(first) * len(centres) + np.concatenate(second))
    return pairs // len(centres), pairs % len(centres)

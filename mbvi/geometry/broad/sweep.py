"""Pairs of many bodies that may pass through each other along a straight displacement."""

from __future__ import annotations

import numpy as np

from ...arguments import Array
from .verlet_list import near_balls

# relative to the largest ball
_ROUNDING = 1e-9


def may_pass(centres: Array, moved: Array, travel: Array, bound: Array, inner: Array) -> tuple[Array, Array]:
    """Return the pairs i < j that may touch, and that travel further than their inner radii together, shapes (k,).

    They ascend in i, then in j.

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
    swift = travel > inner
    if not swift.any():
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    # the most by which a curved path deviates from the straight one
    square = np.vecdot(moved, moved)
    bent = np.sqrt(np.maximum(travel**2 - square, 0.0))
    # balls that hold the whole path of each body
    held = bound + bent + 0.5 * np.sqrt(square)
    i, j = np.divmod(near_balls(centres + 0.5 * moved, held, _ROUNDING * float(held.max())), len(centres))
    fast = swift[i] | swift[j]
    i, j = i[fast], j[fast]
    apart, relative = centres[j] - centres[i], moved[j] - moved[i]
    square = np.vecdot(relative, relative)
    share = np.clip(-np.vecdot(apart, relative) / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
    nearest = np.linalg.norm(apart + share[:, None] * relative, axis=1)
    passing = np.sqrt(square) + bent[i] + bent[j] > inner[i] + inner[j]
    passing &= nearest < bound[i] + bound[j] + bent[i] + bent[j]
    return i[passing], j[passing]

"""Plain numpy forms of the kernels in mbvi/geometry/verlet_list.py."""

from __future__ import annotations

import numpy as np

from mbvi.arguments import Array


def _near_balls_plain(centres: Array, radii: Array, level: Array, cell: Array, reach: float, pairs: Array) -> int:
    """Write the pairs of balls whose gap is at most `reach`; return how many there are, more than fit or not.

    Parameters
    ----------
    centres : ndarray, shape (n, 3)
        Centres [m].
    radii : ndarray, shape (n,)
        Radii [m].
    level : ndarray of int, shape (n,)
        The cells that each ball belongs to, larger balls to coarser ones.
    cell : ndarray, shape (l,)
        Edge of the cells of each level: twice the largest radius there, plus `reach`.
    reach : float
        Greatest gap [m].
    pairs : ndarray of int, shape (k,)
        Receives i n + j with i < j, in no order.
    """
    n = len(radii)
    apart = np.linalg.norm(centres[:, None] - centres, axis=2) - radii[:, None] - radii
    i, j = np.nonzero(np.triu(apart <= reach, 1))
    count = min(len(i), len(pairs))
    pairs[:count] = (i * n + j)[:count]
    return len(i)

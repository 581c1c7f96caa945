"""Plain numpy forms of the kernels in mbvi/geometry/broad/verlet_list.py."""

from __future__ import annotations

import numpy as np

from mbvi.arguments import Array


def _near_balls_plain(centres: Array, radii: Array, level: Array, cell: Array, reach: float, pairs: Array) -> int:
    """Write the pairs of balls whose gap is at most `reach`; return how many there are, more than fit or not."""
    n = len(radii)
    apart = np.linalg.norm(centres[:, None] - centres, axis=2) - radii[:, None] - radii
    i, j = np.nonzero(np.triu(apart <= reach, 1))
    count = min(len(i), len(pairs))
    pairs[:count] = (i * n + j)[:count]
    return len(i)


def farthest_moved_plain(old: Array, new: Array, old_turns: Array, new_turns: Array, arms: Array) -> float:
    """Return the largest distance that a point of any shape has moved, less a displacement that all share."""
    moved = new - old
    moved -= 0.5 * (moved.max(axis=0) + moved.min(axis=0))
    travel = np.linalg.norm(moved, axis=1)
    if len(new_turns):
        travel += np.sqrt(0.5 * ((new_turns - old_turns) ** 2).sum(axis=(1, 2))) * arms
    return float(travel.max())

"""Plain numpy forms of the kernels in mbvi/constraints/families/pairs.py."""

from __future__ import annotations

import numpy as np

from mbvi.arguments import Array


def filter_active_plain(pair: Array, gap: Array, tolerance: float, clearance: Array, active: Array) -> tuple[int, bool]:
    """Find the contacts within the tolerance; the clearance of each measured pair becomes its least gap."""
    inside = gap <= tolerance
    count = int(inside.sum())
    active[:count] = inside.nonzero()[0]
    clearance[pair] = np.inf
    np.minimum.at(clearance, pair, gap)
    return count, bool((clearance[pair] > tolerance).any())

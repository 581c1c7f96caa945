"""Plain numpy forms of the kernels in mbvi/constraints/cache.py."""

from __future__ import annotations

import numpy as np

from mbvi.arguments import Array


def consume_clearance_plain(moved: Array, envelope: Array, travel: Array, clearance: Array, tolerance: float) -> int:
    """Take a displacement from the clearances of families; return a mask of those that are used up."""
    travel += np.abs(moved)
    clearance -= envelope @ np.abs(moved)
    return sum(1 << k for k in range(len(clearance)) if not clearance[k] >= tolerance)

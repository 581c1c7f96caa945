"""Plain numpy forms of the kernels in mbvi/constraints/cache.py."""

from __future__ import annotations

import numpy as np

from mbvi.arguments import Array


def consume_clearance_plain(moved: Array, envelope: Array, travel: Array, clearance: Array) -> int:
    """Take a displacement from the clearances of families; return a mask of those that are used up."""
    travel += np.abs(moved)
    clearance -= envelope @ np.abs(moved)
    return sum(1 << k for k in range(len(clearance)) if not clearance[k] >= 0.0)


def list_candidates_plain(
    clearance: Array, reach: Array, travel: Array, tolerance: float, candidates: Array
) -> tuple[int, float]:
    """Take the travel from the clearances of pairs and list those that are used up."""
    clearance -= travel @ reach
    travel[:] = 0.0
    used_up = clearance <= tolerance
    candidates[: used_up.sum()] = used_up.nonzero()[0]
    return int(used_up.sum()), float(np.where(used_up, np.inf, clearance - tolerance).min(initial=np.inf))

"""Plain numpy forms of the kernels in mbvi/constraints/families/candidates.py."""

from __future__ import annotations

import numpy as np

from mbvi.arguments import Array


def list_candidates_plain(
    clearance: Array, reach: Array, travel: Array, tolerance: float, candidates: Array
) -> tuple[int, float]:
    """Take the travel from the clearances of pairs and list those that are used up."""
    clearance -= travel @ reach
    travel[:] = 0.0
    used_up = clearance <= tolerance
    candidates[: used_up.sum()] = used_up.nonzero()[0]
    return int(used_up.sum()), float(np.where(used_up, np.inf, clearance - tolerance).min(initial=np.inf))

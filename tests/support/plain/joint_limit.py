"""Plain numpy forms of the kernels in mbvi/constraints/families/joint_limit.py."""

from __future__ import annotations

import numpy as np

from mbvi.arguments import Array


def _limits_within_plain(
    where: Array, sign: Array, offset: Array, lever: Array, tolerance: float, index: Array, gap: Array
) -> tuple[float, bool]:
    """Look which of the gaps sign where + offset, all of shape (m,), are within the tolerance as lengths."""
    gaps = sign * where + offset
    reached = np.flatnonzero(lever * gaps <= tolerance)
    same = np.array_equal(index[1 : 1 + index[0]], reached)
    index[0], index[1 : 1 + len(reached)] = len(reached), reached
    if same:
        gap[:] = gaps[reached]
    return float((lever * gaps).min()), same

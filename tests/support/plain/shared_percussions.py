"""Plain form of the kernel in mbvi/projection/dense/shared_percussions.py, by scipy's nonnegative least squares."""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

from mbvi.arguments import Array

# the equations weigh so much more than the norm
_WEIGHT = 1e6


def least_norm_plain(B: Array, count: int, rank: int, b: Array, u: Array) -> bool:
    """Write the u >= 0 of least norm with B' u = b; see `least_norm`."""
    B, b = B[:count, :rank], b[:rank]
    found, _ = nnls(np.vstack([_WEIGHT * B.T, np.eye(count)]), np.append(_WEIGHT * b, np.zeros(count)))
    positive = found > 1e-9 * found.max()
    u[:count] = 0.0
    u[:count][positive] = np.linalg.lstsq(B[positive].T, b, rcond=1e-12)[0]
    return True

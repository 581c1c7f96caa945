"""Whether two runs are the same."""

import numpy as np
from scipy.optimize import nnls


def same_states(part, whole):
    """Whether one run is the beginning of another."""
    n, m = len(part.t), len(part.impacts)
    for name in ("t", "q", "v", "residual"):
        np.testing.assert_array_equal(getattr(part, name), getattr(whole, name)[:n])
    assert [(i.time, i.constraints) for i in part.impacts] == [(i.time, i.constraints) for i in whole.impacts[:m]]


def beside(point, others):
    """How far a point is from the convex hull of others in the plane."""
    # shares of the others that are not negative, and whose sum is one
    shares = nnls(np.vstack([others.T, np.full(len(others), 1e3)]), np.append(point, 1e3))[0]
    return float(np.linalg.norm(others.T @ shares - point))

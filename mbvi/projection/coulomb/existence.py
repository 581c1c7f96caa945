"""When Coulomb's law has a solution: the margin by which some velocity opens all contacts at once."""

from __future__ import annotations

import numpy as np

from ..metric import Array, Metric

# relative accuracy of a margin, and the least that is told from none
_ACCURACY, _LEAST = 1e-6, 1e-8
_MOST_VERTICES = 500


def existence_margin(metric: Metric, J: Array, friction: Array) -> float:
    """Return how fast a velocity of unit length in the metric opens all contacts at once, 0 if none does.

    The largest t with u_n >= mu |u_t| + t in scaled rows for some |w|_M <= 1. Where it is positive, Coulomb's law has a
    solution (V. Acary, F. Cadoux, C. Lemaréchal, J. Malick, A formulation of the linear discrete Coulomb friction
    problem via convex optimization, 2011). It equals the least |J' p| in the dual metric over p in K_mu with normal
    parts that sum to 1, which is found by adding the steepest edge of a cone again and again. What is returned is the
    rate at which a known velocity opens the contacts, so that the true margin is not less.
    """
    W = metric.whiten(J.T).T
    W = W / np.repeat(np.linalg.norm(W[::3], axis=1), 3)[:, None]
    # imported here for its weight: few runs need it
    from scipy.optimize import nnls

    vertices, least, margin = [W[0]], W[0], 0.0
    for _ in range(_MOST_VERTICES):
        rates = (W @ least).reshape(-1, 3)
        across = np.linalg.norm(rates[:, 1:], axis=1)
        value = rates[:, 0] - friction * across
        a, length = int(value.argmin()), float(np.linalg.norm(least))
        margin = max(margin, float(value[a]) / length) if length > _LEAST else 0.0
        if length <= _LEAST or margin >= (1.0 - _ACCURACY) * length:
            break
        edge = -friction[a] * rates[a, 1:] / across[a] if across[a] > 0.0 else np.zeros(2)
        vertices.append(W[3 * a] + edge @ W[3 * a + 1 : 3 * a + 3])
        # the nearest point of their hull to the origin, but for the sum of the weights
        weights = nnls(np.vstack([np.array(vertices).T, np.ones(len(vertices))]), np.append(0.0 * least, 1.0))[0]
        least = weights @ np.array(vertices) / weights.sum()
        vertices = [vertex for vertex, weight in zip(vertices, weights, strict=True) if weight > 0.0]
    return margin if margin > _LEAST else 0.0

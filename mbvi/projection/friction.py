"""Impacts with Coulomb friction: the law for dense rows, its residual, and the margin of existence."""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

from ..compiled import plain_array
from ..errors import ProjectionError
from .coulomb import solve_coulomb
from .coulomb_contact import coulomb_defect, sweep_contacts
from .metric import Array, Metric
from .scaled_qp import Projection

# contacts up to which the answer is one whatever their order; beyond, sweeps begin with the contacts as they come
MOST_CONTACTS = 32
# the residual that is aimed at
_AIM = 1e-12
_MOST_SWEEPS = 20_000
# margins of existence are computed to this accuracy
_MARGIN = 1e-9
_MOST_VERTICES = 500


def project_frictional(
    x: Array, metric: Metric, J: Array, lower: Array, friction: Array, residual: float = 1e-6
) -> Projection:
    """Return the velocity w that Coulomb's law gives, with M (w - x) = J' p.

    For each contact, K_mu ∋ p ⊥ (u_n - lower + mu |u_t|, u_t) ∈ K_mu* with u = J w (Moreau; De Saxcé).

    Parameters
    ----------
    x : ndarray, shape (nv,)
        Velocity under the forces alone.
    metric : Metric
        M.
    J : ndarray, shape (3 m, nv)
        Of each contact the normal and two tangents, all of unit length and orthogonal to each other in space.
    lower : ndarray, shape (3 m,)
        Of each contact the least normal rate, and the negative tangential velocities of what it touches [m/s].
    friction : ndarray, shape (m,)
        Coefficients of friction.
    residual : float
        The relative residual above which this raises.

    Returns
    -------
    Projection
        Percussions have shape (3 m,). The residual is the natural map of the law, in rows scaled to unit normal
        entries of J M^-1 J', relative to the largest scaled speed of x, or of `lower`.

    Raises
    ------
    ProjectionError
        If the residual is not reached; the message states the margin of existence.
    """
    m = len(friction)
    solved = metric.solve_rows(J)
    G = solved @ J.T
    normal = np.diagonal(G)[::3]
    rows = np.flatnonzero(normal > 0.0)
    if len(rows) < m:
        return _without_still_contacts(x, metric, J, lower, friction, residual, rows)
    scale = np.repeat(1.0 / np.sqrt(normal), 3)
    b = J @ x
    largest = float(np.abs(b * scale).max(initial=0.0))
    b -= lower
    G, b, p = plain_array(0.5 * (G + G.T) * scale[:, None] * scale), plain_array(b * scale), np.zeros(3 * m)
    mu = plain_array(friction)
    if m <= MOST_CONTACTS:
        solve_coulomb(G, b, mu, _AIM, p)
    else:
        sweep_contacts(G, b, mu, _MOST_SWEEPS, 1e-2 * residual, p)
    largest = max(largest, float(np.abs(b).max(initial=0.0)))
    percussion = p * scale
    w = x + percussion @ solved
    u = J @ w
    u -= lower
    found = coulomb_defect(u * scale, p, mu) / largest if largest > 0.0 else 0.0
    # written so that a NaN is refused too
    if not found <= residual:
        problem = {"x": x, "M": metric.dense(), "J": J, "lower": lower, "friction": friction}
        margin = existence_margin(metric, J, friction)
        raise ProjectionError(
            f"Coulomb's law for {m} contacts stopped at the relative residual {found:.1e}, above {residual:.1e}; "
            f"{_existence(margin)}; the problem is in `.problem`",
            problem,
            found,
        )
    return Projection(w, percussion, found)


def _existence(margin: float) -> str:
    if margin > _MARGIN:
        return f"a solution exists (margin {margin:.1e})"
    return "no velocity opens all contacts at once (margin 0), so that there may be no solution"


def _without_still_contacts(
    x: Array, metric: Metric, J: Array, lower: Array, friction: Array, residual: float, rows: Array
) -> Projection:
    """Return the same without the contacts whose normal moves no body; they bear no percussion."""
    if (np.delete(lower[::3], rows) > 0.0).any():
        raise ProjectionError("a contact whose normal row vanishes demands a positive rate: no velocity gives it", {})
    wide = (3 * rows[:, None] + np.arange(3)).ravel()
    part = project_frictional(x, metric, J[wide], lower[wide], friction[rows], residual)
    percussion = np.zeros(len(J))
    percussion[wide] = part.percussion
    return Projection(part.velocity, percussion, part.residual)


def existence_margin(metric: Metric, J: Array, friction: Array) -> float:
    """Return how fast a velocity of unit length in the metric opens all contacts at once, 0 if none does.

    The largest t with u_n >= mu |u_t| + t in scaled rows for some |w|_M <= 1. Where it is positive, Coulomb's law has a
    solution (V. Acary, F. Cadoux, C. Lemaréchal, J. Malick, A formulation of the linear discrete Coulomb friction
    problem via convex optimization, 2011). It equals the least |J' p| in the dual metric over p in K_mu with normal
    parts that sum to 1, which is found by adding the steepest edge of a cone again and again.
    """
    W = metric.whiten(J.T).T
    W = W / np.repeat(np.linalg.norm(W[::3], axis=1), 3)[:, None]
    vertices, least = [W[0]], W[0]
    for _ in range(_MOST_VERTICES):
        rates = (W @ least).reshape(-1, 3)
        across = np.linalg.norm(rates[:, 1:], axis=1)
        value = rates[:, 0] - friction * across
        a = int(value.argmin())
        if value[a] >= least @ least - _MARGIN:
            break
        edge = -friction[a] * rates[a, 1:] / across[a] if across[a] > 0.0 else np.zeros(2)
        vertices.append(W[3 * a] + edge @ W[3 * a + 1 : 3 * a + 3])
        # the nearest point of their hull to the origin: a heavy row makes the weights sum to 1
        weights = nnls(np.vstack([np.array(vertices).T, np.full(len(vertices), 1e4)]), np.append(0.0 * least, 1e4))[0]
        least = weights @ np.array(vertices) / weights.sum()
        vertices = [vertex for vertex, weight in zip(vertices, weights, strict=True) if weight > 0.0]
    length = float(np.linalg.norm(least))
    return length if length > np.sqrt(_MARGIN) else 0.0

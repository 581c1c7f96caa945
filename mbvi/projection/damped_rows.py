"""Implicit damping along any rows, on the velocities that keep the equalities of a mechanism."""

from __future__ import annotations

import numpy as np

from .metric import Array, triangular
from .tree import TreeMetric
from .tree_factor import DEPENDENT


def moving_rows(metric: TreeMetric, rows: Array) -> Array:
    """Return which rows, shape (k, nv), do not depend on the equalities, shape (k,) of bool."""
    whole = np.linalg.norm(triangular(metric.lower[: rows.shape[1]].T, rows.T, 0), axis=0)
    moving: Array = np.linalg.norm(metric.whiten(rows.T), axis=0) > DEPENDENT * whole
    return moving


def damped_velocity(metric: TreeMetric, columns: Array, v: Array, h: float, force: Array, twice: bool) -> Array:
    """Return the velocity after a time h under a force and damping D, shape (nv,); see `advance_by`.

    Parameters
    ----------
    metric : TreeMetric
        M on the velocities that keep the equalities.
    columns : ndarray, shape (nv, r)
        C of D = C C'.
    v, force : ndarray, shape (nv,)
        The velocity, and the force without damping.
    h : float
        Time step [s].
    twice : bool
        Whether D acts at order 2 instead of 1.

    Notes
    -----
    The rule is that of joints, E_h(v) = v + (M + h D)^-1 h (F - D v) and 2 E^3(v) - E^4(v) with E = E_{h/2}; here each
    E keeps the equalities, and starts from the part of v that does. In coordinates where M is the identity D is G G'.
    """
    time = 0.5 * h if twice else h
    tangent, whitened, G = metric.tangent(v), metric.whiten(force), metric.whiten(columns)
    small = np.eye(G.shape[1]) + time * (G.T @ G)

    def damped(y: Array) -> Array:
        """Return (I + time D)^-1 y."""
        return np.asarray(y - time * (G @ np.linalg.solve(small, G.T @ y)))

    change = damped(time * (whitened - G @ (columns.T @ tangent)))
    if not twice:
        return np.asarray(tangent + metric.unwhiten(change))
    total = np.zeros(len(v))
    for sign in (1.0, 1.0, 1.0, -1.0):
        total += sign * change
        change = change - damped(time * (G @ (G.T @ change)))
    # of the part of v that breaks the equalities the mean over the step is zero
    return np.asarray(2.0 * tangent - v + metric.unwhiten(total))

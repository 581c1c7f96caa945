"""Angles between constraints in the kinetic metric: condition (12), assumption (H4), islands."""

from __future__ import annotations

import numpy as np
from scipy.linalg import lapack
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from ..projection.metric import Array, Metric

# cosines below this are rounding errors and count as zero
_ROUNDING = 1e-12


def unit_gradients(metric: Metric, J: Array) -> tuple[Array, Array]:
    """Return the gradients in the coordinates where M is the identity, scaled to unit length.

    Parameters
    ----------
    metric : Metric
        M.
    J : ndarray, shape (m, nv)
        Gradients, one a row.

    Returns
    -------
    columns : ndarray, shape (nv, m)
        L^-1 J' / lengths with M = L L'; zero where the gradient vanishes.
    lengths : ndarray, shape (m,)
        Roots of the diagonal of the Delassus matrix J M^-1 J'.
    """
    columns = metric.whiten(J.T)
    lengths = np.sqrt(np.einsum("ij,ij->j", columns, columns))
    return columns / np.where(lengths > 0.0, lengths, 1.0), lengths


def cosines_between(columns: Array) -> Array:
    """Return the Delassus matrix of `unit_gradients`, shape (m, m): the cosines of the kinetic angles."""
    sparse = csr_array(columns.T)
    # a row of free bodies has a few nonzero numbers among thousands
    G = (sparse @ sparse.T).toarray() if 4 * sparse.nnz < columns.size else columns.T @ columns
    G[np.abs(G) < _ROUNDING] = 0.0
    return np.clip(G, -1.0, 1.0)


def condition_12_violation(cosines: Array, e: Array, tolerance: float) -> Array:
    """Return how far each pair of active constraints is from condition (12), shape (m, m).

    Two constraints with e = 0 may stand at right or obtuse angles between their gradients, others at right ones only.

    Parameters
    ----------
    cosines : ndarray, shape (m, m)
        Of the kinetic angles between the gradients.
    e : ndarray, shape (m,)
        Restitution of each.
    tolerance : float
        Cosines up to this count as zero.
    """
    excess = np.where((e[:, None] == 0.0) & (e == 0.0), np.maximum(cosines, 0.0), np.abs(cosines))
    np.fill_diagonal(excess, 0.0)
    excess[excess <= tolerance] = 0.0
    return excess


def independent(columns: Array, cosines: Array, tolerance: float) -> bool:
    """Return whether unit gradients are linearly independent, assumption (H4).

    They are if the distance of each from the span of those before it is above `tolerance`.
    """
    nv, m = columns.shape
    if m > nv or not cosines.diagonal().all():
        return False
    factor, info = lapack.dpotrf(cosines)
    return not info and bool((factor.diagonal() > tolerance).all())


def islands(cosines: Array) -> list[Array]:
    """Return the islands, each as the numbers of its rows: rows linked by cosines that are not zero."""
    count, label = connected_components(csr_array(cosines), directed=False)
    order = np.argsort(label, kind="stable")
    return np.split(order, np.cumsum(np.bincount(label, minlength=count))[:-1]) if count else []

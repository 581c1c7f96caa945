"""The scaled QP on a known active set: a system of linear equations, which may be singular."""

from __future__ import annotations

import numpy as np
from scipy.linalg import lapack

from .metric import Array
from .scaled_qp import Candidate, ScaledQP

# least pivot of the Cholesky factor of independent rows, and least singular value, relative to the largest, that counts
_WELL_CONDITIONED, _RANK = 1e-3, 1e-13
# from so many rows on, dependent ones are solved without an SVD
_MANY = 32
_SHIFT = 1e-9


def solve_active(qp: ScaledQP, active: Array, base: Array | None = None) -> Candidate | None:
    """Solve A_S' z = d_S, z = A_S u_S on the set S.

    Parameters
    ----------
    qp : ScaledQP
        The problem.
    active : ndarray of bool, shape (m,)
        S.
    base : ndarray, shape (m,), optional
        Where u is not unique on S, the one nearest to this is returned; the least one by default.

    Returns
    -------
    Candidate or None
        Its u is zero off S and of any sign on S; None if the equations on S contradict each other.
    """
    u, index = np.zeros(len(qp.d)), np.flatnonzero(active)
    if not index.size:
        return Candidate(np.zeros(len(qp.x)), u)
    all_rows = index.size == len(qp.d)
    right, G = (qp.d, qp.G) if all_rows else (qp.d[index], qp.G[np.ix_(index, index)])
    factor, solution, info = lapack.dposv(G, right)
    if info == 0 and factor.diagonal().min() > _WELL_CONDITIONED:
        u[index] = solution
        return Candidate(qp.combine(u), u)
    start = np.zeros(index.size) if base is None else base[index]
    if index.size > _MANY:
        u[index] = _proximal(G, right, start)
        return Candidate(qp.combine(u), u)
    columns = qp.columns if all_rows else qp.columns[:, index]
    U, s, Vt = np.linalg.svd(columns, full_matrices=False)
    rank = int((s > _RANK * s[0]).sum())
    U, s, Vt = U[:, :rank], s[:rank], Vt[:rank]
    w = (Vt @ right) / s
    z = U @ w
    if np.abs(columns.T @ z - right).max() > 1e-12 * (1.0 + np.abs(w).max()):
        return None
    u[index] = start + Vt.T @ ((w - U.T @ (columns @ start)) / s)
    return Candidate(z, u)


def _proximal(G: Array, right: Array, base: Array) -> Array:
    """Return u near `base` with G u = right, G singular or nearly so: proximal steps on one Cholesky factor."""
    factor = lapack.dpotrf(G + _SHIFT * np.eye(len(G)), 0, 0)[0]
    u = base
    for _ in range(4):
        u = u + lapack.dpotrs(factor, right - G @ u)[0]
    return u

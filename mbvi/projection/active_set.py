"""The least-norm problem min |z|^2, A' z >= d on a given active set: solved, judged, and the set corrected.

A has unit columns, shape (nv, m); d is scaled so that its largest entry is 1; z = A p with p >= 0.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack

from .metric import Array

_WELL_CONDITIONED = 1e-3
_RANK = 1e-13
# from so many rows on, dependent ones are solved without an SVD
_MANY = 32
_SHIFT = 1e-9


class Candidate(NamedTuple):
    """A would-be solution: z, shape (nv,), is kept beside p, shape (m,), for A p loses digits where p is large."""

    z: Array
    p: Array


def kkt_residual(A: Array, d: Array, candidate: Candidate) -> float:
    """Return the larger of max |min(p, A' z - d)| and max |z - A p|, the latter relative to the terms it sums.

    Zero exactly at a solution.
    """
    z, p = candidate
    natural = np.abs(np.minimum(p, A.T @ z - d)).max()
    stationarity = np.abs(z - A @ p).max() / (1.0 + p.max())
    return float(max(natural, stationarity))


def solve_on(A: Array, G: Array, d: Array, active: Array, start: Array | None = None) -> Candidate | None:
    """Solve A_S' z = d_S, z = A_S p_S on the set S.

    Parameters
    ----------
    A : ndarray, shape (nv, m)
        Unit columns.
    G : ndarray, shape (m, m)
        A' A.
    d : ndarray, shape (m,)
        Right-hand side.
    active : ndarray of bool, shape (m,)
        S.
    start : ndarray, shape (m,), optional
        Where p is not unique on S, the one nearest to this is returned; the least one by default.

    Returns
    -------
    Candidate or None
        Its p is zero off S and cut off at zero; None if the equations on S contradict each other.
    """
    p = np.zeros(len(d))
    index = np.flatnonzero(active)
    if not index.size:
        return Candidate(np.zeros(len(A)), p)
    full = index.size == len(d)
    right = d if full else d[index]
    factor, solution, info = lapack.dposv(G if full else G[np.ix_(index, index)], right)
    if info == 0 and factor.diagonal().min() > _WELL_CONDITIONED:
        p[index] = np.maximum(solution, 0.0)
        return Candidate(A @ p, p)
    columns = A if full else A[:, index]
    base = np.zeros(index.size) if start is None else start[index]
    if index.size > _MANY:
        p[index] = np.maximum(_refined(G if full else G[np.ix_(index, index)], right, base), 0.0)
        return Candidate(A @ p, p)
    U, s, Vt = np.linalg.svd(columns, full_matrices=False)
    rank = int((s > _RANK * s[0]).sum())
    U, s, Vt = U[:, :rank], s[:rank], Vt[:rank]
    w = (Vt @ right) / s
    z = U @ w
    if np.abs(columns.T @ z - right).max() > 1e-12 * (1.0 + np.abs(w).max()):
        return None
    p[index] = np.maximum(base + Vt.T @ ((w - U.T @ (columns @ base)) / s), 0.0)
    return Candidate(z, p)


def _refined(G: Array, right: Array, base: Array) -> Array:
    """Return p near `base` with G p = right, G singular or nearly so: proximal steps on one Cholesky factor."""
    factor = lapack.dpotrf(G + _SHIFT * np.eye(len(G)), 0, 0)[0]
    p = base
    for _ in range(4):
        p = p + lapack.dpotrs(factor, right - G @ p)[0]
    return p


def press_what_is_missing(G: Array, missing: Array, lengths: Array) -> Array | None:
    """Return the percussions, of any sign, that bring just the violated rows to their bounds, if these are independent.

    Of many rows, too, it is mostly those that the forces violate that press. The residual is the judge.

    Parameters
    ----------
    G : ndarray, shape (m, m)
        Delassus matrix.
    missing : ndarray, shape (m,)
        Missing rates.
    lengths : ndarray, shape (m,)
        Roots of the diagonal of G.
    """
    if (missing > 0.0).all():
        factor, p, info = lapack.dposv(G, missing)
        pivots = factor.diagonal() / lengths
    else:
        index = (missing > 0.0).nonzero()[0]
        factor, part, info = lapack.dposv(G[index[:, None], index], missing[index])
        pivots = factor.diagonal() / lengths[index]
        p = np.zeros(len(missing))
        p[index] = part
    # of dependent rows some would get all: their share is settled elsewhere
    return None if info or pivots.min() < _WELL_CONDITIONED else p


def dual_active_set(A: Array, d: Array, rounding: float) -> Candidate | None:
    """Solve min |z|^2, A' z >= d by the dual active-set method, on QR factors made anew at each exchange.

    The active columns stay independent and |z| grows with every exchange, so that it ends, thin and nearly
    contradictory cones included; it is slower than ProxQP and is asked only where that stops short.

    Parameters
    ----------
    A : ndarray, shape (nv, m)
        Unit columns.
    d : ndarray, shape (m,)
        Right-hand side.
    rounding : float
        The violation, relative to 1 + |z|, that counts as none.

    Returns
    -------
    Candidate or None
        None if the constraints contradict each other.

    Notes
    -----
    D. Goldfarb and A. Idnani, Mathematical Programming 27 (1983), 1-33.
    """
    active: list[int] = []
    u = np.zeros(0)
    z = np.zeros(len(A))
    for _ in range(10 * len(d) + 50):
        violation = d - A.T @ z
        violation[active] = -np.inf
        entering = int(np.argmax(violation))
        if violation[entering] <= rounding * (1.0 + np.sqrt(z @ z)):
            break
        column, gained = A[:, entering], 0.0
        while True:
            Q, R = np.linalg.qr(A[:, active])
            along = Q.T @ column
            across = column - Q @ along
            correction = Q.T @ across
            across -= Q @ correction
            r = np.linalg.solve(R, along + correction) if active else u
            independent = np.sqrt(across @ across) > _RANK
            full = (d[entering] - column @ z) / (across @ across) if independent else np.inf
            ratios = np.where(r > 0.0, u / np.where(r > 0.0, r, 1.0), np.inf)
            step = min(full, ratios.min(initial=np.inf))
            if not np.isfinite(step):
                return None
            gained += step
            u = u - step * r
            if independent:
                z = z + step * across
            if step == full:
                break
            leaving = int(np.argmin(ratios))
            u = np.delete(u, leaving)
            del active[leaving]
        active.append(entering)
        Q, R = np.linalg.qr(A[:, active])
        y = np.linalg.solve(R.T, d[active])
        z, u = Q @ y, np.maximum(np.linalg.solve(R, y), 0.0)
    p = np.zeros(len(d))
    p[active] = u
    return Candidate(z, p)

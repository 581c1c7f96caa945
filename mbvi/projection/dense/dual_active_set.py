"""Dual active-set solver: adds violated rows one by one, on orthonormal factors of the active gradients."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...compiled import plain_array
from ..metric import Array
from .goldfarb_idnani import LAST_DIGITS, goldfarb_idnani
from .scaled_qp import ROUNDING, Candidate, ScaledQP, WarmStart
from .shared_percussions import share

# most rows that each exchange looks at, at first, and how often violated rows join them
_WORKING, _MOST_ENLARGED = 400, 40
# most rows of a failed problem that are searched for contradictions
_MOST_CHECKED = 400


@dataclass(frozen=True)
class DualActiveSet:
    """Dual active set: start from z = 0, add the most violated row, drop rows whose percussion would turn negative.

    Every iterate solves the problem of its active rows alone. |z| grows with every added row, so that no set comes
    back and the method ends, on thin and nearly contradictory cones too. The active gradients stay independent and are
    kept as orthonormal factors, not as G = A' A, whose condition is the square of theirs. That makes it the most
    accurate solver for rows that nearly depend on each other.

    Notes
    -----
    D. Goldfarb and A. Idnani, Mathematical Programming 27 (1983), 1-33.
    """

    def solve(self, qp: ScaledQP, start: WarmStart | None) -> Candidate | None:
        """Return the solution, or None if the rows contradict each other; see `Solver`."""
        found = dual_active_set(qp.columns, qp.d)
        # rows may contradict each other by less than the residual that is allowed
        return dual_active_set(qp.columns, qp.d, 0.1 * qp.relative_tolerance) if found is None else found


def dual_active_set(A: Array, d: Array, rounding: float = ROUNDING) -> Candidate | None:
    """Solve min |z|^2, A' z >= d.

    Parameters
    ----------
    A : ndarray, shape (nv, m)
        Unit columns.
    d : ndarray, shape (m,)
        Right-hand side, its largest entry about 1.
    rounding : float
        How far a row that counts as satisfied may be violated.

    Returns
    -------
    Candidate or None
        None if the constraints contradict each other.
    """
    m = A.shape[1]
    if m <= _WORKING:
        return _solved(A, d, rounding)
    # each exchange looks at all rows: of many, those that the answer does not violate are left out
    rows, enlarged = np.sort(np.argsort(-d)[:_WORKING]), 0
    while (found := _solved(A[:, rows], d[rows], rounding)) is not None:
        slack = A.T @ found.z - d
        slack[rows] = 0.0
        violated = np.flatnonzero(slack < -rounding - LAST_DIGITS * np.linalg.norm(found.z))
        if not violated.size or enlarged == _MOST_ENLARGED:
            u = np.zeros(m)
            u[rows] = found.u
            stopped = f"after {enlarged} enlargements of the working set" if violated.size else ""
            return Candidate(found.z, u, stopped=stopped)
        joining = violated[np.argsort(slack[violated])[: _WORKING // 2]]
        rows, enlarged = np.sort(np.concatenate([rows, joining])), enlarged + 1
    return None


def _solved(A: Array, d: Array, rounding: float) -> Candidate | None:
    """Return what `dual_active_set` does, looking at all rows in each exchange."""
    nv, m = A.shape
    most = min(nv, m) + 1
    S, u, z, slack = np.empty(most, np.int64), np.empty(most), np.empty(nv), np.empty(m)
    L, Q, W = np.empty((most, most)), np.empty((most, nv)), plain_array(A.T)
    size, _ = goldfarb_idnani(W, plain_array(d), rounding, 0, S, L, Q, u, z, slack)
    if size < 0:
        return None
    percussion, shared = np.zeros(m), np.empty(m)
    percussion[S[:size]] = u[:size]
    # rows that depend on each other share percussions where that leads to the same velocity
    if share(W, slack, rounding, S, size, L, Q, z, shared[:0], shared):
        off = [np.abs(A @ u - z).max(initial=0.0) for u in (percussion, shared)]
        if off[1] <= off[0] + ROUNDING:
            percussion = shared
    return Candidate(z, percussion)


def contradictory(qp: ScaledQP, found: Candidate | None) -> bool:
    """Return whether it is certain that no velocity meets the rows.

    It is certain (Farkas' lemma) if some u >= 0 has J' u = 0 and lower . u > 0. The percussions found are tried as u;
    then the dual active-set method searches for contradicting rows.
    """
    if found is not None and found.u.any():
        size = np.abs(qp.combine(found.u)).max(initial=0.0)
        terms = (abs(qp.rows).T @ found.u).max(initial=0.0)
        lower = qp.lower / qp.lengths
        if size <= 1e-6 * terms and lower @ found.u > 1e-6 * np.abs(lower) @ found.u:
            return True
    return len(qp.d) <= _MOST_CHECKED and dual_active_set(qp.columns, qp.d) is None

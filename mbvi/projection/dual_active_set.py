"""Dual active-set solver: adds violated rows one by one, on QR factors of the active gradients."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .metric import Array
from .scaled_qp import ROUNDING, Candidate, ScaledQP, WarmStart

# a gradient nearer than this to the span of the active ones depends on them
_DEPENDENT = 1e-13


@dataclass(frozen=True)
class DualActiveSet:
    """Dual active set: start from z = 0, add the most violated row, drop rows whose percussion would turn negative.

    Every iterate solves the problem of its active rows alone. |z| grows with every added row, so that no set comes
    back and the method ends, on thin and nearly contradictory cones too. The active gradients stay independent and are
    kept as QR factors, not as G = A' A, whose condition is the square of theirs. That makes it the most accurate
    solver for rows that nearly depend on each other, and a slow one.

    Notes
    -----
    D. Goldfarb and A. Idnani, Mathematical Programming 27 (1983), 1-33.
    """

    def solve(self, qp: ScaledQP, start: WarmStart | None) -> Candidate | None:
        """Return the solution, or None if the rows contradict each other; see `Solver`."""
        return goldfarb_idnani(qp.columns, qp.d, ROUNDING)


def goldfarb_idnani(A: Array, d: Array, rounding: float) -> Candidate | None:
    """Solve min |z|^2, A' z >= d.

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
    """
    active: list[int] = []
    u: Array = np.zeros(0)
    z = np.zeros(len(A))
    for _ in range(10 * len(d) + 50):
        violation = d - A.T @ z
        violation[active] = -np.inf
        entering = int(np.argmax(violation))
        if violation[entering] <= rounding * (1.0 + np.sqrt(z @ z)):
            break
        column = A[:, entering]
        while True:
            across, r = _split(A[:, active], column)
            independent = np.sqrt(across @ across) > _DEPENDENT
            full = (d[entering] - column @ z) / (across @ across) if independent else np.inf
            ratios = np.where(r > 0.0, u / np.where(r > 0.0, r, 1.0), np.inf)
            step = min(full, ratios.min(initial=np.inf))
            if not np.isfinite(step):
                return None
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


def _split(active: Array, column: Array) -> tuple[Array, Array]:
    """Return the part of a column across the span of active columns, and the shares of these in the rest.

    Parameters
    ----------
    active : ndarray, shape (nv, k)
        Independent columns.
    column : ndarray, shape (nv,)
        The column that is split.
    """
    Q, R = np.linalg.qr(active)
    along = Q.T @ column
    across = column - Q @ along
    # once more, for the rounding of the first
    correction = Q.T @ across
    across -= Q @ correction
    return across, np.linalg.solve(R, along + correction) if R.size else np.zeros(0)

"""Active-set solver: guesses which rows are active, solves the equations of these, and corrects the guess."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.linalg import lapack

from .equalities import solve_active
from .metric import Array
from .scaled_qp import ROUNDING, Candidate, ScaledQP, WarmStart

# a guess is right if no u and no slack is below minus this, relative to the largest u
_SIGN_TOLERANCE = 1e-12
# added to the diagonal of a singular G, and the most proximal steps, which remove its effect
_SHIFT, _PROXIMAL_STEPS = 1e-8, 6
# changes of the set at most: for each row and beyond, and fewer where each costs more multiplications; and at least
_CHANGES, _WORK, _FEWEST_CHANGES = (20, 100), 5e9, 20
# exchanges of all wrong rows at once that may fail to lower their number
_PATIENCE = 10


def guesses(qp: ScaledQP, start: WarmStart | None) -> Iterator[Candidate]:
    """Yield the solutions of the equations of the violated rows, and of the rows active in the last projection."""
    found = solve_active(qp, qp.d > 0.0)
    if found is not None:
        yield found
    if start is not None and start.u.any():
        found = solve_active(qp, start.u > 0.0, start.u)
        if found is not None:
            yield found


def fits(qp: ScaledQP, candidate: Candidate) -> bool:
    """Return whether no percussion is negative and no row violated, beyond rounding."""
    rounding = _SIGN_TOLERANCE * (1.0 + np.abs(candidate.u).max())
    return bool(candidate.u.min() >= -rounding and qp.slack(candidate.z).min() >= -rounding)


@dataclass(frozen=True)
class GuessedSet:
    """One guess at the active set, without correction.

    If S is the set of rows that are active at the solution, the solution is that of the equations A_S' z = d_S,
    z = A_S u_S. From one step to the next S rarely changes, and at impacts it mostly is the set of the violated rows.
    Both sets are tried. A guess is right if u_S >= 0 and A' z >= d.
    """

    def solve(self, qp: ScaledQP, start: WarmStart | None) -> Candidate | None:
        """Return the solution on the first right guess; see `Solver`."""
        for candidate in guesses(qp, start):
            if fits(qp, candidate):
                return Candidate(candidate.z, np.maximum(candidate.u, 0.0))
        return None


@dataclass(frozen=True)
class ActiveSet:
    """Primal-dual active set: solve the equations of a guessed active set, exchange the rows of wrong sign, repeat.

    A row is wrong if it is active with a negative percussion or inactive and violated. All wrong rows are exchanged at
    once. If that does not lower their number for some exchanges, only the last wrong row is exchanged; this rule ends
    for every positive definite G. Dependent rows make G singular. Therefore G + s I with a small s is used, and
    proximal steps, which add s times the last u to d, lead to the solution for G.

    Notes
    -----
    J. J. Judice and F. M. Pires, Computers & Operations Research 21 (1994), 587-596; the rule of one row at a time is
    K. G. Murty's, Opsearch 11 (1974), 59-68.
    """

    def solve(self, qp: ScaledQP, start: WarmStart | None) -> Candidate | None:
        """Return the solution on the set that pivoting ends with; see `Solver`."""
        guessed = GuessedSet().solve(qp, start)
        if guessed is not None:
            return guessed
        shifted = qp.G + _SHIFT * np.eye(len(qp.d))
        active, u, stopped = qp.d > 0.0, np.zeros(len(qp.d)), ""
        for _ in range(_PROXIMAL_STEPS):
            found = _pivoted(shifted, qp.d + _SHIFT * u, active)
            if found is None:
                return None
            before, (active, u, stopped) = u, found
            if stopped or np.abs(u - before).max() <= ROUNDING * (1.0 + u.max()):
                break
        return Candidate(qp.combine(u), u, True, stopped)


def _pivoted(G: Array, d: Array, active: Array) -> tuple[Array, Array, str] | None:
    """Return the active set and solution of min u' G u / 2 - d' u, u >= 0, by principal pivoting from a first set.

    The last word says at which bound it stopped; it is empty where no row is wrong.

    Parameters
    ----------
    G : ndarray, shape (m, m)
        Positive definite.
    d : ndarray, shape (m,)
        Right-hand side.
    active : ndarray of bool, shape (m,)
        The first set.
    """
    fewest, patience, u = len(d) + 1, _PATIENCE, np.zeros(len(d))
    most = min(_CHANGES[0] * len(d) + _CHANGES[1], max(int(_WORK / len(d) ** 3), _FEWEST_CHANGES))
    for _ in range(most):
        u, index = np.zeros(len(d)), np.flatnonzero(active)
        if index.size:
            _, u[index], info = lapack.dposv(G[np.ix_(index, index)], d[index])
            if info:
                return None
        rounding = ROUNDING * (1.0 + np.abs(u).max())
        wrong = np.where(active, u < -rounding, G @ u - d < -rounding)
        count = int(np.count_nonzero(wrong))
        if not count:
            return active, np.maximum(u, 0.0), ""
        if count < fewest:
            fewest, patience = count, _PATIENCE
        elif patience:
            patience -= 1
        else:
            wrong[: np.flatnonzero(wrong)[-1]] = False
        active = active ^ wrong
    return active, np.maximum(u, 0.0), f"after {most} changes of the active set"

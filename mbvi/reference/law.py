"""The impact law for at most ten constraints, by enumeration of active sets."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from ..errors import InputError

Array = np.ndarray

# largest number of rows whose subsets are enumerated
_MOST_ROWS = 10
# violations that count as rounding, and eigenvalues that count as dependence; relative to the problem's largest number
_ROUNDING, _DEPENDENT = 1e-11, 1e-12


def complementary(G: Array, c: Array) -> Array:
    """Return p >= 0 with G p + c >= 0 and p . (G p + c) = 0.

    Parameters
    ----------
    G : ndarray, shape (m, m)
        J M^-1 J', positive semidefinite.
    c : ndarray, shape (m,)
        In the range of G, or nonnegative where it is not.

    Returns
    -------
    ndarray, shape (m,)
        The solution with the fewest positive entries; G p is unique.

    Raises
    ------
    InputError
        If there are more than ten rows, or there is no solution.

    Notes
    -----
    Every subset S is tried: p_S = -G_SS^-1 c_S, zero else. An independent subset suffices (Carathéodory).
    """
    m = len(c)
    if m > _MOST_ROWS:
        raise InputError(f"{m} rows are too many to enumerate their subsets; mbvi.impact accepts any number")
    size = np.sqrt(np.diag(G)) if m else np.ones(0)
    if not (size > 0).all():
        raise InputError("a gradient is zero: such a constraint cannot be struck")
    unit, rate = G / np.outer(size, size), c / size
    scale = np.abs(rate).max(initial=0.0)
    for count in range(m + 1):
        for subset in combinations(range(m), count):
            S = list(subset)
            p = np.zeros(m)
            if S:
                if np.linalg.eigvalsh(unit[np.ix_(S, S)])[0] < _DEPENDENT:
                    continue
                p[S] = np.linalg.solve(unit[np.ix_(S, S)], -rate[S])
            after = unit @ p + rate
            after[S] = 0.0
            if min(p.min(initial=0.0), after.min(initial=0.0)) >= -_ROUNDING * scale:
                return np.maximum(p, 0.0) / size
    raise InputError("no velocity satisfies these constraints")


def law(M: Array, J: Array, v: Array, e: float) -> Array:
    """Return v+ = argmin { |w - v|_M : J w >= -e J v }, which is the law (8).

    Parameters
    ----------
    M : ndarray, shape (nv, nv)
        Mass matrix.
    J : ndarray, shape (m, nv)
        Gradients of the active constraints.
    v : ndarray, shape (nv,)
        Velocity before.
    e : float
        Restitution in [0, 1].

    Raises
    ------
    InputError
        As in `complementary`.
    """
    response = np.linalg.solve(M, J.T)
    return v + response @ complementary(J @ response, (1 + e) * (J @ v))

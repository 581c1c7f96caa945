"""Kernels of the fused step: one mechanism with a few rows, its active set guessed, solved, refined and checked.

An answer counts if its own KKT residual is at rounding; otherwise other solvers are tried.
"""

from __future__ import annotations

import numpy as np

from ..compiled import kernel
from .metric import Array
from .nonnegative import ROUNDING, dual_active_set, solve_equalities
from .tree import advance_by, factor, solve

# a sum J w below this share of its terms is rounding
_LAST_DIGITS = 4e-15
# slack, relative to the largest speed, under which a row without a percussion is tight
_TOUCHING = 1e-9
_REFINEMENTS = 2


@kernel("UniTuple(f8, 2)(f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1])")
def scaled_dual(
    J: Array, A: Array, x: Array, lower: Array, table: Array, G: Array, lengths: Array, d: Array
) -> tuple[float, float]:
    """Write the dual of a projection, min u' G u / 2 - d' u over u >= 0, with rows of unit length.

    Parameters
    ----------
    J, A, x, lower, table
        As of `solve_active_set`; J x is known.
    G, lengths, d : ndarray, shapes (m, m), (m,), (m,)
        Receive J A' of the scaled rows, their lengths in the metric, and their violations.

    Returns
    -------
    largest : float
        The largest scaled speed, the unit of residuals; -1 where a row has no length.
    most_terms : float
        The largest sum of the magnitudes of which a scaled violation is the sum.
    """
    m, n = J.shape
    largest = most_terms = 0.0
    for a in range(m):
        for b in range(a + 1):
            g = 0.0
            for k in range(n):
                g += J[a, k] * A[b, k]
            G[a, b] = g
        if not G[a, a] > 0.0:
            return -1.0, 0.0
        lengths[a] = np.sqrt(G[a, a])
        largest = max(largest, (abs(table[1, a]) + abs(lower[a])) / lengths[a])
        terms = abs(lower[a])
        for k in range(n):
            terms += abs(J[a, k] * x[k])
        most_terms = max(most_terms, terms / lengths[a])
        d[a] = (lower[a] - table[1, a]) / lengths[a]
    for a in range(m):
        for b in range(a + 1):
            G[a, b] /= lengths[a] * lengths[b]
            G[b, a] = G[a, b]
    return largest, most_terms


@kernel("f8(f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8[::1], f8[::1], f8, f8[::1], f8[::1], f8[:,::1])")
def natural_residual(
    J: Array, A: Array, x: Array, lower: Array, lengths: Array, u: Array, largest: float, slack: Array, w: Array,
    table: Array,
) -> float:  # fmt: skip
    """Write the velocity x + A' p that scaled percussions bring about; return max |min(u, slack)| / largest.

    Parameters
    ----------
    J, A, x, lower, w, table
        As of `solve_active_set`.
    lengths, largest
        As of `scaled_dual`.
    u, slack : ndarray, shape (m,)
        Scaled percussions; receives the scaled slacks J w - lower.
    """
    m, n = J.shape
    for k in range(n):
        w[k] = x[k]
    for a in range(m):
        table[0, a] = u[a] / lengths[a]
        if u[a] != 0.0:
            for k in range(n):
                w[k] += table[0, a] * A[a, k]
    residual = 0.0
    for a in range(m):
        speed = 0.0
        for k in range(n):
            speed += J[a, k] * w[k]
        table[2, a] = speed
        slack[a] = (speed - lower[a]) / lengths[a]
        off = abs(min(u[a], slack[a])) / largest
        # written so that a NaN stays
        if not off <= residual and residual == residual:
            residual = off
    return residual


@kernel("f8(f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[:,::1])")
def solve_active_set(J: Array, A: Array, x: Array, lower: Array, last: Array, w: Array, table: Array) -> float:
    """Write argmin |w - x|_M with J w >= lower, if the active set is found.

    Parameters
    ----------
    J, A : ndarray, shape (m, nv)
        Gradients, and M^-1 times each of them.
    x, w : ndarray, shape (nv,)
        The velocity to project and the result.
    lower : ndarray, shape (m,)
        Least rates.
    last : ndarray, shape (m,) or (0,)
        Percussions of the same rows in the last projection, if any.
    table : ndarray, shape (3, m)
        Receives percussions, J x and J w.

    Returns
    -------
    float
        The relative KKT residual of what was written, if it is at rounding; else inf, and that is no answer.
    """
    m, n = J.shape
    violated = False
    for a in range(m):
        speed, terms = 0.0, abs(lower[a])
        for k in range(n):
            term = J[a, k] * x[k]
            speed += term
            terms += abs(term)
        table[0, a], table[1, a], table[2, a] = 0.0, speed, speed
        violated = violated or not lower[a] - speed <= ROUNDING * terms
    for k in range(n):
        w[k] = x[k]
    if not violated:
        return 0.0
    G, lengths, d, base, u, slack = np.empty((m, m)), np.empty(m), np.empty(m), np.empty(m), np.empty(m), np.empty(m)
    correction, chosen = np.empty(m), np.empty(m, np.bool_)
    largest, most_terms = scaled_dual(J, A, x, lower, table, G, lengths, d)
    if largest < 0.0:
        return np.inf
    enough = max(ROUNDING, _LAST_DIGITS * most_terms / largest)
    for attempt in range(3):
        for a in range(m):
            chosen[a], base[a] = d[a] > 0.0, 0.0
        if attempt == 1:
            if len(last) != m:
                continue
            for a in range(m):
                chosen[a], base[a] = last[a] > 0.0, last[a] * lengths[a]
        if attempt == 2 and not dual_active_set(G, d, chosen):
            break
        if not solve_equalities(G, d, chosen, base, u):
            continue
        for _ in range(1 + _REFINEMENTS):
            residual = natural_residual(J, A, x, lower, lengths, u, largest, slack, w, table)
            if residual <= enough:
                alone = True
                for a in range(m):
                    # of tight rows without a percussion another solver chooses
                    alone = alone and (chosen[a] or attempt < 2 or slack[a] > _TOUCHING * largest)
                    table[0, a] = max(table[0, a], 0.0)
                return residual if alone else np.inf
            for a in range(m):
                base[a], slack[a] = 0.0, -slack[a]
            solve_equalities(G, slack, chosen, base, correction)
            for a in range(m):
                u[a] += correction[a]
    return np.inf


@kernel("void(f8[:,::1], f8[::1], f8[::1], f8[::1], f8[:,::1])")
def newton_law(J: Array, v: Array, e: Array, lower: Array, rates: Array) -> None:
    """Write the least rates after an impact, -e J v, and the rates before.

    Parameters
    ----------
    J, v : ndarray, shapes (m, nv), (nv,)
        Gradients, and the velocity before.
    e, lower : ndarray, shape (m,)
        Restitution of each row, and the least rates.
    rates : ndarray, shape (4, m)
        Receives J v in its last row.
    """
    m, n = J.shape
    for a in range(m):
        speed = 0.0
        for k in range(n):
            speed += J[a, k] * v[k]
        rates[3, a], lower[a] = speed, -e[a] * speed


@kernel(
    "f8(f8[:,::1], f8[::1], i8[::1], f8[::1], f8, f8[::1], f8[::1], f8[:,::1], f8[::1], f8[::1], f8[::1], f8[:,::1])"
)
def tree_law(
    mass: Array, damping: Array, parent: Array, v: Array, h: float, torque: Array, effects: Array, J: Array, e: Array,
    last: Array, w: Array, rates: Array,
) -> float:  # fmt: skip
    """Write argmin |w - x|_M with J w >= -e J v, where x is the free motion of one mechanism; see `TreeFreeMotion`.

    The first arguments are those of `advance_by`, `e` and `rates` those of `newton_law`, and the others, as the result,
    those of `solve_active_set`; the result is inf too where M is not positive definite.
    """
    L, x, A, lower = np.empty(mass.shape), np.empty(len(v)), np.empty(J.shape), np.empty(len(J))
    if advance_by(mass, damping, parent, v, h, torque, effects, L, x):
        return np.inf
    damped = False
    for d in damping:
        damped = damped or d != 0.0
    # L is that of M already where there is no damping
    if damped and factor(mass, 0.0, damping, parent, L):
        return np.inf
    solve(L, parent, J, A)
    newton_law(J, v, e, lower, rates)
    return solve_active_set(J, A, x, lower, last, w, rates)

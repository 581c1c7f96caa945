"""Kernels for the dual of a small projection, min u' G u / 2 - d' u over u >= 0: its active set, and the equations.

Rows are scaled to unit length in the metric: G = J M^-1 J' has a unit diagonal, u are the percussions and d
the violations in that scale.
"""

from __future__ import annotations

import numpy as np

from ..compiled import kernel
from .metric import Array

ROUNDING = 1e-13
# a pivot of the scaled G under the first belongs to a dependent row, over the second to an independent one
_DEPENDENT, _INDEPENDENT = 1e-13, 1e-8
# slack under which a row is tight, and how often negative percussions are cut off
_TIGHT, _MOST_SHARES = 1e-9, 100


@kernel("UniTuple(i8, 2)(f8[:,::1], f8[::1], b1[::1], f8[:,::1], f8[::1], i8[::1])")
def pivoted_cholesky(G: Array, d: Array, chosen: Array, C: Array, y: Array, order: Array) -> tuple[int, int]:
    """Factor G_SS = C C' on the chosen rows S, with as many columns as its rank, and solve C y = d_S.

    Parameters
    ----------
    G, d, chosen
        As of `solve_equalities`.
    C, y, order : ndarray, shapes (m, m), (m,), (m,)
        Receive the factor, the solution, and S in the order of the pivots.

    Returns
    -------
    size : int
        How many rows are chosen.
    rank : int
        How many of them are independent; -1 if that cannot be said.
    """
    m = len(d)
    rest = np.empty(m)
    size = rank = 0
    for a in range(m):
        for k in range(m):
            C[a, k] = 0.0
        if chosen[a]:
            order[size], rest[a] = a, G[a, a]
            size += 1
    for k in range(size):
        best = k
        for i in range(k + 1, size):
            if rest[order[i]] > rest[order[best]]:
                best = i
        order[k], order[best] = order[best], order[k]
        a = order[k]
        if not rest[a] > _DEPENDENT:
            break
        if rest[a] < _INDEPENDENT:
            return size, -1
        pivot = np.sqrt(rest[a])
        C[a, k] = pivot
        y[k] = d[a]
        for j in range(k):
            y[k] -= C[a, j] * y[j]
        y[k] /= pivot
        for i in range(k + 1, size):
            b = order[i]
            g = G[b, a]
            for j in range(k):
                g -= C[b, j] * C[a, j]
            C[b, k] = g / pivot
            rest[b] -= C[b, k] * C[b, k]
        rank += 1
    return size, rank


@kernel("void(f8[:,::1], i8[::1], i8, i8, f8[::1], f8[::1], f8[::1])")
def nearest_solution(C: Array, order: Array, size: int, rank: int, base: Array, y: Array, u: Array) -> None:
    """Write u = base + C (C'C)^-1 (y - C' base): of all u with C' u = y the nearest to the base.

    Parameters
    ----------
    C, order, size, rank
        As `pivoted_cholesky` leaves them.
    base, u : ndarray, shape (m,)
        Where to start from, and the result, written on the chosen rows.
    y : ndarray, shape (m,)
        Right-hand side; overwritten.
    """
    N = np.empty((rank, rank))
    for k in range(rank):
        for i in range(size):
            y[k] -= C[order[i], k] * base[order[i]]
        for j in range(k + 1):
            s = 0.0
            for i in range(size):
                s += C[order[i], k] * C[order[i], j]
            N[k, j] = s
    for k in range(rank):
        for j in range(k + 1):
            s = N[k, j]
            for i in range(j):
                s -= N[k, i] * N[j, i]
            N[k, j] = np.sqrt(s) if j == k else s / N[j, j]
        for j in range(k):
            y[k] -= N[k, j] * y[j]
        y[k] /= N[k, k]
    for k in range(rank - 1, -1, -1):
        for j in range(k + 1, rank):
            y[k] -= N[j, k] * y[j]
        y[k] /= N[k, k]
    for i in range(size):
        s = base[order[i]]
        for k in range(rank):
            s += C[order[i], k] * y[k]
        u[order[i]] = s


@kernel("b1(f8[:,::1], f8[::1], b1[::1], f8[::1], f8[::1])")
def solve_equalities(G: Array, d: Array, chosen: Array, base: Array, u: Array) -> bool:
    """Write the u nearest to `base` with (G u)_S = d_S on the chosen rows S and zero elsewhere; False if there is none.

    Parameters
    ----------
    G : ndarray, shape (m, m)
        Scaled Delassus matrix, singular where rows depend on each other.
    d, base, u : ndarray, shape (m,)
        Violations, where to start from, and the result.
    chosen : ndarray of bool, shape (m,)
        S.
    """
    m = len(d)
    C, y, order = np.empty((m, m)), np.empty(m), np.empty(m, np.int64)
    for a in range(m):
        u[a] = 0.0
    size, rank = pivoted_cholesky(G, d, chosen, C, y, order)
    if rank < 0:
        return False
    if rank < size:
        nearest_solution(C, order, size, rank, base, y, u)
        return True
    # independent rows: C' u = y
    for k in range(size - 1, -1, -1):
        s = y[k]
        for i in range(k + 1, size):
            s -= C[order[i], k] * u[order[i]]
        u[order[k]] = s / C[order[k], k]
    return True


@kernel("void(f8[:,::1], i8[::1], i8, i8, f8[:,::1], f8[::1])")
def solve_on_active(G: Array, S: Array, size: int, entering: int, F: Array, r: Array) -> None:
    """Write r = G_SS^-1 G_S,entering, where S are the first `size` rows of a list, by a Cholesky factor F of G_SS."""
    for i in range(size):
        s = G[S[i], entering]
        for j in range(i + 1):
            f = G[S[i], S[j]]
            for k in range(j):
                f -= F[i, k] * F[j, k]
            F[i, j] = np.sqrt(f) if i == j else f / F[j, j]
            if j < i:
                s -= F[i, j] * r[j]
        r[i] = s / F[i, i]
    for i in range(size - 1, -1, -1):
        for j in range(i + 1, size):
            r[i] -= F[j, i] * r[j]
        r[i] /= F[i, i]


@kernel("b1(f8[:,::1], f8[::1], b1[::1])")
def dual_active_set(G: Array, d: Array, chosen: Array) -> bool:
    """Find the active set by the dual active-set method; False if it was not found.

    Parameters
    ----------
    G : ndarray, shape (m, m)
        Scaled Delassus matrix.
    d : ndarray, shape (m,)
        Violations.
    chosen : ndarray of bool, shape (m,)
        Receives the rows; they are independent, and their u with (G u)_S = d_S is not negative.

    Notes
    -----
    min u' G u / 2 - d' u, u >= 0: D. Goldfarb and A. Idnani, Mathematical Programming 27 (1983), 1-33.
    """
    m = len(d)
    S, u, r, slack, F = np.empty(m, np.int64), np.empty(m), np.empty(m), np.empty(m), np.empty((m, m))
    scale, size = 0.0, 0
    for a in range(m):
        scale = max(scale, abs(d[a]))
        chosen[a], u[a] = False, 0.0
    for _ in range(10 * m):
        entering, largest = -1, scale
        for a in range(m):
            s = 0.0
            for b in range(m):
                s += G[a, b] * u[b]
            largest = max(largest, scale + abs(s))
            slack[a] = s - d[a]
            if not chosen[a] and (entering < 0 or slack[a] < slack[entering]):
                entering = a
        if entering < 0 or slack[entering] >= -ROUNDING * largest:
            return True
        violation = -slack[entering]
        while True:
            solve_on_active(G, S, size, entering, F, r)
            curvature = G[entering, entering]
            leaving, step = -1, np.inf
            for i in range(size):
                curvature -= G[entering, S[i]] * r[i]
                if r[i] > 0.0 and u[S[i]] < step * r[i]:
                    leaving, step = i, u[S[i]] / r[i]
            if curvature > _INDEPENDENT and violation <= step * curvature:
                leaving, step = -1, violation / curvature
            if not step < np.inf:
                return False
            for i in range(size):
                u[S[i]] -= step * r[i]
            u[entering] += step
            violation -= step * curvature
            if leaving < 0:
                break
            u[S[leaving]] = 0.0
            chosen[S[leaving]] = False
            size -= 1
            for i in range(leaving, size):
                S[i] = S[i + 1]
        S[size] = entering
        chosen[entering] = True
        size += 1
    return False


def nonnegative_least_squares(G: Array, d: Array) -> Array | None:
    """Return a solution u shared by all tight rows, as far as none of them gets a negative one; None if there is none.

    Where the least u on the tight rows is negative, the nearest to its positive part is taken, and again until none is.

    Parameters
    ----------
    G : ndarray, shape (m, m)
        Scaled Delassus matrix.
    d : ndarray, shape (m,)
        Violations, the largest of them 1.
    """
    chosen, u, base = np.empty(len(d), bool), np.empty(len(d)), np.zeros(len(d))
    if not (dual_active_set(G, d, chosen) and solve_equalities(G, d, chosen, base, u)):
        return None
    chosen = G @ u - d <= _TIGHT
    for _ in range(_MOST_SHARES):
        if not solve_equalities(G, d, chosen, base, u):
            return None
        if u.min() >= -ROUNDING:
            return np.maximum(u, 0.0)
        base = np.maximum(u, 0.0)
    return None

"""The small projection: which of a few rows press, guessed, exchanged where the guess fails, and always checked.

Rows are scaled to unit length in the metric: G = J M^-1 J' has a unit diagonal, u are the percussions and d the missing
rates in that scale. An answer counts if its own KKT residual is at rounding; otherwise others are asked.
"""

from __future__ import annotations

import numpy as np

from ..compiled import kernel
from . import tree
from .metric import Array

ROUNDING = 1e-13
# the share of its terms that a sum J w cannot be told from zero at
_LAST_DIGITS = 4e-15
# a pivot of the scaled G under the first belongs to a dependent row, over the second to an independent one
_DEPENDENT, _INDEPENDENT = 1e-13, 1e-8
# slack, relative to the largest speed, under which a row that does not press touches all the same
_TOUCHING = 1e-9
_REFINEMENTS = 2


def _settle_plain(G: Array, d: Array, chosen: Array, base: Array, u: Array) -> bool:
    """Write the u nearest to `base` with (G u)_S = d_S on the chosen rows S and zero elsewhere; False if there is none.

    Parameters
    ----------
    G : ndarray, shape (m, m)
        Scaled Delassus matrix, singular where rows depend on each other.
    d, base, u : ndarray, shape (m,)
        Missing rates, where to start from, and the result.
    chosen : ndarray of bool, shape (m,)
        S.
    """
    S = np.flatnonzero(chosen)
    u[:] = 0.0
    values, vectors = np.linalg.eigh(G[np.ix_(S, S)])
    kept = values > _DEPENDENT * len(S)
    if (values[kept] < _INDEPENDENT).any():
        return False
    missing = d[S] - G[np.ix_(S, S)] @ base[S]
    u[S] = base[S] + vectors[:, kept] @ ((vectors[:, kept].T @ missing) / values[kept])
    return True


@kernel("b1(f8[:,::1], f8[::1], b1[::1], f8[::1], f8[::1])", plain=_settle_plain)
def _settle(G: Array, d: Array, chosen: Array, base: Array, u: Array) -> bool:
    m = len(d)
    # pivoted Cholesky G_SS = C C' with as many columns as G_SS has rank; y with C y = d
    C, y, rest, order = np.zeros((m, m)), np.zeros(m), np.empty(m), np.empty(m, np.int64)
    size = rank = 0
    for a in range(m):
        u[a] = 0.0
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
            return False
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
    if rank == size:
        # independent rows: C' u = y
        for k in range(size - 1, -1, -1):
            s = y[k]
            for i in range(k + 1, size):
                s -= C[order[i], k] * u[order[i]]
            u[order[k]] = s / C[order[k], k]
        return True
    # of all u with C' u = y the nearest to the base: u = base + C (C'C)^-1 (y - C' base)
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
    return True


def _exchange_plain(G: Array, d: Array, chosen: Array) -> bool:
    """Find the rows that press by the dual active-set method; False if none was found.

    Parameters
    ----------
    G : ndarray, shape (m, m)
        Scaled Delassus matrix.
    d : ndarray, shape (m,)
        Missing rates.
    chosen : ndarray of bool, shape (m,)
        Receives the rows; they are independent, and their u with (G u)_S = d_S is not negative.

    Notes
    -----
    min u' G u / 2 - d' u, u >= 0: D. Goldfarb and A. Idnani, Mathematical Programming 27 (1983), 1-33.
    """
    m = len(d)
    S: list[int] = []
    u = np.zeros(m)
    for _ in range(10 * m):
        slack = G @ u - d
        slack[S] = np.inf
        entering = int(np.argmin(slack))
        if slack[entering] >= -ROUNDING * (np.abs(d).max() + np.abs(G @ u).max()):
            chosen[:] = False
            chosen[S] = True
            return True
        while True:
            r = np.linalg.solve(G[np.ix_(S, S)], G[S, entering])
            curvature = G[entering, entering] - G[entering, S] @ r
            missing = d[entering] - G[entering] @ u
            full = missing / curvature if curvature > _INDEPENDENT else np.inf
            ratios = [u[a] / s if s > 0.0 else np.inf for a, s in zip(S, r, strict=True)]
            step = min([full, *ratios])
            if not np.isfinite(step):
                return False
            u[S] -= step * r
            u[entering] += step
            if step == full:
                break
            del S[int(np.argmin(ratios))]
            u[[a for a in range(m) if a not in S and a != entering]] = 0.0
        S.append(entering)
    return False


@kernel("b1(f8[:,::1], f8[::1], b1[::1])", plain=_exchange_plain)
def _exchange(G: Array, d: Array, chosen: Array) -> bool:
    m = len(d)
    S, u, r, slack, F = np.empty(m, np.int64), np.zeros(m), np.empty(m), np.empty(m), np.empty((m, m))
    scale, size = 0.0, 0
    for a in range(m):
        scale = max(scale, abs(d[a]))
        chosen[a] = False
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
        missing = -slack[entering]
        while True:
            # r = G_SS^-1 G_S,entering
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
            curvature = G[entering, entering]
            leaving, step = -1, np.inf
            for i in range(size):
                curvature -= G[entering, S[i]] * r[i]
                if r[i] > 0.0 and u[S[i]] < step * r[i]:
                    leaving, step = i, u[S[i]] / r[i]
            if curvature > _INDEPENDENT and missing <= step * curvature:
                leaving, step = -1, missing / curvature
            if not step < np.inf:
                return False
            for i in range(size):
                u[S[i]] -= step * r[i]
            u[entering] += step
            missing -= step * curvature
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


def _press_plain(J: Array, A: Array, x: Array, lower: Array, last: Array, w: Array, table: Array) -> float:
    """Write argmin |w - x|_M with J w >= lower, if the rows that press are found.

    Parameters
    ----------
    J, A : ndarray, shape (m, nv)
        Gradients, and M^-1 times each of them.
    x, w : ndarray, shape (nv,)
        The velocity to project and the result.
    lower : ndarray, shape (m,)
        Least rates.
    last : ndarray, shape (m,) or (0,)
        Percussions that settled the same rows before, if any.
    table : ndarray, shape (3, m)
        Receives percussions, J x and J w.

    Returns
    -------
    float
        The relative KKT residual of what was written, if it is at rounding; else inf, and that is no answer.
    """
    p, speed, reached = table
    speed[:] = J @ x
    w[:], p[:], reached[:] = x, 0.0, speed
    missing, terms = lower - speed, np.abs(J) @ np.abs(x) + np.abs(lower)
    if (missing <= ROUNDING * terms).all():
        return 0.0
    G = J @ A.T
    lengths = np.sqrt(np.maximum(G.diagonal(), 0.0))
    if not (lengths > 0.0).all():
        return np.inf
    largest = ((np.abs(speed) + np.abs(lower)) / lengths).max()
    enough = max(ROUNDING, _LAST_DIGITS * (terms / lengths).max() / largest)
    G, d = G / np.outer(lengths, lengths), missing / lengths
    nothing, u = np.zeros(len(d)), np.empty(len(d))
    for attempt in range(3):
        chosen, base = d > 0.0, nothing
        if attempt == 1:
            if len(last) != len(d):
                continue
            chosen, base = last > 0.0, last * lengths
        if attempt == 2 and not _exchange(G, d, chosen):
            break
        if not _settle(G, d, chosen, base, u):
            continue
        for _ in range(1 + _REFINEMENTS):
            p[:] = u / lengths
            w[:] = x + p @ A
            reached[:] = J @ w
            slack = (reached - lower) / lengths
            residual = np.abs(np.minimum(u, slack)).max() / largest
            if residual <= enough:
                # rows that touch without pressing may share the percussion: that is settled elsewhere
                alone = attempt < 2 or (slack[~chosen] > _TOUCHING * largest).all()
                return float(residual) if alone else np.inf
            correction = np.empty(len(d))
            _settle(G, -slack, chosen, nothing, correction)
            u += correction
    return np.inf


@kernel("f8(f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[:,::1])", plain=_press_plain)
def press(J: Array, A: Array, x: Array, lower: Array, last: Array, w: Array, table: Array) -> float:
    """Loops of `_press_plain`."""
    m, n = J.shape
    missing = False
    for a in range(m):
        speed, terms = 0.0, abs(lower[a])
        for k in range(n):
            term = J[a, k] * x[k]
            speed += term
            terms += abs(term)
        table[0, a], table[1, a], table[2, a] = 0.0, speed, speed
        missing = missing or not lower[a] - speed <= ROUNDING * terms
    for k in range(n):
        w[k] = x[k]
    if not missing:
        return 0.0
    G, lengths, d, base, u, slack = np.empty((m, m)), np.empty(m), np.empty(m), np.zeros(m), np.empty(m), np.empty(m)
    largest = most_terms = 0.0
    correction, chosen = np.empty(m), np.empty(m, np.bool_)
    for a in range(m):
        for b in range(a + 1):
            g = 0.0
            for k in range(n):
                g += J[a, k] * A[b, k]
            G[a, b] = g
        if not G[a, a] > 0.0:
            return np.inf
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
    enough = max(ROUNDING, _LAST_DIGITS * most_terms / largest)
    for attempt in range(3):
        for a in range(m):
            chosen[a], base[a] = d[a] > 0.0, 0.0
        if attempt == 1:
            if len(last) != m:
                continue
            for a in range(m):
                chosen[a], base[a] = last[a] > 0.0, last[a] * lengths[a]
        if attempt == 2 and not _exchange(G, d, chosen):
            break
        if not _settle(G, d, chosen, base, u):
            continue
        for _ in range(1 + _REFINEMENTS):
            for k in range(n):
                w[k] = x[k]
            for a in range(m):
                table[0, a] = u[a] / lengths[a]
                if u[a] != 0.0:
                    for k in range(n):
                        w[k] += table[0, a] * A[a, k]
            residual, alone = 0.0, True
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
                alone = alone and (chosen[a] or attempt < 2 or slack[a] > _TOUCHING * largest)
                slack[a] = -slack[a]
            if residual <= enough:
                return residual if alone else np.inf
            for a in range(m):
                base[a] = 0.0
            _settle(G, slack, chosen, base, correction)
            for a in range(m):
                u[a] += correction[a]
    return np.inf


def _law_plain(J: Array, A: Array, v: Array, e: Array, x: Array, last: Array, w: Array, rates: Array) -> float:
    """Write argmin |w - x|_M with J w >= -e J v; as `press`, which this calls.

    Parameters
    ----------
    v : ndarray, shape (nv,)
        Velocity before.
    e : ndarray, shape (m,)
        Restitution of each row.
    rates : ndarray, shape (4, m)
        Receives percussions, J x, J w and J v.
    """
    rates[3] = J @ v
    return _press_plain(J, A, x, -e * rates[3], last, w, rates[:3])


@kernel(
    "f8(f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[:,::1])",
    plain=_law_plain,
)
def law(J: Array, A: Array, v: Array, e: Array, x: Array, last: Array, w: Array, rates: Array) -> float:
    """Loops of `_law_plain`."""
    m, n = J.shape
    lower = np.empty(m)
    for a in range(m):
        speed = 0.0
        for k in range(n):
            speed += J[a, k] * v[k]
        rates[3, a], lower[a] = speed, -e[a] * speed
    return press(J, A, x, lower, last, w, rates)


def _tree_law_plain(
    mass: Array, damping: Array, parent: Array, v: Array, h: float, torque: Array, effects: Array, J: Array, e: Array,
    last: Array, w: Array, rates: Array,
) -> float:  # fmt: skip
    """Do the same as `law` for one mechanism under forces, as a `TreePush` is told of; inf if M is not positive."""
    L, x, A = np.empty(mass.shape), np.empty(len(v)), np.empty(J.shape)
    if tree.advance_plain(mass, damping, parent, v, h, torque, effects, L, x):
        return np.inf
    if tree.factor_plain(mass, 0.0, damping, parent, L):
        return np.inf
    tree.solve_plain(L, parent, J, A)
    return _law_plain(J, A, v, e, x, last, w, rates)


@kernel(
    "f8(f8[:,::1], f8[::1], i8[::1], f8[::1], f8, f8[::1], f8[::1], f8[:,::1], f8[::1], f8[::1], f8[::1], f8[:,::1])",
    plain=_tree_law_plain,
)
def tree_law(
    mass: Array, damping: Array, parent: Array, v: Array, h: float, torque: Array, effects: Array, J: Array, e: Array,
    last: Array, w: Array, rates: Array,
) -> float:  # fmt: skip
    """Loops of `_tree_law_plain`."""
    L, x, A = np.empty(mass.shape), np.empty(len(v)), np.empty(J.shape)
    if tree.advance_by(mass, damping, parent, v, h, torque, effects, L, x):
        return np.inf
    damped = False
    for d in damping:
        damped = damped or d != 0.0
    # L is that of M already where there is no damping
    if damped and tree.factor(mass, 0.0, damping, parent, L):
        return np.inf
    tree.solve(L, parent, J, A)
    return law(J, A, v, e, x, last, w, rates)

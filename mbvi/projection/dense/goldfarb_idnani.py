"""Kernels of the dual active-set method on orthonormal factors of the active rows.

Rows are whitened and scaled to unit length: min |z|^2 / 2 subject to W z >= d. The active rows W_S = L Q stay
independent, so that there are at most as many of them as velocities, and an exchange costs a multiple of m n.
"""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ..metric import Array
from ..row_speeds import row_speeds
from .orthonormal_rows import append_row, remove_row, solve_lower, solve_upper

# a row nearer than this to the span of the active ones depends on them; one farther than the second may start the set
_DEPENDENT, _INDEPENDENT = 1e-13, 1e-4
# a sum below this share of its terms is rounding
LAST_DIGITS = 4e-15


@kernel("void(f8[::1], i8[::1], i8, f8[:,::1], f8[:,::1], f8[::1], f8[::1])")
def solve_on_active(d: Array, S: Array, size: int, L: Array, Q: Array, u: Array, z: Array) -> None:
    """Write the solution of W_S z = d_S, z = W_S' u, whose first `size` entries of u belong to the rows S.

    Parameters
    ----------
    d, S, size, L, Q, u, z
        See `goldfarb_idnani`.
    """
    n = len(z)
    for i in range(size):
        u[i] = d[S[i]]
    solve_lower(L, size, u)
    for k in range(n):
        z[k] = 0.0
    for i in range(size):
        for k in range(n):
            z[k] += u[i] * Q[i, k]
    solve_upper(L, size, u)


@kernel("i8(f8[:,::1], f8[::1], b1[::1], i8[::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1])")
def start_from(W: Array, d: Array, chosen: Array, S: Array, L: Array, Q: Array, u: Array, z: Array) -> int:
    """Factor the chosen rows and solve their equations; return their number, 0 if they cannot start the method.

    They cannot if one of them depends on the others or has a negative percussion.

    Parameters
    ----------
    chosen : ndarray of bool, shape (m,)
        The rows.
    W, d, S, L, Q, u, z
        See `goldfarb_idnani`.
    """
    size, most = 0, len(L) - 1
    for a in range(len(d)):
        if chosen[a]:
            if size == most or append_row(W[a], size, _INDEPENDENT, L, Q) < _INDEPENDENT:
                return 0
            S[size] = a
            size += 1
    solve_on_active(d, S, size, L, Q, u, z)
    for i in range(size):
        if not u[i] >= 0.0:
            return 0
    return size


@kernel("Tuple((i8, f8))(f8[:,::1], f8[::1], f8, i8, i8[::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8[::1])")
def goldfarb_idnani(
    W: Array, d: Array, rounding: float, size: int, S: Array, L: Array, Q: Array, u: Array, z: Array, slack: Array
) -> tuple[int, float]:
    """Solve min |z|^2 / 2, W z >= d by adding violated rows one by one and dropping rows of negative percussion.

    |z| grows with every added row, so that no set comes back and the method ends.

    Parameters
    ----------
    W : ndarray, shape (m, n)
        Rows of unit length.
    d, slack : ndarray, shape (m,)
        Right-hand side; receives W z - d.
    rounding : float
        The violation that counts as none.
    size : int
        Number of rows to start from, with percussions that are not negative (`start_from`); 0 to start from none.
    S : ndarray of int, shape (k,), k = min(m, n) + 1
        Their numbers; receives those of the active rows.
    L, Q, u, z : ndarray, shapes (k, k), (k, n), (k,), (n,)
        Their factors and solution; receive those of the active rows.

    Returns
    -------
    size : int
        How many rows are active; -1 if there is no solution.
    contradiction : float
        0, or the least violation of some row that every z has.

    Notes
    -----
    D. Goldfarb and A. Idnani, Mathematical Programming 27 (1983), 1-33.
    """
    m, n = W.shape
    r, active = np.empty(len(S)), np.empty(m, np.bool_)
    for a in range(m):
        active[a] = False
    for i in range(size):
        active[S[i]] = True
    if size == 0:
        for k in range(n):
            z[k] = 0.0
    for _ in range(10 * m + 50):
        norm, entering = 0.0, -1
        for k in range(n):
            norm += z[k] * z[k]
        worst = -rounding - LAST_DIGITS * np.sqrt(norm)
        row_speeds(W, z, 1.0, slack)
        for a in range(m):
            slack[a] -= d[a]
            if slack[a] < worst and not active[a]:
                entering, worst = a, slack[a]
        if entering < 0:
            return size, 0.0
        violation = -slack[entering]
        while True:
            across = append_row(W[entering], size, 0.0, L, Q)
            for i in range(size):
                r[i] = L[size, i]
            solve_upper(L, size, r)
            leaving, step = -1, np.inf
            for i in range(size):
                if r[i] > 0.0 and u[i] < step * r[i]:
                    leaving, step = i, u[i] / r[i]
            curvature = across * across
            if across > _DEPENDENT and violation <= step * curvature:
                leaving, step = -1, violation / curvature
            if not step < np.inf:
                weights = 1.0
                for i in range(size):
                    weights -= r[i]
                return -1, violation / weights
            if leaving < 0:
                break
            for i in range(size):
                u[i] = max(u[i] - step * r[i], 0.0)
            if across > _DEPENDENT:
                violation -= step * curvature
            active[S[leaving]] = False
            remove_row(size, leaving, L, Q)
            size -= 1
            for i in range(leaving, size):
                S[i], u[i] = S[i + 1], u[i + 1]
        S[size], active[entering] = entering, True
        size += 1
        solve_on_active(d, S, size, L, Q, u, z)
        for i in range(size):
            u[i] = max(u[i], 0.0)
    return size, 0.0

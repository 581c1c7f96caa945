"""Kernels that share percussions among dependent rows: of all percussions the ones of least norm.

Where rows depend on each other, the velocity is unique but the percussions are not, and the dual active-set method
leaves some rows without any. Those of least norm are unique, and equal where rows are.
"""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ..metric import Array
from .goldfarb_idnani import LAST_DIGITS
from .orthonormal_rows import append_row, solve_lower, solve_upper

# a row nearer than this to the span of the tight ones depends on them; one farther than the second widens the span
_DEPENDENT, _INDEPENDENT = 1e-12, 1e-4
# least pivot, and limits of steps and of halvings
_LEAST, _MOST_STEPS, _MOST_HALVINGS = 1e-14, 50, 30
# diagonal added after the first step, relative to the root of the relative error
_DAMPING = 1e-4


@kernel("void(f8[:,::1], f8[::1], i8, i8, f8, f8[:,::1], f8[::1])")
def newton_step(B: Array, u: Array, count: int, rank: int, shift: float, N: Array, y: Array) -> None:
    """Overwrite y by (B_F' B_F + shift I)^-1 y, where F are the rows of positive u.

    Parameters
    ----------
    B, u, count, rank
        See `least_norm`.
    shift : float
        Makes a singular matrix regular.
    N, y : ndarray, shapes (n, n), (n,), n >= rank
        Receives the Cholesky factor; the right-hand side.
    """
    for i in range(rank):
        for j in range(i + 1):
            N[i, j] = shift if i == j else 0.0
    for a in range(count):
        if u[a] > 0.0:
            for i in range(rank):
                for j in range(i + 1):
                    N[i, j] += B[a, i] * B[a, j]
    for i in range(rank):
        for j in range(i + 1):
            s = N[i, j]
            for k in range(j):
                s -= N[i, k] * N[j, k]
            N[i, j] = np.sqrt(max(s, _LEAST)) if i == j else s / N[j, j]
    solve_lower(N, rank, y)
    solve_upper(N, rank, y)


@kernel("b1(f8[:,::1], i8, i8, f8[::1], f8[::1])")
def least_norm(B: Array, count: int, rank: int, b: Array, u: Array) -> bool:
    """Write the u >= 0 of least norm with B' u = b; return False if it is not found.

    u is the positive part of B y, where y minimises |max(B y, 0)|^2 / 2 - b' y: Newton's method with halved steps. The
    first step takes those rows for positive of which u is; where that does not end it, it begins with all rows.

    Parameters
    ----------
    B : ndarray, shape (m, n)
        Its first `count` rows and `rank` columns are used; they have full column rank.
    count, rank : int
        See B.
    b, u : ndarray, shapes (n,), (m,)
        Right-hand side; a start, which receives the result.
    """
    guessed = False
    for a in range(count):
        guessed = guessed or u[a] > 0.0
    N, y, step, right = np.empty((rank, rank)), np.empty(rank), np.empty(rank), np.empty(rank)
    tried, gradient = np.empty(count), np.empty(rank)
    value = size = shift = rounding = off = trial = 0.0
    for i in range(rank):
        size = max(size, abs(b[i]))
    for attempt in range(_MOST_STEPS):
        if attempt == 0 or (attempt == 1 and guessed):
            # all rows in the first step: the least norm of any sign
            for a in range(count):
                u[a] = u[a] if attempt == 0 and guessed else 1.0
            for i in range(rank):
                y[i], right[i] = 0.0, b[i]
            value = shift = 0.0
        slope, length = 0.0, 1.0
        for i in range(rank):
            step[i] = right[i]
        newton_step(B, u, count, rank, shift, N, step)
        for i in range(rank):
            slope -= right[i] * step[i]
        for _ in range(1 if attempt == 0 and guessed else _MOST_HALVINGS):
            trial = off = terms = 0.0
            for i in range(rank):
                trial -= b[i] * (y[i] + length * step[i])
                gradient[i] = b[i]
            for a in range(count):
                s = 0.0
                for i in range(rank):
                    s += B[a, i] * (y[i] + length * step[i])
                tried[a] = max(s, 0.0)
                terms += tried[a]
                trial += 0.5 * tried[a] * tried[a]
                for i in range(rank):
                    gradient[i] -= B[a, i] * tried[a]
            for i in range(rank):
                off = max(off, abs(gradient[i]))
            rounding = LAST_DIGITS * (size + terms)
            if off <= rounding or trial <= value + 1e-4 * length * slope:
                break
            length *= 0.5
        for i in range(rank):
            y[i] += length * step[i]
            right[i] = gradient[i]
        for a in range(count):
            u[a] = tried[a]
        if off <= rounding:
            return True
        value, shift = trial, _DAMPING * np.sqrt(off / size)
    return False


@kernel("b1(f8[:,::1], f8[::1], f8, i8[::1], i8, f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8[::1])")
def share(
    W: Array, slack: Array, tight: float, S: Array, size: int, L: Array, Q: Array, z: Array, last: Array, u: Array
) -> bool:
    """Write the percussions of least norm of all tight rows.

    Parameters
    ----------
    W, S, size, L, Q, z
        As `goldfarb_idnani` leaves them; entries of L and Q behind the active rows are written over.
    slack : ndarray, shape (m,)
        W z - d.
    tight : float
        The slack up to which a row is tight.
    last, u : ndarray, shapes (m,) or (0,), and (m,)
        Percussions of the same rows before, if any; receives the percussions.

    Returns
    -------
    bool
        False if only the active rows are tight, or no such percussions are found; then u means nothing.
    """
    m, n = W.shape
    most = min(m, n)
    T, part, B, b, active = np.empty(m, np.int64), np.empty(m), np.empty((m, most)), np.empty(n), np.empty(m, np.bool_)
    for a in range(m):
        u[a], active[a] = 0.0, False
    for i in range(size):
        T[i], active[S[i]] = S[i], True
        for j in range(most):
            B[i, j] = L[i, j] if j <= i else 0.0
    rank = count = size
    for a in range(m):
        if active[a] or not slack[a] <= tight:
            continue
        across = append_row(W[a], rank, _INDEPENDENT, L, Q)
        # a row that nearly depends on the others gets none
        if _DEPENDENT < across < _INDEPENDENT:
            continue
        T[count] = a
        for j in range(most):
            B[count, j] = L[rank, j] if j < rank else 0.0
        if across >= _INDEPENDENT:
            B[count, rank] = across
            rank += 1
        count += 1
    if count == rank:
        return False
    for i in range(rank):
        b[i] = 0.0
        for k in range(n):
            b[i] += Q[i, k] * z[k]
    for i in range(count):
        part[i] = last[T[i]] if len(last) == m else 0.0
    if not least_norm(B, count, rank, b, part):
        return False
    for i in range(count):
        u[T[i]] = part[i]
    return True

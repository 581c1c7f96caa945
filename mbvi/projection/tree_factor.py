"""The factor L of a mass matrix M = L'L, products with it, and the rows of equalities that every velocity keeps.

Behind its nv rows the array of L may have further ones: an orthonormal basis of L'^-1 J_e', where J_e v = 0 are the
equalities of the mechanism. Rows that depend on those before them are zero there.
"""

from __future__ import annotations

import numpy as np

from ..compiled import kernel

Array = np.ndarray

# part of a row that counts as rounding: with less it depends on the rows before it
DEPENDENT = 1e-9
# squared part of a row above which rounding has left it orthogonal to what was taken away
_MUCH = 0.25
# squared part of a row below which nothing of it is left
_NOTHING = 1e-24


@kernel("i8(f8[:,::1], f8, f8[::1], i8[::1], f8[:,::1])")
def factor_mass(mass: Array, h: float, damping: Array, parent: Array, L: Array) -> int:
    """Write L with L'L = M + h D; return 0, or one plus a row where that turns out not to be positive definite.

    Rows of equalities are left as they are.

    Parameters
    ----------
    mass : ndarray, shape (nv + m, nv)
        M, of which the lower triangle is read, and the m rows of the equalities, if there are any.
    h, damping : float and ndarray, shape (nv,)
        h and the diagonal of D.
    parent : ndarray of int, shape (nv,)
        The velocity that carries each one, -1 where there is none; M couples a velocity to its ancestors only.
    L : ndarray, shape (nv + m, nv)
        Receives in its first rows the entries of each velocity and of what carries it; the others are left.

    Notes
    -----
    R. Featherstone, Rigid Body Dynamics Algorithms (2008), table 6.3.
    """
    n = len(parent)
    for i in range(n):
        L[i, i] = mass[i, i] + h * damping[i]
        j = parent[i]
        while j >= 0:
            L[i, j] = mass[i, j]
            j = parent[j]
    for k in range(n - 1, -1, -1):
        # written so that a NaN is refused too
        if not L[k, k] > 0.0:
            return k + 1
        row = L[k]
        row[k] = np.sqrt(row[k])
        i = parent[k]
        while i >= 0:
            row[i] /= row[k]
            i = parent[i]
        i = parent[k]
        while i >= 0:
            # two rows side by side wait less for the next parent
            above, one = parent[i], row[i]
            L[i, i] -= one * one
            if above < 0:
                break
            two, first, second, j = row[above], L[i], L[above], above
            while j >= 0:
                x = row[j]
                first[j] -= one * x
                second[j] -= two * x
                j = parent[j]
            i = parent[above]
    return 0


@kernel("void(f8[:,::1], i8[::1], f8[::1])")
def whiten(L: Array, parent: Array, x: Array) -> None:
    """Overwrite x, shape (nv,), by L'^-1 x."""
    for k in range(len(x) - 1, -1, -1):
        # a gradient touches the joints that carry its bodies only
        if x[k] != 0.0:
            x[k] /= L[k, k]
            i = parent[k]
            while i >= 0:
                x[i] -= L[k, i] * x[k]
                i = parent[i]


@kernel("void(f8[:,::1], i8[::1], f8[:,::1])")
def whiten_four(L: Array, parent: Array, x: Array) -> None:
    """Overwrite each row of x, shape (4, nv), by L'^-1 times it; see `unwhiten_four`."""
    for k in range(x.shape[1] - 1, -1, -1):
        a, b, c, d = x[0, k], x[1, k], x[2, k], x[3, k]
        if a != 0.0 or b != 0.0 or c != 0.0 or d != 0.0:
            part = L[k, k]
            a, b, c, d = a / part, b / part, c / part, d / part
            x[0, k], x[1, k], x[2, k], x[3, k] = a, b, c, d
            i = parent[k]
            while i >= 0:
                part = L[k, i]
                x[0, i] -= part * a
                x[1, i] -= part * b
                x[2, i] -= part * c
                x[3, i] -= part * d
                i = parent[i]


@kernel("void(f8[:,::1], i8[::1], f8[::1])")
def unwhiten(L: Array, parent: Array, x: Array) -> None:
    """Overwrite x, shape (nv,), by L^-1 x."""
    for k in range(len(x)):
        y = x[k]
        i = parent[k]
        while i >= 0:
            y -= L[k, i] * x[i]
            i = parent[i]
        x[k] = y / L[k, k]


@kernel("void(f8[:,::1], i8[::1], b1[::1], f8[:,::1])")
def unwhiten_four(L: Array, parent: Array, moved: Array, x: Array) -> None:
    """Overwrite each row of x, shape (4, nv), by L^-1 times it: four sums side by side wait less for each other.

    `moved`, shape (nv,), receives which velocities move, or are carried by some that do: the others stay zero.
    """
    for k in range(x.shape[1]):
        a, b, c, d = x[0, k], x[1, k], x[2, k], x[3, k]
        i = parent[k]
        moved[k] = a != 0.0 or b != 0.0 or c != 0.0 or d != 0.0 or (i >= 0 and moved[i])
        if moved[k]:
            while i >= 0:
                part = L[k, i]
                a, b, c, d = a - part * x[0, i], b - part * x[1, i], c - part * x[2, i], d - part * x[3, i]
                i = parent[i]
            part = L[k, k]
            x[0, k], x[1, k], x[2, k], x[3, k] = a / part, b / part, c / part, d / part


@kernel("f8(f8[::1])")
def squared(x: Array) -> float:
    """Return the squared length of x, shape (n,)."""
    n = len(x)
    a = b = c = d = 0.0
    for k in range(0, n - n % 4, 4):
        a, b, c, d = a + x[k] * x[k], b + x[k + 1] * x[k + 1], c + x[k + 2] * x[k + 2], d + x[k + 3] * x[k + 3]
    for k in range(n - n % 4, n):
        a += x[k] * x[k]
    return (a + b) + (c + d)


@kernel("UniTuple(f8, 4)(f8[:,::1], i8, f8[::1])")
def remove_four(Q: Array, j: int, row: Array) -> tuple[float, float, float, float]:
    """Subtract from a row, shape (n,), its parts along four orthonormal rows of Q from row j on; return these parts.

    Four sums side by side wait less for each other.
    """
    n, a, b, c, d = len(row), 0.0, 0.0, 0.0, 0.0
    for k in range(n):
        x = row[k]
        a, b, c, d = a + Q[j, k] * x, b + Q[j + 1, k] * x, c + Q[j + 2, k] * x, d + Q[j + 3, k] * x
    for k in range(n):
        row[k] -= a * Q[j, k] + b * Q[j + 1, k] + c * Q[j + 2, k] + d * Q[j + 3, k]
    return a, b, c, d


@kernel("f8(f8[:,::1], i8, f8[::1])")
def remove_one(Q: Array, j: int, row: Array) -> float:
    """Subtract from a row, shape (n,), its part along row j of Q; return it."""
    part = 0.0
    for k in range(len(row)):
        part += Q[j, k] * row[k]
    for k in range(len(row)):
        row[k] -= part * Q[j, k]
    return part


@kernel("void(f8[:,::1], f8[::1], f8[::1])")
def remove_parts(Q: Array, row: Array, parts: Array) -> None:
    """Subtract from a row, shape (n,), its parts along orthonormal rows Q, shape (m, n), and write these parts."""
    m = len(Q)
    for j in range(0, m - m % 4, 4):
        parts[j], parts[j + 1], parts[j + 2], parts[j + 3] = remove_four(Q, j, row)
    for j in range(m - m % 4, m):
        parts[j] = remove_one(Q, j, row)


@kernel("i8(f8[:,::1], i8[::1], f8, f8[:,::1], f8[:,::1])")
def span_equalities(mass: Array, parent: Array, least: float, L: Array, R: Array) -> int:
    """Write the basis of the equalities behind the factor of M; return its size, the rank of J_e.

    Parameters
    ----------
    mass : ndarray, shape (nv + m, nv)
        J_e in its last m rows.
    parent, L
        See `tree.factor`; the factor is known.
    least : float
        The part of a row that others must leave of it: with less the row depends on them.
    R : ndarray, shape (m, m) or (0, 0)
        Receives, if it is not empty, the lower triangle with L'^-1 J_e' = (R Q)', where Q are the rows of the basis.
    """
    n, m, rank, longest = len(parent), len(mass) - len(parent), 0, 0.0
    parts = np.empty(m)
    for i in range(n, len(mass)):
        for k in range(n):
            L[i, k] = mass[i, k]
    fours = m - m % 4
    for i in range(n, n + fours, 4):
        whiten_four(L, parent, L[i : i + 4])
    for i in range(n + fours, n + m):
        whiten(L, parent, L[i])
    for i in range(n, n + m):
        longest = max(longest, squared(L[i]))
    for i in range(m):
        row = L[n + i]
        before, after = squared(row), 0.0
        for j in range(len(R)):
            R[i, j] = 0.0
        left = before
        for _ in range(2):
            remove_parts(L[n : n + i], row, parts)
            for j in range(i if len(R) else 0):
                R[i, j] += parts[j]
            after = squared(row)
            # once more where much was taken away, whose rounding is left
            if after > _MUCH * left:
                break
            left = after
        # a row that is rounding in the place of zero moves nothing
        independent = after > least * least * before and after > DEPENDENT * DEPENDENT * longest
        length = np.sqrt(after) if independent else 1.0
        for k in range(n):
            row[k] = row[k] / length if independent else 0.0
        if len(R):
            R[i, i] = length if independent else 0.0
        rank += independent
    return rank


@kernel("void(f8[:,::1], f8[::1])")
def subtract_equalities(L: Array, x: Array) -> None:
    """Subtract from whitened x, shape (nv,), its part along the equalities."""
    n, m = len(x), len(L) - len(x)
    for i in range(n, n + m - m % 4, 4):
        remove_four(L, i, x)
    for i in range(n + m - m % 4, n + m):
        remove_one(L, i, x)


@kernel("void(f8[:,::1], i8[::1], f8[::1])")
def solve_keeping(L: Array, parent: Array, x: Array) -> None:
    """Overwrite a force, shape (nv,), by (L'L)^-1 times it, without its part along the equalities."""
    whiten(L, parent, x)
    subtract_equalities(L, x)
    unwhiten(L, parent, x)


@kernel("void(f8[:,::1], f8[::1])")
def take_off(L: Array, x: Array) -> None:
    """Take from a whitened row x, shape (nv,), its part along the equalities; what is left by rounding becomes zero."""
    n, before, after = len(x), 0.0, 0.0
    for k in range(n):
        before += x[k] * x[k]
    subtract_equalities(L, x)
    for k in range(n):
        after += x[k] * x[k]
    if after <= _NOTHING * before:
        for k in range(n):
            x[k] = 0.0


@kernel("void(f8[:,::1], i8[::1], f8[::1])")
def keep_equalities(L: Array, parent: Array, v: Array) -> None:
    """Overwrite a velocity, shape (nv,), by the nearest one in the kinetic metric with J_e v = 0."""
    n = len(v)
    # L v, from the last entry on: row k needs those up to k
    for k in range(n - 1, -1, -1):
        y = L[k, k] * v[k]
        i = parent[k]
        while i >= 0:
            y += L[k, i] * v[i]
            i = parent[i]
        v[k] = y
    subtract_equalities(L, v)
    unwhiten(L, parent, v)


@kernel("void(f8[:,::1], i8[::1], f8[:,::1], f8[::1], f8[::1])")
def least_change(L: Array, parent: Array, R: Array, rate: Array, change: Array) -> None:
    """Write the velocity of least kinetic energy with J_e change = -rate, shapes (nv,) and (m,).

    `R` is that of `span_equalities`. Rows that depend on others are met where the rates are consistent.
    """
    n, m = len(change), len(rate)
    part = np.zeros(m)
    for k in range(n):
        change[k] = 0.0
    for i in range(m):
        if R[i, i] > 0.0:
            part[i] = -rate[i]
            for j in range(i):
                part[i] -= R[i, j] * part[j]
            part[i] /= R[i, i]
            for k in range(n):
                change[k] += part[i] * L[n + i, k]
    unwhiten(L, parent, change)

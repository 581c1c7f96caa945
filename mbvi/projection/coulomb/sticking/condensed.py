"""What contacts that stick leave of the law of the others, and their percussions given those of the others."""

from __future__ import annotations

import numpy as np

from ....compiled import kernel
from ...metric import Array

# a lesser pivot of a contact's own block counts as zero
_REGULAR = 1e-6


@kernel("b1(f8[:,::1], f8, f8[:,::1])")
def invert(matrix: Array, added: float, inverse: Array) -> bool:
    """Write the inverse of a matrix, shape (n, n), with a number added to its diagonal; False if it is singular."""
    n, work = len(matrix), matrix.copy()
    for i in range(n):
        work[i, i] += added
        for j in range(n):
            inverse[i, j] = 1.0 if i == j else 0.0
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if abs(work[i, k]) > abs(work[pivot, k]):
                pivot = i
        # written so that a NaN is refused too
        if not abs(work[pivot, k]) > _REGULAR:
            return False
        factor = 1.0 / work[pivot, k]
        for j in range(n):
            work[k, j], work[pivot, j] = work[pivot, j], work[k, j]
            inverse[k, j], inverse[pivot, j] = inverse[pivot, j], inverse[k, j]
            work[k, j] *= factor
            inverse[k, j] *= factor
        for i in range(n):
            factor = work[i, k]
            if i != k and factor != 0.0:
                for j in range(n):
                    work[i, j] -= factor * work[k, j]
                    inverse[i, j] -= factor * inverse[k, j]
    return True


@kernel(
    "void(f8[:,::1], f8[:,::1], i8[:,::1], i8[::1], i8[::1], i8[::1], f8[::1], f8[:,::1], f8[:,::1], f8[:,::1], "
    "f8[:,::1], f8[:,::1])"
)
def part_rows(
    J: Array, A: Array, columns: Array, counts: Array, shared: Array, place: Array, scale: Array, U: Array, V: Array,
    R: Array, B: Array, rest: Array,
) -> None:  # fmt: skip
    """Write the scaled rows J and A in shared columns: U and V of carried contacts, R and B of the others.

    Parameters
    ----------
    J, A, columns, counts, scale, place
        See `choose_carried`.
    shared : ndarray of int, shape (nv,)
        The place of each column among the s that carried contacts share with others, -1 of other columns.
    U, V, R, B : ndarray, shapes (3 l, s), (3 l, s), (3 k, s) and (3 k, s)
        Zeros, which receive them.
    rest : ndarray, shape (3 k, 3 k)
        Zeros; receives what the columns that are not shared add to G of the others.
    """
    nv, row = len(shared), np.zeros((3, len(shared)))
    for a in range(len(counts)):
        i = 3 * a
        for n in range(counts[a]):
            k = columns[a, n]
            j = shared[k]
            for r in range(3):
                if j >= 0 and place[a] >= 0:
                    U[3 * place[a] + r, j], V[3 * place[a] + r, j] = scale[a] * J[i + r, k], scale[a] * A[i + r, k]
                elif j >= 0:
                    R[-3 * place[a] - 3 + r, j] = scale[a] * J[i + r, k]
                    B[-3 * place[a] - 3 + r, j] = scale[a] * A[i + r, k]
    for a in range(len(counts)):
        if place[a] >= 0:
            continue
        i, first = 3 * a, -3 * place[a] - 3
        for n in range(counts[a]):
            k = columns[a, n]
            if shared[k] < 0:
                for r in range(3):
                    row[r, k] = scale[a] * J[i + r, k]
        for d in range(a + 1):
            if place[d] >= 0:
                continue
            for n in range(counts[d]):
                k = columns[d, n]
                if shared[k] >= 0:
                    continue
                for r in range(3):
                    for c in range(3):
                        rest[first + r, -3 * place[d] - 3 + c] += row[r, k] * scale[d] * A[3 * d + c, k]
        for k in range(nv):
            row[0, k] = row[1, k] = row[2, k] = 0.0
    for i in range(len(rest)):
        for j in range(i):
            if i // 3 == j // 3:
                rest[i, j] = 0.5 * (rest[i, j] + rest[j, i])
            rest[j, i] = rest[i, j]


@kernel(
    "b1(f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[:,:,::1], f8[:,::1], f8, f8[::1], f8[::1], f8[:,:,::1], "
    "f8[:,::1], f8[::1], f8[:,::1], f8[::1])"
)
def condense(
    U: Array, V: Array, R: Array, B: Array, own: Array, rest: Array, added: float, b: Array, others: Array,
    inverses: Array, K: Array, y: Array, G: Array, c: Array,
) -> bool:  # fmt: skip
    """Write G and the velocities of the other contacts where carried ones stick; False if these are nearly singular.

    Parameters
    ----------
    U, V, R, B, own, rest
        See `part_rows` and `choose_carried`.
    added : float
        Compliance of each row.
    b, others : ndarray, shapes (3 l,) and (3 k,)
        Velocities of carried and of other contacts without percussions.
    inverses, K, y : ndarray, shapes (l, 3, 3), (s, s) and (s,)
        Receive what `uncarried` needs.
    G, c : ndarray, shapes (3 k, 3 k) and (3 k,)
        Receive them.
    """
    s, S, t, x = len(y), np.zeros(K.shape), np.empty((3, len(y))), np.empty(len(y))
    for j in range(s):
        x[j] = 0.0
    for a in range(len(inverses)):
        if not invert(own[a], added, inverses[a]):
            return False
        E, i = inverses[a], 3 * a
        for j in range(s):
            for r in range(3):
                t[r, j] = V[i, j] * E[0, r] + V[i + 1, j] * E[1, r] + V[i + 2, j] * E[2, r]
            x[j] += t[0, j] * b[i] + t[1, j] * b[i + 1] + t[2, j] * b[i + 2]
        for j in range(s):
            for k in range(s):
                S[j, k] += t[0, j] * U[i, k] + t[1, j] * U[i + 1, k] + t[2, j] * U[i + 2, k]
    if not invert(S, 1.0, K):
        return False
    for j in range(s):
        y[j] = 0.0
        for k in range(s):
            y[j] += K[j, k] * x[k]
    for i in range(len(c)):
        c[i] = others[i]
        for k in range(s):
            c[i] -= R[i, k] * y[k]
            x[k] = 0.0
            for j in range(s):
                x[k] += R[i, j] * K[j, k]
        for j in range(i + 1):
            value = rest[i, j]
            for k in range(s):
                value += x[k] * B[j, k]
            G[i, j] = G[j, i] = value
        G[i, i] += added
    return True


@kernel("void(f8[:,::1], f8[:,::1], f8[:,:,::1], f8[:,::1], f8[::1], f8[::1], i8[::1], f8[::1], f8[::1])")
def uncarried(
    U: Array, B: Array, inverses: Array, K: Array, y: Array, b: Array, place: Array, others: Array, p: Array
) -> None:
    """Write the percussions of all contacts, shape (3 m,), given those of the others, shape (3 k,); see `condense`."""
    s = len(y)
    moved, x = np.zeros(s), np.zeros(s)
    for i in range(len(others)):
        for j in range(s):
            x[j] += B[i, j] * others[i]
    for j in range(s):
        moved[j] = -y[j]
        for k in range(s):
            moved[j] += K[j, k] * x[k]
    u = np.empty(3)
    for a in range(len(place)):
        for r in range(3):
            if place[a] < 0:
                p[3 * a + r] = others[-3 * place[a] - 3 + r]
                continue
            i = 3 * place[a] + r
            u[r] = b[i]
            for j in range(s):
                u[r] += U[i, j] * moved[j]
        if place[a] >= 0:
            E = inverses[place[a]]
            for r in range(3):
                p[3 * a + r] = -(E[r, 0] * u[0] + E[r, 1] * u[1] + E[r, 2] * u[2])

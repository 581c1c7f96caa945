"""Coulomb's law where bodies that stick at one contact move with what they stick to: the others are what is solved for.

A contact is carried if it stuck in the last answer, and some velocities are its own: no other contact acts on them. So
is the contact of a ball that rolls on a box. It keeps sticking, which is linear and eliminates its percussion. The
velocities that it shares with others, those of the box, then move as if more mass were there. Where the answer does not
satisfy the law of all contacts, all are solved for.
"""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ..metric import Array
from .few_contacts import couples_weakly, independent_rows, solve_softened
from .newton import resume_newton
from .rescue import COMPLIANCE

# fewest contacts that are carried, and the most velocities that they share with others, for each of them
FEWEST, _MOST_SHARED = 4, 2
# a contact counts as sticking if the percussion is by this part of its bound inside the cone
_INSIDE = 1e-3
# a lesser pivot of a contact's own block counts as zero
_REGULAR = 1e-6
_RESUMED_STEPS = 6
# owners of columns that no contact has, and of those that several have
_NOBODY, _SEVERAL = -1, -2


@kernel("void(f8[:,::1], f8[:,::1], i8[:,::1], i8[::1], i8[::1])")
def list_columns(J: Array, A: Array, columns: Array, counts: Array, owner: Array) -> None:
    """List the columns that are not zero in the rows of each contact.

    Parameters
    ----------
    J, A : ndarray, shape (3 m, nv)
        See `coulomb_law`.
    columns, counts : ndarray of int, shapes (m, nv) and (m,)
        Receive the columns of each contact, and how many there are.
    owner : ndarray of int, shape (nv,)
        Receives the contact that alone has a column, -1 if none has it, -2 if several have.
    """
    for k in range(len(owner)):
        owner[k] = _NOBODY
    for a in range(len(counts)):
        count, i = 0, 3 * a
        for k in range(len(owner)):
            acts = J[i, k] != 0.0 or J[i + 1, k] != 0.0 or J[i + 2, k] != 0.0
            if acts or A[i, k] != 0.0 or A[i + 1, k] != 0.0 or A[i + 2, k] != 0.0:
                columns[a, count] = k
                count += 1
                owner[k] = a if owner[k] == _NOBODY else _SEVERAL
        counts[a] = count


@kernel("b1(f8[:,::1], f8[:,::1], i8[:,::1], i8[::1], f8[:,::1], f8[::1])")
def diagonal_blocks(J: Array, A: Array, columns: Array, counts: Array, G: Array, scale: Array) -> bool:
    """Write the diagonal blocks of G and the scales as `delassus` does; False if a normal row vanishes.

    The other arguments are those of `delassus` and `list_columns`.
    """
    for a in range(len(counts)):
        i = 3 * a
        for r in range(3):
            for c in range(3):
                G[i + r, i + c] = 0.0
        for n in range(counts[a]):
            k = columns[a, n]
            for r in range(3):
                for c in range(3):
                    G[i + r, i + c] += J[i + r, k] * A[i + c, k]
        # written so that a NaN is refused too
        if not G[i, i] > 0.0:
            return False
        scale[a] = 1.0 / np.sqrt(G[i, i])
        for r in range(3):
            for c in range(r, 3):
                G[i + r, i + c] = G[i + c, i + r] = 0.5 * scale[a] ** 2 * (G[i + r, i + c] + G[i + c, i + r])
    return True


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


@kernel("i8(f8[:,::1], f8[:,::1], i8[:,::1], i8[::1], i8[::1], f8[::1], f8[::1], f8[::1], i8[::1], f8[:,:,::1])")
def choose_carried(
    J: Array, A: Array, columns: Array, counts: Array, owner: Array, mu: Array, scale: Array, p: Array, place: Array,
    own: Array,
) -> int:  # fmt: skip
    """Choose the contacts that are carried; return how many.

    Parameters
    ----------
    J, A, columns, counts, owner, scale
        See `list_columns` and `diagonal_blocks`.
    mu, p : ndarray, shapes (m,) and (3 m,)
        Coefficients, and scaled percussions of the last answer.
    place : ndarray of int, shape (m,)
        Receives the place of each contact among those that are carried, of others -1 minus that among the others.
    own : ndarray, shape (m, 3, 3)
        Receives, of those that are carried, the part of their scaled block of G that their own columns make.
    """
    carried, inverse = 0, np.empty((3, 3))
    for a in range(len(mu)):
        i, place[a] = 3 * a, carried - a - 1
        across = np.sqrt(p[i + 1] ** 2 + p[i + 2] ** 2)
        # written so that a NaN is refused too
        if not across < (1.0 - _INSIDE) * mu[a] * p[i]:
            continue
        block, square = own[carried], scale[a] ** 2
        for r in range(3):
            for c in range(3):
                block[r, c] = 0.0
        for n in range(counts[a]):
            k = columns[a, n]
            if owner[k] == a:
                for r in range(3):
                    for c in range(3):
                        block[r, c] += square * J[i + r, k] * A[i + c, k]
        if invert(block, 0.0, inverse):
            place[a] = carried
            carried += 1
    return carried


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


@kernel(
    "Tuple((b1, b1))(f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[:,:,::1], f8[:,::1], f8[::1], f8[::1], i8[::1], "
    "b1, f8, f8[::1], f8[::1])"
)
def solve_others(
    U: Array, V: Array, R: Array, B: Array, own: Array, rest: Array, b: Array, mu: Array, place: Array,
    was_unique: bool, limit: float, soft: Array, p: Array,
) -> tuple[bool, bool]:  # fmt: skip
    """Write the percussions of all contacts, given which are carried; the arguments are those of `solve_carried`.

    Returns
    -------
    found, unique : bool
        See `solve_carried`.
    """
    n, s = len(rest), R.shape[1]
    theirs, others, q, cone, closing = np.empty(len(U)), np.empty(n), np.empty(n), np.empty(n // 3), n == 0
    for a in range(len(mu)):
        i = 3 * place[a] if place[a] >= 0 else -3 * place[a] - 3
        for r in range(3):
            if place[a] >= 0:
                theirs[i + r] = b[3 * a + r]
            else:
                others[i + r], q[i + r], cone[i // 3] = b[3 * a + r], p[3 * a + r], mu[a]
    inverses, K, y, G, c = np.empty(own.shape), np.empty((s, s)), np.empty(s), np.empty((n, n)), np.empty(n)
    if not condense(U, V, R, B, own, rest, 0.0, theirs, others, inverses, K, y, G, c):
        return False, False
    for i in range(n):
        closing = closing or c[i] != 0.0
    if not closing:
        return False, False
    x, unique = q.copy(), independent_rows(G, cone, np.full(n // 3, -1))
    if n == 0 or (unique and was_unique and resume_newton(G, c, cone, _RESUMED_STEPS, limit, q) <= limit):
        uncarried(U, B, inverses, K, y, theirs, place, q, p)
        return True, unique
    softer, L, z, H, d = np.empty(own.shape), np.empty((s, s)), np.empty(s), np.empty((n, n)), np.empty(n)
    if not condense(U, V, R, B, own, rest, COMPLIANCE, theirs, others, softer, L, z, H, d):
        return False, False
    solve_softened(G, c, H, d, cone, limit, unique, not was_unique, x, q)
    uncarried(U, B, inverses, K, y, theirs, place, q, p)
    uncarried(U, B, softer, L, z, theirs, place, x, soft)
    for a in range(len(mu)):
        across = np.sqrt(soft[3 * a + 1] ** 2 + soft[3 * a + 2] ** 2)
        if place[a] >= 0 and not across <= mu[a] * soft[3 * a]:
            return False, False
    return True, unique


@kernel(
    "Tuple((b1, b1))(f8[:,::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8[::1], i8[::1], i8[:,::1], i8[::1], b1, f8, "
    "f8[::1], f8[::1])"
)
def solve_carried(
    J: Array, A: Array, G: Array, scale: Array, b: Array, mu: Array, owner: Array, columns: Array, counts: Array,
    was_unique: bool, limit: float, soft: Array, p: Array,
) -> tuple[bool, bool]:  # fmt: skip
    """Write the percussions of the law where some contacts are carried.

    Parameters
    ----------
    J, A, G, scale, owner, columns, counts
        See `diagonal_blocks` and `list_columns`.
    b, mu, limit, soft, p
        See `law.solve_scaled`.
    was_unique : bool
        Whether the percussions to start from were unique; else they are those of compliant contacts.

    Returns
    -------
    found : bool
        Whether contacts were carried, and stick where all are compliant too.
    unique : bool
        See `law.solve_scaled`.
    """
    m, s, shared = len(mu), 0, np.full(len(owner), -1)
    place, own = np.empty(m, np.int64), np.empty((m, 3, 3))
    carried = choose_carried(J, A, columns, counts, owner, mu, scale, p, place, own)
    for a in range(m):
        for n in range(counts[a]):
            if place[a] >= 0 and owner[columns[a, n]] == _SEVERAL and shared[columns[a, n]] < 0:
                shared[columns[a, n]] = s
                s += 1
    if carried < FEWEST or s > _MOST_SHARED * carried or not couples_weakly(G, mu):
        return False, False
    n = 3 * (m - carried)
    U, V, R, B = np.zeros((3 * carried, s)), np.zeros((3 * carried, s)), np.zeros((n, s)), np.zeros((n, s))
    rest = np.zeros((n, n))
    part_rows(J, A, columns, counts, shared, place, scale, U, V, R, B, rest)
    return solve_others(U, V, R, B, own[:carried], rest, b, mu, place, was_unique, limit, soft, p)

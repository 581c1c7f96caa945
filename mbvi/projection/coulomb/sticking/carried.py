"""Coulomb's law where bodies that stick at one contact move with what they stick to: the others are what is solved for.

A contact is carried if it stuck in the last answer, and some velocities are its own: no other contact acts on them. So
is the contact of a ball that rolls on a box. It keeps sticking, which is linear and eliminates its percussion. The
velocities that it shares with others, those of the box, then move as if more mass were there. Where the answer does not
satisfy the law of all contacts, all are solved for.
"""

from __future__ import annotations

import numpy as np

from ....compiled import kernel
from ...metric import Array
from ..few_contacts import couples_weakly, independent_rows, solve_softened
from ..newton.directions import without_rows
from ..newton.iterations import resume_newton
from ..rescue import COMPLIANCE
from .condensed import condense, invert, part_rows, uncarried

# fewest contacts that are carried, and the most velocities that they share with others, for each of them
FEWEST, _MOST_SHARED = 4, 2
# a contact counts as sticking if the percussion is by this part of its bound inside the cone
_INSIDE = 1e-3
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
    if n == 0 or (unique and was_unique and resume_newton(without_rows(G), c, cone, _RESUMED_STEPS, limit, q) <= limit):
        uncarried(U, B, inverses, K, y, theirs, place, q, p)
        return True, unique
    softer, L, z, H, d = np.empty(own.shape), np.empty((s, s)), np.empty(s), np.empty((n, n)), np.empty(n)
    if not condense(U, V, R, B, own, rest, COMPLIANCE, theirs, others, softer, L, z, H, d):
        return False, False
    solve_softened(without_rows(G), c, without_rows(H), d, cone, limit, unique, not was_unique, x, q)
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

"""The kernel of Coulomb's law for contacts of several islands: contacts of different islands move nothing in common."""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ..metric import Array
from ..sparse.gram import islands
from .law import free_speeds, law_of_all
from .newton.cases import OPEN
from .sticking.carried import list_columns


@kernel("b1(f8[:,::1])")
def share_a_velocity(A: Array) -> bool:
    """Return whether all contacts move the first velocity that the first contact moves, as those of one robot do."""
    first = 0
    while first < A.shape[1] - 1 and A[0, first] == 0.0 and A[1, first] == 0.0 and A[2, first] == 0.0:
        first += 1
    for i in range(0, len(A), 3):
        if A[i, first] == 0.0 and A[i + 1, first] == 0.0 and A[i + 2, first] == 0.0:
            return False
    return True


@kernel("i8(f8[:,::1], f8[:,::1], i8[::1], i8[::1], i8[::1])")
def label_contacts(J: Array, A: Array, bound: Array, owner: Array, label: Array) -> int:
    """Write the island of each contact; return how many islands there are.

    Parameters
    ----------
    J, A, bound
        See `coulomb_law`.
    owner : ndarray of int, shape (nv,)
        Receives the first contact that moves each velocity, -1 if none does.
    label : ndarray of int, shape (m,)
        Receives the island of each contact, in the order of their first contacts.
    """
    m, nv, end = len(label), len(owner), 0
    columns, counts, flat = np.empty((m, nv), np.int64), np.empty(m, np.int64), np.empty(m * (nv + 1), np.uint32)
    starts = np.zeros(m + 1, np.uint32)
    list_columns(J, A, columns, counts, owner)
    for k in range(nv):
        owner[k] = -1
    for a in range(m):
        for n in range(counts[a]):
            k = columns[a, n]
            flat[end], end = k, end + 1
            owner[k] = a if owner[k] < 0 else owner[k]
        # a column that it shares with the contact which bounds it
        flat[end], end = nv + (bound[a] if bound[a] >= 0 else a), end + 1
        starts[a + 1] = end
    return islands(flat[:end], starts, nv + m, np.ones(m, np.bool_), label)


@kernel(
    "Tuple((f8, b1))(i8, i8[::1], i8[::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8[::1], i8[::1], i8, f8, f8[::1], "
    "f8[::1], f8[:,::1], i8[::1])"
)
def law_of_island(
    island: int, label: Array, owner: Array, J: Array, A: Array, x: Array, lower: Array, mu: Array, bound: Array,
    known: int, limit: float, start: Array, w: Array, table: Array, case: Array,
) -> tuple[float, bool]:  # fmt: skip
    """Write the part of `coulomb_law` that is about one island, and return what it returns.

    `label` and `owner` are those of `label_contacts`; `w` holds x. The other arguments are those of `coulomb_law`.
    """
    m, nv = len(mu), len(x)
    contacts, columns, place, count, width = np.empty(m, np.int64), np.empty(nv, np.int64), np.empty(m, np.int64), 0, 0
    for a in range(m):
        if label[a] == island:
            contacts[count], place[a] = a, count
            count += 1
    for k in range(nv):
        if owner[k] >= 0 and label[owner[k]] == island:
            columns[width] = k
            width += 1
    n = 3 * count
    own_J, own_A, own_x, own_w = np.empty((n, width)), np.empty((n, width)), np.empty(width), np.empty(width)
    own_lower, own_start, own_table, own_mu = np.empty(n), np.empty(n), np.empty((3, n)), np.empty(count)
    own_bound, own_case = np.empty(count, np.int64), np.full(count, OPEN)
    for k in range(width):
        own_x[k] = own_w[k] = x[columns[k]]
    for c in range(count):
        a = contacts[c]
        own_mu[c], own_bound[c] = mu[a], place[bound[a]] if bound[a] >= 0 else -1
        for r in range(3):
            i, j = 3 * c + r, 3 * a + r
            own_lower[i], own_start[i] = lower[j], start[j]
            for k in range(width):
                own_J[i, k], own_A[i, k] = J[j, columns[k]], A[j, columns[k]]
    closing, cancelled = free_speeds(own_J, own_x, own_lower, own_mu, own_table)
    residual, unique = 0.0, True
    if closing:
        residual, unique = law_of_all(
            own_J, own_A, own_x, own_lower, own_mu, own_bound, known, limit, own_start, cancelled, own_w, own_table,
            own_case,
        )  # fmt: skip
    for k in range(width):
        w[columns[k]] = own_w[k]
    for i in range(n):
        j = 3 * contacts[i // 3] + i % 3
        case[j // 3], start[j] = own_case[i // 3], own_start[i]
        table[0, j], table[1, j], table[2, j] = own_table[0, i], own_table[1, i], own_table[2, i]
    return residual, unique


@kernel(
    "Tuple((f8, b1))(f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8[::1], i8[::1], i8, f8, f8[::1], f8[::1], f8[:,::1], "
    "i8[::1])"
)
def coulomb_law(
    J: Array, A: Array, x: Array, lower: Array, mu: Array, bound: Array, known: int, limit: float, start: Array,
    w: Array, table: Array, case: Array,
) -> tuple[float, bool]:  # fmt: skip
    """Write the velocity w that Coulomb's law gives, with M (w - x) = J' p.

    Contacts are solved island by island, so that those of bodies which do not touch each other are as if alone.

    Parameters
    ----------
    J, A : ndarray, shape (n, nv), n = 3 m
        Of each contact the normal and two tangents, and M^-1 times each of them. Tangents may be zero rows.
    x, w : ndarray, shape (nv,)
        The velocity under forces alone, and the result.
    lower : ndarray, shape (n,)
        Of each contact the least normal rate, and the rates of the tangents at which it sticks.
    mu : ndarray, shape (m,)
        Coefficients of friction; of the dry friction of a joint minus its largest percussion [N s, N m s]: its normal
        and its second tangent are zero rows. Of a contact that is bounded by another, its length [m].
    bound : ndarray of int, shape (m,)
        The contact whose normal percussion bounds each, -1 where that is its own. Its normal is a zero row, and its
        tangents, of which the second may be zero, are relative angular velocities.
    known : int
        NOTHING, or what `start` holds: UNIQUE or COMPLIANT percussions.
    limit : float
        The residual that ends the iterations.
    start : ndarray, shape (n,)
        Percussions of a problem like this, those of compliant contacts unless unique; receives those of this one.
    table : ndarray, shape (3, n)
        Receives percussions, J x and J w.
    case : ndarray of int, shape (m,)
        Receives OPEN, STICK or SLIP.

    Returns
    -------
    residual : float
        `coulomb_defect` relative to the largest scaled speed, the largest of islands.
    unique : bool
        Whether rows are independent and friction acts little on normals, so that there is one answer.
    """
    n, nv = J.shape
    m = n // 3
    closing, cancelled = free_speeds(J, x, lower, mu, table)
    for k in range(nv):
        w[k] = x[k]
    if not closing:
        for a in range(m):
            case[a] = OPEN
        return 0.0, True
    owner, label, most, all_unique = np.empty(nv, np.int64), np.empty(m, np.int64), 0.0, True
    count = 1 if share_a_velocity(A) else label_contacts(J, A, bound, owner, label)
    if count == 1:
        return law_of_all(J, A, x, lower, mu, bound, known, limit, start, cancelled, w, table, case)
    for island in range(count):
        residual, unique = law_of_island(
            island, label, owner, J, A, x, lower, mu, bound, known, limit, start, w, table, case
        )
        # written so that a NaN stays
        most, all_unique = most if residual <= most else residual, all_unique and unique
    return most, all_unique

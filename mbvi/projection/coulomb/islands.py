"""Kernel that solves Coulomb's law for many contacts island by island; islands share no body."""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ..metric import Array
from ..sparse.sparse_islands import sort_by_island
from .law import bind
from .newton.directions import Delassus, without_rows
from .quick import MOST_NEWTON, quick_coulomb
from .rescue import proximal_newton, sweeps_and_newton
from .sweeps import accelerated_contacts, contacts_residual, proximal_contacts

# sweeps at most, first without and then with percussions held back
_SWEEPS, _PROXIMAL_SWEEPS = 500, 10_000
# multiplications of sweeps that hold percussions back, about two seconds, and how many sweeps there are at least
_WORK, _FEWEST_SWEEPS = 2e9, 200
# most contacts that Newton's method solves where sweeps do not: the cube of their number is 5e6, and it takes up to a
# thousand steps
_MOST_DENSE = 80
# Newton's method is tried on contacts that are new, and on those whose last percussions fit up to this residual, as at
# rest: the contacts of bodies that tumble are hard, and the accuracy of sweeps will do for them
_AT_REST = 3e-3
# the residual of exact solutions, relative to the largest velocity; and below that of which sweeps take longer
_EXACT, _FINE = 1e-10, 1e-5


@kernel("Delassus(f8[::1], u4[::1], u4[::1], i8[::1], i8)")
def delassus_of(blocks: Array, columns: Array, starts: Array, bound: Array, width: int) -> Delassus:
    """Return the matrix of packed contacts that have so many columns; see `sweeps.sweep_blocks`."""
    m, plain = len(bound), True
    G, W = np.empty((3 * m, 3 * m)), np.zeros((3 * m, width))
    for a in range(m):
        plain = plain and bound[a] < 0
        for k in range(starts[a], starts[a + 1]):
            for row in range(3):
                W[3 * a + row, columns[k]] = blocks[3 * k + row]
    for i in range(3 * m):
        for c in range(3 * m):
            product = 0.0
            for k in range(starts[c // 3], starts[c // 3 + 1]):
                product += blocks[3 * k + c % 3] * W[i, columns[k]]
            G[i, c] = product
    bind(bound, G)
    return Delassus(G, W, W, np.ones(m), 0.0) if plain else without_rows(G)


@kernel("f8(f8[::1], u4[::1], u4[::1], f8[:,::1], f8[::1], f8[::1], i8[::1], i8, f8, f8[::1], f8[::1])")
def solve_contacts(
    blocks: Array, columns: Array, starts: Array, local: Array, b: Array, mu: Array, bound: Array, known: int,
    target: float, z: Array, p: Array,
) -> float:  # fmt: skip
    """Bring `coulomb_defect` down to the target; return what was reached.

    Newton's method is tried first on contacts that are not too many, where the target is fine, or where all contacts
    are known or none is: contacts that stay the same have the sets of the last step, unlike those of bodies that
    tumble. Sweeps follow, and for few contacts the proximal form of Newton's method.

    Parameters
    ----------
    blocks, columns, starts, local, b, mu, bound, target, z, p
        See `coulomb_sweeps.accelerated_contacts`.
    known : int
        How many contacts were there in the last problem.
    """
    n, largest = len(b), 0.0
    for i in range(n):
        largest = max(largest, abs(b[i]))
    fine = target <= _FINE * largest
    attempted = len(mu) <= MOST_NEWTON and (fine or known == 0 or known == len(mu)) and _EXACT * largest <= target
    if attempted and known > 0 and not fine:
        attempted = contacts_residual(blocks, columns, starts, b, mu, bound, p, z, np.empty(n)) <= _AT_REST * largest
    if attempted:
        law = delassus_of(blocks, columns, starts, bound, len(z))
        if quick_coulomb(law, b, mu, _EXACT, p) <= _EXACT:
            return contacts_residual(blocks, columns, starts, b, mu, bound, p, z, np.empty(n))
    residual = accelerated_contacts(blocks, columns, starts, local, b, mu, bound, target, _SWEEPS, z, p)
    if residual > target:
        # each entry of a row is multiplied twice in a sweep
        most = min(max(int(_WORK / (2.0 * max(len(blocks), 1))), _FEWEST_SWEEPS), _PROXIMAL_SWEEPS)
        residual = proximal_contacts(blocks, columns, starts, local, b, mu, bound, target, most, z, p)
    if residual > target and len(mu) <= _MOST_DENSE:
        law = delassus_of(blocks, columns, starts, bound, len(z))
        residual = largest * proximal_newton(law, b, mu, 0.5 * target / largest, p)
        if residual > target:
            residual = largest * sweeps_and_newton(law, b, mu, 0.5 * target / largest, p)
    return residual


@kernel(
    "void(f8[::1], u4[::1], u4[::1], i8, f8[:,::1], f8[::1], f8[::1], i8[::1], b1[::1], i8[::1], i8, f8[::1], f8[::1])"
)
def solve_contact_islands(
    blocks: Array, columns: Array, starts: Array, n: int, local: Array, b: Array, mu: Array, bound: Array,
    known: Array, label: Array, count: int, targets: Array, p: Array,
) -> None:  # fmt: skip
    """Solve the contacts of each island by `solve_contacts`.

    Parameters
    ----------
    blocks, columns, starts, local, b, mu, bound
        See `coulomb_sweeps.sweep_blocks`; a contact and what bounds it are of one island.
    n : int
        Columns in all.
    known : ndarray of bool, shape (m,)
        Which contacts were there in the last problem.
    label : ndarray of int, shape (m,)
        The island of each contact; -1 of one that moves no body, and gets no percussion.
    count : int
        How many islands there are.
    targets : ndarray, shape (m,)
        The residual that is small enough at each contact; an island takes the least of its contacts.
    p : ndarray, shape (3 m,)
        Percussions to start from, which are written over.
    """
    m, entries_in_all = len(mu), len(columns)
    first, order, place_in_island = np.empty(count + 1, np.int64), np.empty(m, np.int64), np.empty(m, np.uint32)
    sort_by_island(label, first, order, place_in_island)
    if count == 1 and first[1] == m:
        many, target = 0, np.inf
        for a in range(m):
            many, target = many + known[a], min(target, targets[a])
        solve_contacts(blocks, columns, starts, local, b, mu, bound, many, target, np.empty(n), p)
        return
    own_blocks, own_columns = np.empty(3 * entries_in_all), np.empty(entries_in_all, np.uint32)
    own_starts, own_local, own_mu = np.empty(m + 1, np.uint32), np.empty((m, local.shape[1])), np.empty(m)
    own_bound = np.empty(m, np.int64)
    own_b, own_p, own_z, place = np.empty(3 * m), np.empty(3 * m), np.empty(n), np.full(n, -1)
    for a in range(m):
        if label[a] < 0:
            p[3 * a] = p[3 * a + 1] = p[3 * a + 2] = 0.0
    for island in range(count):
        begin, size, width, entries, many = first[island], first[island + 1] - first[island], 0, 0, 0
        own_starts[0], target = 0, np.inf
        for i in range(size):
            a = order[begin + i]
            many, target = many + known[a], min(target, targets[a])
            for k in range(starts[a], starts[a + 1]):
                if place[columns[k]] < 0:
                    place[columns[k]] = width
                    width += 1
                own_columns[entries] = place[columns[k]]
                for row in range(3):
                    own_blocks[3 * entries + row] = blocks[3 * k + row]
                entries += 1
            own_starts[i + 1], own_mu[i] = entries, mu[a]
            own_bound[i] = -1
            if bound[a] >= 0:
                # one that moves nothing has no percussion: as if the contact were bounded by itself
                own_bound[i] = place_in_island[bound[a]] if label[bound[a]] == island else i
            for row in range(3):
                own_b[3 * i + row], own_p[3 * i + row] = b[3 * a + row], p[3 * a + row]
            for k in range(local.shape[1]):
                own_local[i, k] = local[a, k]
        solve_contacts(
            own_blocks[: 3 * entries], own_columns[:entries], own_starts[: size + 1], own_local[:size],
            own_b[: 3 * size], own_mu[:size], own_bound[:size], many, target, own_z[:width], own_p[: 3 * size],
        )  # fmt: skip
        for i in range(size):
            for row in range(3):
                p[3 * order[begin + i] + row] = own_p[3 * i + row]

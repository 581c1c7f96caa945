"""Random arguments of the kernels of Coulomb's law over sparse rows: contacts between bodies, three rows each."""

import numpy as np
from scipy.sparse import csr_array

from mbvi.projection.sparse.contact_blocks import pack_contacts as pack


def contact_rows(rng, most=6):
    """Sparse rows of contacts between bodies of three or six velocities; some twice, or with a row left empty."""
    n, m = int(rng.integers(2, 5)), int(rng.integers(1, most + 1))
    rows = np.zeros((m, 3, 6 * n))
    for a in range(m):
        for body in rng.choice(n, size=2 if rng.random() < 0.8 else 1, replace=False):
            width = 6 if rng.random() < 0.7 else 3
            rows[a, :, 6 * body : 6 * body + width] = rng.normal(size=(3, width))
        if a and rng.random() < 0.1:
            rows[a] = rows[a - 1]
        if rng.random() < 0.2:
            # a sphere: the normal does not turn it, and its tangents resist alike
            rows[a] = 0.0
            rows[a, :, :3] = np.eye(3)
            rows[a, 1, 4], rows[a, 2, 3] = 1.5, -1.5
        if rng.random() < 0.1:
            rows[a, int(rng.integers(3))] = 0.0
    return csr_array(rows.reshape(3 * m, -1))


def room(U):
    """Arrays that `pack_contacts` writes to."""
    m = U.shape[0] // 3
    columns, starts = np.full(U.nnz, 99, np.uint32), np.full(m + 1, 99, np.uint32)
    return np.full(3 * U.nnz, np.nan), columns, starts, np.full((m, 7), np.nan)


def packed(U, bound=None):
    """What `pack_contacts` makes of sparse rows: blocks, columns, starts and local."""
    blocks, columns, starts, local = room(U)
    bound = np.full(len(starts) - 1, -1) if bound is None else bound
    rows = U.data, U.indices.astype(np.uint32), U.indptr.astype(np.uint32), U.shape[1]
    pack(*rows, bound, blocks, columns, starts, local)
    entries = int(starts[-1])
    return blocks[: 3 * entries].copy(), columns[:entries].copy(), starts, local


def matrix(blocks, columns, starts, n):
    """The rows of packed blocks, dense, shape (3 m, n)."""
    A = np.zeros((3 * (len(starts) - 1), n))
    for a in range(len(starts) - 1):
        here = slice(starts[a], starts[a + 1])
        A[3 * a : 3 * a + 3, columns[here]] = blocks.reshape(-1, 3)[here].T
    return A


def some_bounds(rng, U):
    """Which contact bounds each: the last one may be bounded by the first, whose bodies it turns."""
    m = U.shape[0] // 3
    bound = np.full(m, -1)
    if m > 1 and rng.random() < 0.4:
        bound[-1] = 0
        full = U.toarray()
        full[-3], full[-2:] = 0.0, full[1:3]
        if rng.random() < 0.5:
            full[-1] = 0.0
        U = csr_array(full)
    return U, bound


def state(rng):
    """Packed rows, how many columns they have, coefficients and bounds of friction, percussions in their cones."""
    U, bound = some_bounds(rng, contact_rows(rng))
    m = U.shape[0] // 3
    mu, p = rng.choice([0.0, 0.3, 0.9], size=m), rng.normal(size=(m, 3))
    p[:, 0] = np.abs(p[:, 0]) * (rng.random(m) < 0.7)
    p[:, 1:] *= (mu * p[:, 0] * rng.random(m) / np.linalg.norm(p[:, 1:], axis=1))[:, None]
    rows = packed(U, bound)
    # one that moves nothing has no friction
    mu = np.where(bound >= 0, np.where(rows[3][:, 6] > 0.0, 0.3, 0.0), mu)
    return rows, U.shape[1], (mu, bound), p.ravel()


def pack_contacts(rng):
    U, bound = some_bounds(rng, contact_rows(rng))
    return U.data, U.indices.astype(np.uint32), U.indptr.astype(np.uint32), U.shape[1], bound, *room(U)


def combine_contacts(rng):
    (*rows, _), n, _, p = state(rng)
    return *rows, p, np.full(n, np.nan)


def contacts_residual(rng):
    (*rows, _), n, law, p = state(rng)
    return *rows, rng.normal(size=len(p)), *law, p, np.full(n, np.nan), np.full(len(p), np.nan)


def sweep_blocks(rng):
    (*rows, local), n, law, p = state(rng)
    A = matrix(*rows, n)
    z, weight = A.T @ p, float(rng.choice([0.0, 0.5]))
    # no velocity along a tangent that is a zero row
    b = rng.normal(size=len(p)) * (A.any(axis=1) | np.repeat(law[1] < 0, 3))
    return *rows, local, b, *law, weight, rng.normal(size=len(p)), rng.normal(size=len(p)), z, p


def extrapolate_from(rng):
    return rng.random(), rng.normal(size=7), rng.normal(size=7)


def choose_part(rng):
    return rng.random(), rng.normal(), np.array([np.nan, rng.random(), rng.uniform(1.0, 9.0)])


def accelerated_contacts(rng):
    """Velocities that some velocity of the bodies has, so that there is an answer."""
    (*rows, local), n, law, p = state(rng)
    b = matrix(*rows, n) @ rng.normal(size=n)
    return *rows, local, b, *law, 1e-6, 20, np.full(n, np.nan), p


def delassus_of(rng):
    (*rows, _), n, (_, bound), _ = state(rng)
    return *rows, bound, n


def solve_contacts(rng):
    """All contacts are known, or some."""
    *rows, target, _, z, p = accelerated_contacts(rng)
    return *rows, len(rows[-2]) - int(rng.integers(2)), target, z, p


def solve_contact_islands(rng):
    """Contacts of one island, or the same twice, on other bodies, and one contact that moves none."""
    (blocks, columns, starts, local), n, (mu, bound), p = state(rng)
    b = matrix(blocks, columns, starts, n) @ rng.normal(size=n)

    def targets(contacts):
        return rng.choice([1e-3, 1e-6], size=len(contacts))

    if rng.random() < 0.3:
        label = np.zeros(len(mu), np.int64)
        known = np.full(len(mu), rng.random() < 0.5)
        return blocks, columns, starts, n, local, b, mu, bound, known, label, 1, targets(mu), p
    label = np.append(np.repeat([0, 1], len(mu)), -1)
    ends = np.concatenate([starts, starts[1:] + starts[-1], 2 * starts[-1:]]).astype(np.uint32)
    return (
        np.tile(blocks, 2), np.append(columns, columns + np.uint32(n)), ends, 2 * n,
        np.vstack([local, local, local[:1]]), np.concatenate([b, 0.5 * b, np.zeros(3)]), np.tile(mu, 3)[: len(label)],
        np.concatenate([bound, np.where(bound >= 0, bound + len(mu), -1), [-1]]),
        rng.random(len(label)) < 0.5, label, 2, targets(label), np.concatenate([p, p, np.ones(3)]),
    )  # fmt: skip


CONTACT_BLOCK_ARGUMENTS = {
    arguments.__name__: arguments
    for arguments in (
        pack_contacts,
        combine_contacts,
        contacts_residual,
        sweep_blocks,
        extrapolate_from,
        choose_part,
        accelerated_contacts,
        delassus_of,
        solve_contacts,
        solve_contact_islands,
    )
} | {"proximal_contacts": accelerated_contacts}

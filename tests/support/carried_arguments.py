"""Random arguments of the kernels of carried contacts: balls on a box that stands on a floor."""

import numpy as np

SEVERAL = -2


def balls_on_a_box(rng, balls=5, feet=2):
    """J, M^-1 J', x and mu: feet of the box first, then a ball at each contact; axes and masses are arbitrary.

    The first ball touches the box in two places.
    """
    bodies, m = 1 + balls, feet + balls + 1
    J = np.zeros((3 * m, 6 * bodies))
    for a in range(m):
        frame = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        arms = rng.normal(size=(2, 3))
        J[3 * a : 3 * a + 3, :6] = np.hstack([frame, np.cross(arms[0], frame)])
        if a >= feet:
            k = 6 + 6 * min(a - feet, balls - 1)
            J[3 * a : 3 * a + 3, k : k + 6] = -np.hstack([frame, np.cross(arms[1], frame)])
    inverse = np.repeat(rng.uniform(0.5, 2.0, size=2 * bodies), 3)
    inverse[:6] *= 0.1
    return J, J * inverse, rng.normal(size=6 * bodies), np.full(m, 0.6)


def listed(J, A):
    """What `list_columns` writes, by numpy."""
    m, nv = len(J) // 3, J.shape[1]
    acts = ((J != 0.0) | (A != 0.0)).reshape(m, 3, nv).any(axis=1)
    columns, counts = np.zeros((m, nv), np.int64), acts.sum(axis=1)
    for a in range(m):
        columns[a, : counts[a]] = np.flatnonzero(acts[a])
    several = acts.sum(axis=0)
    owner = np.where(several == 0, -1, np.where(several > 1, SEVERAL, acts.argmax(axis=0)))
    return columns, counts, owner


def scaled(rng):
    """J, A, their columns, mu, the scaled Delassus matrix, the scales, velocities b, and percussions that stick."""
    J, A, _, mu = balls_on_a_box(rng)
    scale = 1.0 / np.sqrt(np.vecdot(J, A)[::3])
    each = np.repeat(scale, 3)
    G = np.ascontiguousarray((J @ A.T) * each[:, None] * each)
    p = np.zeros((len(mu), 3))
    p[:, 0], p[:, 1] = 1.0, rng.uniform(0.0, 0.5, size=len(mu))
    # the first foot slips, and the last ball too
    p[[0, -1], 1] = 0.6
    b = G @ (-p.ravel() * rng.uniform(0.5, 1.0)) + 1e-2 * rng.normal(size=len(G))
    return J, A, *listed(J, A), mu, G, scale, b, p.ravel()


def parts(rng):
    """Random parts of rows, as `part_rows` writes them: 4 contacts are carried, k are not, s columns are shared."""
    held, k, s = 4, int(rng.integers(0, 3)), int(rng.integers(1, 6))
    U, R = rng.normal(size=(3 * held, s)), rng.normal(size=(3 * k, s))
    own, rest = rng.normal(size=(held, 3, 3)), rng.normal(size=(3 * k, 3 * k))
    return U, U.copy(), R, R.copy(), own @ own.transpose(0, 2, 1) + np.eye(3), rest @ rest.T


def room(held, k, s):
    return np.zeros((held, 3, 3)), np.zeros((s, s)), np.zeros(s), np.zeros((3 * k, 3 * k)), np.zeros(3 * k)


def list_columns(rng):
    J, A, *_ = balls_on_a_box(rng)
    m, nv = len(J) // 3, J.shape[1]
    return J, A, np.zeros((m, nv), np.int64), np.zeros(m, np.int64), np.zeros(nv, np.int64)


def diagonal_blocks(rng):
    J, A, columns, counts, _, _, G, scale, *_ = scaled(rng)
    if rng.random() < 0.3:
        J[3] = 0.0
    return J, A, columns, counts, np.zeros(G.shape), np.zeros(len(scale))


def invert(rng):
    matrix = rng.normal(size=(4, 4))
    if rng.random() < 0.3:
        matrix[1] = matrix[0]
    return matrix, 0.0, np.zeros((4, 4))


def choose_carried(rng):
    J, A, columns, counts, owner, mu, _, scale, _, p = scaled(rng)
    m = len(mu)
    return J, A, columns, counts, owner, mu, scale, p, np.zeros(m, np.int64), np.zeros((m, 3, 3))


def part_rows(rng):
    J, A, columns, counts, owner, mu, _, scale, *_ = scaled(rng)
    shared, s, held = np.where(owner == SEVERAL, np.cumsum(owner == SEVERAL) - 1, -1), int(np.sum(owner == SEVERAL)), 3
    place = np.array([*range(-1, -1 - (len(mu) - held), -1), *range(held)])
    rows = [np.zeros((3 * n, s)) for n in (held, held, len(mu) - held, len(mu) - held)]
    return J, A, columns, counts, shared, place, scale, *rows, np.zeros((3 * (len(mu) - held),) * 2)


def condense(rng):
    given = parts(rng)
    held, k, s = len(given[4]), len(given[2]) // 3, given[0].shape[1]
    return *given, 0.1 * rng.random(), rng.normal(size=3 * held), rng.normal(size=3 * k), *room(held, k, s)


def uncarried(rng):
    U, _, _, B, own, _ = parts(rng)
    held, k, s = len(own), len(B) // 3, U.shape[1]
    place = rng.permutation([*range(-k, 0), *range(held)])
    K, y, b, others = rng.normal(size=(s, s)), rng.normal(size=s), rng.normal(size=3 * held), rng.normal(size=3 * k)
    return U, B, own, K, y, b, place, others, np.zeros(3 * (held + k))


def solve_others(rng):
    given = parts(rng)
    held, k = len(given[4]), len(given[2]) // 3
    place, b = np.array([*range(-1, -1 - k, -1), *range(held)]), -np.tile([1.0, 0.0, 0.0], held + k)
    b += 0.1 * rng.normal(size=len(b))
    p = np.tile([1.0, 0.0, 0.0], held + k)
    return *given, b, np.full(held + k, 0.6), place, rng.random() < 0.5, 1e-12, p, p.copy()


def solve_carried(rng):
    J, A, columns, counts, owner, mu, G, scale, b, p = scaled(rng)
    return J, A, G, scale, b, mu, owner, columns, counts, rng.random() < 0.5, 1e-12, p, p.copy()


def carried_law(rng):
    J, A, _, _, _, mu, _, scale, b, p = scaled(rng)
    n, nv = J.shape
    x = np.linalg.lstsq(J, b / np.repeat(scale, 3), rcond=None)[0]
    table = np.zeros((3, n))
    table[1] = J @ x
    start, bound = p * np.repeat(scale, 3), np.full(len(mu), -1)
    own = np.zeros((n, n)), np.zeros(len(mu)), *(np.zeros(n) for _ in range(4)), np.zeros(nv), table
    return J, A, x, np.zeros(n), mu, bound, int(rng.integers(1, 3)), 1e-12, start, 1.0, *own


CARRIED_ARGUMENTS = {
    arguments.__name__: arguments
    for arguments in (
        list_columns,
        diagonal_blocks,
        invert,
        choose_carried,
        part_rows,
        condense,
        uncarried,
        solve_others,
        solve_carried,
        carried_law,
    )
}

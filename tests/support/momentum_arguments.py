"""Random arguments of kernels that keep momentum: a robot's velocities, then boxes and links, then balls."""

import numpy as np

from mbvi.system.free.free_body_table import FreeBodyTable

LEGS = 3


def bodies_at(rng):
    """A table of bodies, with a configuration and a velocity."""
    boxes, balls = int(rng.integers(0, 4)), int(rng.integers(1, 3))
    n, mass = boxes + balls, rng.uniform(0.5, 2.0, boxes + balls)
    inertia, inverse = np.zeros((2, n, 3, 3))
    turns = np.arange(n) < boxes
    for k in range(boxes):
        A = rng.normal(size=(3, 3))
        inertia[k] = A @ A.T + np.eye(3)
        inverse[k] = np.linalg.inv(inertia[k])
    sizes = np.where(turns, 7, 3), np.where(turns, 6, 3)
    q, v = (LEGS + np.concatenate([[0], np.cumsum(size)[:-1]]) for size in sizes)
    owner = np.concatenate([np.full(LEGS, -1), np.repeat(np.arange(n), sizes[1])])
    turning = turns & (rng.random(n) < 0.5)
    centre = np.where(turning[:, None], rng.normal(size=(n, 3)), 0.0)
    table = FreeBodyTable(q, v, mass, inertia, inverse, turns, owner, turning, centre)
    return table, configuration(rng, table), rng.normal(size=len(owner))


def configuration(rng, table, near=None):
    q = rng.normal(size=LEGS + int(np.where(table.turns, 7, 3).sum()))
    if near is not None:
        q = near + 1e-3 * q
    for i in table.q[table.turns] + 3:
        q[i : i + 4] /= np.linalg.norm(q[i : i + 4])
    return q


def rows_of(rng, table):
    """Gradients of contacts: of two bodies, of a body and the world, of a body and the robot, of none."""
    n, nv, rows = len(table.mass), len(table.owner), []
    for _ in range(int(rng.integers(0, 5))):
        row, normal, kind = np.zeros(nv), rng.normal(size=3), rng.integers(0, 4)
        for b, sign in zip(rng.permutation(n)[:2] if kind != 1 else rng.integers(0, n, 1), (1.0, -1.0), strict=False):
            row[table.v[b] : table.v[b] + 3] = sign * normal
            if table.turns[b]:
                row[table.v[b] + 3 : table.v[b] + 6] = rng.normal(size=3)
        row[:LEGS] = rng.normal(size=LEGS) if kind == 2 else 0.0
        rows.append(row if kind else 0.0 * row)
    return np.array(rows).reshape(-1, nv)


def as_sparse(J):
    m, n = J.shape
    columns = np.tile(np.arange(n, dtype=np.int32), m)
    return J.ravel(), columns, n * np.arange(m + 1, dtype=np.int32)


def groups(rng, n):
    """A representative of each body, the first of its group, and which groups are loose."""
    group = np.array([rng.integers(0, k + 1) for k in range(n)])
    for k in range(n):
        group[k] = group[group[k]]
    return group, rng.random(n) < 0.7


def write_rotation(rng):
    _, q, _ = bodies_at(rng)
    return np.concatenate([q, [0.0, 0.6, 0.0, 0.8]]), len(q), np.full((3, 3), np.nan)


def add_spin(rng):
    table, q, v = bodies_at(rng)
    return table, int(rng.integers(len(table.mass))), q, v, rng.normal(), rng.normal(size=3)


def set_spin(rng):
    table, q, v = bodies_at(rng)
    if not table.turns.any():
        return set_spin(rng)
    return table, 0, q, rng.normal(size=3), v


def solve_symmetric(rng):
    A = rng.normal(size=(3, int(rng.integers(1, 4))))
    A = A @ A.T
    return A, A @ rng.normal(size=3)


def root_of(rng):
    n = int(rng.integers(1, 9))
    return np.array([rng.integers(0, k + 1) for k in range(n)]), int(rng.integers(n))


def write_groups(rng):
    table, q, _ = bodies_at(rng)
    n = len(table.mass)
    return table, *as_sparse(rows_of(rng, table)), q, np.full(n, -1), np.zeros(n, bool)


def write_centre(rng):
    table, q, _ = bodies_at(rng)
    return table, int(rng.integers(len(table.mass))), q, np.full(3, np.nan)


def add_velocity(rng):
    return add_spin(rng)


def set_velocity(rng):
    table, q, v = bodies_at(rng)
    return table, int(rng.integers(len(table.mass))), q, rng.normal(size=3), v


def put_back_centres(rng):
    table, q, _ = bodies_at(rng)
    n = len(table.mass)
    return table, *groups(rng, n), rng.normal(size=(n, 3)), q


def write_centres(rng):
    table, q, _ = bodies_at(rng)
    n = len(table.mass)
    return table, groups(rng, n)[0], q, np.full((n, 3), np.nan)


def add_angular_momenta(rng):
    table, q, v = bodies_at(rng)
    n = len(table.mass)
    return table, groups(rng, n)[0], rng.normal(size=(n, 3)), q, v, rng.normal(), rng.normal(size=(n, 3))


def write_inertias(rng):
    table, q, _ = bodies_at(rng)
    n = len(table.mass)
    return table, groups(rng, n)[0], rng.normal(size=(n, 3)), q, np.full((n, 3, 3), np.nan)


def turn_groups(rng):
    table, q, v = bodies_at(rng)
    n, place = len(table.mass), bool(rng.random() < 0.5)
    vectors = rng.normal(size=(2, n, 3))
    return table, *groups(rng, n), *vectors, q, q.copy() if place else v, place


def displaced(rng):
    """A table with rows, a configuration and velocity before a displacement, another one, and both after it."""
    table, q, v = bodies_at(rng)
    place, after = (configuration(rng, table, q) for _ in range(2))
    return table, rows_of(rng, table), q, v, place, after, v + 0.1 * rng.normal(size=len(v))


def keep_momentum(rng):
    table, J, *others = displaced(rng)
    return table, *as_sparse(J), *others


def add_wrenches(rng):
    """Contacts without friction, with it, and with that of rotations; some constraints have no normal."""
    k, kind = int(rng.integers(1, 5)), int(rng.integers(0, 3))
    point, normal = rng.normal(size=(2, k, 3))
    normal[rng.random(k) < 0.2] = np.nan
    slip, turn = rng.normal(size=2 * k if kind else 0), rng.normal(size=3 * k if kind == 2 else 0)
    axes, wrench = rng.normal(size=(k, 2, 3)), rng.normal(size=(k, 6))
    return point, normal, axes, rng.random(k), slip, turn, rng.normal(), wrench


def _normals(rng, J):
    normal = rng.normal(size=(len(J), 3))
    normal[rng.random(len(J)) < 0.1] = np.nan
    return normal


def write_ends(rng):
    table, q, _ = bodies_at(rng)
    J, n = rows_of(rng, table), len(table.mass)
    ends, sign = np.zeros((len(J), 2), int), np.zeros((len(J), 2))
    return table, *as_sparse(J), _normals(rng, J), q, ends, sign, np.zeros(n, bool), np.zeros(n, bool)


def write_full_rows(rng):
    m, n = rng.integers(0, 5, 2)
    return np.zeros(m * n, np.int32), np.zeros(m + 1, np.int32)


def add_momenta(rng):
    table, q, v = bodies_at(rng)
    return table, q, v, rng.normal(), rng.normal(size=(len(table.mass), 6))


def add_displaced_of_rows(rng):
    table, J, before, w, place, q, v = displaced(rng)
    return table, J, _normals(rng, J), place, before, w, q, v, *rng.normal(size=(2, len(J), 6))


def add_displaced(rng):
    table, J, *others = add_displaced_of_rows(rng)
    return table, *as_sparse(J), *others


MOMENTUM_ARGUMENTS = {
    kernel.__name__: kernel
    for kernel in (
        write_rotation,
        add_spin,
        set_spin,
        solve_symmetric,
        root_of,
        write_groups,
        write_centres,
        write_centre,
        add_velocity,
        set_velocity,
        put_back_centres,
        add_angular_momenta,
        write_inertias,
        turn_groups,
        keep_momentum,
        add_wrenches,
        write_ends,
        add_momenta,
        write_full_rows,
        add_displaced,
        add_displaced_of_rows,
    )
}
MOMENTUM_ARGUMENTS["keep_momentum_of_rows"] = displaced

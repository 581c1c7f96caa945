"""Random arguments of the kernels of Coulomb's law: a few contacts, some of whose rows depend on others."""

import numpy as np

from mbvi.projection.coulomb.newton.directions import Delassus


def alone(G):
    """A matrix without the rows that it is made of."""
    return Delassus(G, np.zeros((0, 0)), np.zeros((0, 0)), np.zeros(0), 0.0)


def crowd(rng):
    """Many contacts on few velocities, compliant: the matrix with its rows, b, mu, percussions in the cones, cases."""
    m, nv, compliance = int(rng.integers(4, 8)), int(rng.integers(3, 7)), float(rng.choice([1e-4, 1e-2]))
    J, mu = rng.normal(size=(3 * m, nv)), rng.choice([0.0, 0.2, 0.8], size=m)
    for a in range(m):
        # not all velocities
        J[3 * a : 3 * a + 3, rng.random(nv) < 0.3] = 0.0
        J[3 * a : 3 * a + 3, a % nv] = rng.normal(size=3)
    if rng.random() < 0.4:
        mu[-1], J[-3], J[-1] = -0.4, 0.0, 0.0
    root = rng.normal(size=(nv, nv))
    A = J @ (root @ root.T + np.eye(nv))
    scale = 1.0 / np.sqrt(np.diagonal(J @ A.T)[np.where(mu < 0.0, 3 * np.arange(m) + 1, 3 * np.arange(m))])
    each = np.repeat(scale, 3)
    G, b = (J @ A.T) * each[:, None] * each, each * (J @ rng.normal(size=nv))
    if mu[-1] < 0.0:
        G[-3, -3], b[-3] = 1.0, -0.7
    G += compliance * np.eye(3 * m)
    p = in_cone(rng, mu)
    if mu[-1] < 0.0:
        p[-1] = 0.0
    law = Delassus(np.ascontiguousarray(G), J, np.ascontiguousarray(A), scale, compliance)
    return law, b, mu, p, rng.integers(0, 3, size=m)


def direction(rng):
    """Arguments of `newton_direction`: percussions, velocities and errors of cases that are those of the velocities."""
    law, b, mu, p, case = crowd(rng)
    n = len(p)
    room = np.full((n, n), np.nan), np.full(n, np.nan), np.zeros(n, np.int64), np.full(n, np.nan)
    scale = rng.uniform(0.2, 1.0, size=len(mu))
    return law, law.G @ p + b, p, mu, scale, rng.normal(size=n), case, 1e-3, *room


def takes_fewer_velocities(rng):
    law, *_, case = crowd(rng)
    return law, case, int(rng.integers(1, 3 * len(case)))


def tangential_rates(rng):
    _, u, p, mu, scale, _, case, *_ = direction(rng)
    a = int(rng.integers(len(mu) - 1))
    return u, p, mu[a], scale[a], int(case[a]), 3 * a


def eliminate_contact(rng):
    _, u, p, mu, scale, error, case, *_ = direction(rng)
    a = int(rng.integers(len(mu)))
    return u, p, mu, scale, error, case, 1e-2, a, np.full((3, 3), np.nan), rng.normal(size=len(p))


def add_contact(rng):
    law, *_ = crowd(rng)
    nv = law.J.shape[1]
    i = 3 * int(rng.integers(len(law.scale)))
    runs, product = np.zeros((nv, 2), np.int64), np.zeros((3, nv))
    return law.J, law.A, i, 0.7, rng.normal(size=(3, 3)), runs, product, rng.normal(size=(nv, nv))


def direction_by_velocities(rng):
    law, u, p, mu, scale, error, case, *_ = direction(rng)
    step = np.where(np.repeat((case == 0) | (mu < 0.0), 3), -p, 0.0)
    for a in np.flatnonzero((mu == 0.0) & (case != 0)):
        step[3 * a + 1 : 3 * a + 3] = -p[3 * a + 1 : 3 * a + 3]
    return law, u, p, mu, scale, error, case, 1e-3 + law.compliance, step


def without_rows(rng):
    return (law(rng)[0],)


def soften(rng):
    return crowd(rng)[0], rng.random()


def law(rng, most=3):
    """G, b and mu of a few contacts, scaled to unit normal entries."""
    m, nv = int(rng.integers(1, most + 1)), int(rng.integers(4, 9))
    J = rng.normal(size=(3 * m, nv))
    if m > 1 and rng.random() < 0.3:
        # the same contact twice
        J[3:6] = J[:3]
    G, b = J @ J.T, J @ rng.normal(size=nv)
    scale = np.repeat(1.0 / np.sqrt(np.diagonal(G)[::3]), 3)
    G, b, mu = np.ascontiguousarray(G * scale[:, None] * scale), b * scale, rng.choice([0.0, 0.2, 0.8], size=m)
    if rng.random() < 0.4:
        make_joint_friction(G, b, mu, m - 1)
    elif m > 1 and rng.random() < 0.4:
        make_rolling_friction(G, b, mu, m - 1)
    return G, b, mu


def make_joint_friction(G, b, mu, a):
    """Make the dry friction of a joint of a contact."""
    for i in (3 * a, 3 * a + 2):
        G[i], G[:, i], b[i] = 0.0, 0.0, 0.0
    G[3 * a, 3 * a], b[3 * a], mu[a] = 1.0, -0.7, -1.5


def make_rolling_friction(G, b, mu, a):
    """Make the rolling friction of the first contact of another one."""
    i = 3 * a
    G[i], G[:, i], b[i], mu[a] = 0.0, 0.0, 0.0, 0.3
    G[i, i], G[i, 0] = 1.0, -1.0


def in_cone(rng, mu):
    p = rng.normal(size=(len(mu), 3))
    p[:, 0] = np.abs(p[:, 0])
    p[:, 1:] *= (np.abs(mu) * p[:, 0] * rng.random(len(mu)) / np.linalg.norm(p[:, 1:], axis=1))[:, None]
    return p.ravel()


def state(rng):
    """A law, percussions in the cones, velocities, scales of tangents, cases, and room for the errors."""
    G, b, mu = law(rng)
    p = in_cone(rng, mu)
    return G, b, mu, p, G @ p + b, rng.uniform(0.2, 1.0, size=len(mu)), rng.integers(0, 3, size=len(mu))


def coulomb_defect(rng):
    _, _, mu, p, u, *_ = state(rng)
    return u, p, mu


def contact_velocities(rng):
    G, b, _, p, *_ = state(rng)
    return G, b, p, np.full(len(b), np.nan)


def find_slip(rng):
    first, bn = rng.uniform(0.5, 2.0), -rng.uniform(0.1, 1.0)
    table = np.array([5.0 * rng.normal(size=2), 0.1 * rng.normal(size=2), [np.nan, np.nan]])
    return first, first * rng.random(), bn, 0.3, table


def solve_contact(rng):
    G, b, mu = law(rng)
    a = int(rng.integers(len(mu)))
    return G, a, *b[3 * a : 3 * a + 3], mu[a], np.full(3, np.nan)


def closing_order(rng):
    m = int(rng.integers(1, 6))
    # some close equally fast
    return np.round(rng.normal(size=3 * m)), np.zeros(m, np.int64)


def sweep_contacts(rng):
    G, b, mu, p, *_ = state(rng)
    return G, b, mu, rng.permutation(len(mu)), 20, 1e-9, p


def tangential_scale(rng):
    G, _, mu = law(rng)
    return G, np.full(len(mu), np.nan)


def find_cases(rng):
    *_, mu, p, u, scale, case = state(rng)
    return u, p, mu, scale, case


def case_error(rng):
    *_, mu, p, u, scale, case = state(rng)
    return u, p, mu, scale, case, np.full(len(p), np.nan)


def solve_linear(rng):
    n = int(rng.integers(1, 6))
    A = rng.normal(size=(n + 1, n + 1))
    if rng.random() < 0.3:
        A[:n, 0] = 0.0
    return A, rng.normal(size=n + 1), n


def newton_direction(rng):
    if rng.random() < 0.5:
        return direction(rng)
    G, _, mu, p, u, scale, case = state(rng)
    n = len(p)
    room = np.full((n, n), np.nan), np.full(n, np.nan), np.zeros(n, np.int64), np.full(n, np.nan)
    return alone(G), u, p, mu, scale, rng.normal(size=n), case, 1e-3, *room


def newton_coulomb(rng):
    G, b, mu, p, *_ = state(rng)
    return alone(G), b, mu, 3, 1e-12, 1e-3, 2, p


def hold_cases(rng):
    G, b, mu, p, _, _, case = state(rng)
    return alone(G), b, mu, case, 2, 1e-12, 1e-3, p


def resume_newton(rng):
    G, b, mu, p, *_ = state(rng)
    for a in range(len(mu)):
        # dependent rows without a shift end in rounding
        G[3 * a : 3 * a + 3, 3 * a : 3 * a + 3] += 0.1 * np.eye(3)
    return alone(G), b, mu, 2, 1e-12, p


def attempt(rng):
    G, b, mu = law(rng, 2)
    return alone(G), b, mu, 1e-10, np.zeros(len(b))


def regular(rng):
    """A law whose rows are independent."""
    G, b, mu = law(rng, 2)
    return np.ascontiguousarray(G + 0.1 * np.eye(len(b))), b, mu


def solve_compliant(rng):
    G, b, mu = regular(rng)
    return alone(G), b, mu, rng.random() < 0.5, np.zeros(len(b)), np.zeros(len(mu), np.int64)


def solve_coulomb(rng):
    G, b, mu = regular(rng)
    return alone(G), b, mu, 1e-10, True, rng.random() < 0.5, np.zeros(len(b)), np.zeros(len(b))


def solve_softened(rng):
    G, b, mu = regular(rng)
    given = mu, 1e-10, True, rng.random() < 0.5, np.zeros(len(b)), np.zeros(len(b))
    compliant = alone(np.ascontiguousarray(G + 1e-3 * np.eye(len(b))))
    return alone(G), b, compliant, b + 1e-3 * rng.normal(size=len(b)), *given


def couples_weakly(rng):
    G, _, mu = law(rng)
    return G, mu


def independent_rows(rng):
    G, _, mu = law(rng)
    return G, mu, bounds(rng, mu)


def keep_better(rng):
    return rng.normal(size=4), rng.random(), rng.random(), rng.normal(size=4)


def rows(rng):
    """Contacts whose rows are independent, one of them perhaps of nothing that moves: J and M^-1 J'."""
    m, nv = int(rng.integers(1, 3)), int(rng.integers(6, 9))
    J, B = rng.normal(size=(3 * m, nv)), rng.normal(size=(nv, nv))
    if m > 1 and rng.random() < 0.3:
        J[:3] = 0.0
    return J, np.ascontiguousarray(np.linalg.solve(B @ B.T + np.eye(nv), J.T).T)


def some_joints(rng, J, A):
    """Coefficients of contacts, the last of which may be the dry friction of a joint."""
    mu = rng.choice([0.0, 0.2, 0.8], size=len(J) // 3)
    if rng.random() < 0.5:
        for rows_of in (J, A):
            rows_of[-3], rows_of[-1] = 0.0, 0.0
        mu[-1] = -0.3
    return mu


def bounds(rng, mu):
    """Which contact bounds each: the last one may be bounded by the first, unless it is the friction of a joint."""
    bound = np.full(len(mu), -1)
    if len(mu) > 1 and mu[-1] >= 0.0 and rng.random() < 0.5:
        bound[-1] = 0
    return bound


def some_bounds(rng, J, A, mu):
    """As `bounds`; the rows become those of rolling friction, or of torsional friction."""
    bound = bounds(rng, mu)
    if bound[-1] >= 0:
        for rows_of in (J, A):
            rows_of[-3] = 0.0
        if rng.random() < 0.5:
            for rows_of in (J, A):
                rows_of[-1] = 0.0
        mu[-1] = 0.3
    return bound


def bind(rng):
    G, _, mu = law(rng)
    return bounds(rng, mu), G


def delassus(rng):
    J, A = rows(rng)
    mu = some_joints(rng, J, A)
    bound = some_bounds(rng, J, A, mu)
    return J, A, mu, bound, np.full((len(J), len(J)), np.nan), np.full(len(J) // 3, np.nan)


def apply_percussions(rng):
    J, A = rows(rng)
    (n, nv), m = J.shape, len(J) // 3
    mu = some_joints(rng, J, A)
    bound = some_bounds(rng, J, A, mu)
    moved = rng.normal(size=nv), rng.normal(size=n), mu, bound, rng.uniform(0.5, 2.0, size=m), in_cone(rng, mu)
    return J, A, *moved, np.full(n, np.nan), np.full(nv, np.nan), np.zeros((3, n))


def clip_to_cones(rng):
    m = int(rng.integers(1, 5))
    return rng.choice([0.0, 0.2, 0.8], size=m), rng.normal(size=3 * m)


def free_speeds(rng):
    J, A = rows(rng)
    n, nv = J.shape
    mu = some_joints(rng, J, A)
    return J, rng.normal(size=nv), rng.normal(size=n), mu, np.full((3, n), np.nan)


def scale_cones(rng):
    scale, mu = rng.choice([0.0, 0.5, 2.0], size=4), rng.choice([-0.3, 0.2, 0.0], size=4)
    return mu, bounds(rng, mu), scale, rng.random(), rng.normal(size=12), np.full(4, np.nan)


def set_bounds(rng):
    mu = rng.choice([-0.3, 0.2, 0.0], size=4)
    return mu, bounds(rng, mu), rng.normal(size=12), rng.normal(size=12)


def acts(rng):
    mu = rng.choice([-0.3, 0.2, 0.0], size=4)
    return mu, bounds(rng, mu), int(rng.integers(12))


def scale_speeds(rng):
    n = 6
    scale = rng.choice([0.0, 0.5, 2.0], size=n // 3)
    limit = float(rng.choice([1e-12, 1e-6]))
    return rng.normal(size=(3, n)), rng.normal(size=n), scale, rng.random(), limit, np.full(n, np.nan)


def solve_scaled(rng):
    G, b, mu = regular(rng)
    soft = rng.random() * np.linalg.norm(b) * in_cone(rng, np.maximum(mu, 1e-3))
    return alone(G), b, mu, np.full(len(mu), -1), int(rng.integers(3)), 1e-12, soft, soft.copy()


def coulomb_law(rng):
    J, A = rows(rng)
    (n, nv), m = J.shape, len(J) // 3
    mu = some_joints(rng, J, A)
    bound, lower = some_bounds(rng, J, A, mu), -rng.random(n)
    lower[3 * np.flatnonzero(bound >= 0)] = 0.0
    given = rng.normal(size=nv), lower, mu, bound, int(rng.integers(3)), 1e-12
    return J, A, *given, np.zeros(n), np.full(nv, np.nan), np.full((3, n), np.nan), np.zeros(m, np.int64)


def law_of_all(rng):
    *given, w, table, case = coulomb_law(rng)
    J, _, x, lower, mu, *_ = given
    w[:], cancelled = x, free_speeds_of(J, x, lower, mu, table)
    return *given, cancelled, w, table, case


def free_speeds_of(J, x, lower, mu, table):
    """Write percussions of zero and J x twice; return the largest sum of terms of a row."""
    table[0], table[1:] = 0.0, J @ x
    return float((np.abs(J) @ np.abs(x)).max())


def parted(rng):
    """Arguments of `coulomb_law` whose contacts are two islands."""
    J, A, x, lower, mu, bound, known, limit, start, w, table, case = coulomb_law(rng)
    (n, nv), m = J.shape, len(mu)
    both = [np.block([[rows, np.zeros((n, nv))], [np.zeros((n, nv)), rows]]) for rows in (J, A)]
    bounds = np.concatenate([bound, np.where(bound >= 0, bound + m, -1)])
    twice = [np.tile(values, 2) for values in (x, lower, mu)]
    w, table = np.tile(x, 2), np.full((3, 2 * n), np.nan)
    return *both, *twice, bounds, known, limit, np.tile(start, 2), w, table, np.tile(case, 2)


def label_contacts(rng):
    J, A, x, _, mu, bound, *_ = parted(rng)
    return J, A, bound, np.zeros(len(x), np.int64), np.zeros(len(mu), np.int64)


def share_a_velocity(rng):
    A = rows(rng)[1]
    A[3 * rng.integers(len(A) // 3) :, : rng.integers(A.shape[1])] = 0.0
    return (A,)


def law_of_island(rng):
    given = parted(rng)
    m, nv = len(given[4]) // 2, len(given[2]) // 2
    return int(rng.integers(2)), np.repeat([0, 1], m), np.repeat([0, m], nv), *given


def newton_in_rounds(rng):
    G, b, mu, limit, p = attempt(rng)
    return G, b, mu, limit, int(rng.integers(5)), p


def interleave(rng):
    m, nv = int(rng.integers(0, 4)), int(rng.integers(1, 6))
    return rng.normal(size=(m, nv)), rng.normal(size=(2 * m, nv)), np.full((3 * m, nv), np.nan)


def row_speeds(rng):
    """The first of some rows."""
    rows, count = rng.normal(size=(9, 5)), int(rng.integers(0, 10))
    return rows, rng.normal(size=5), float(rng.choice([1.0, 1e-3])), np.full(count, np.nan)


def write_closing_speeds(rng):
    """Some of the gaps and the tolerance are equal."""
    k = 5
    gap = rng.choice([-1e-9, 0.0, 1e-9, 1e-6], size=k)
    return gap, rng.choice([1.0, 0.3], size=k), rng.choice([0.0, 1e-7], size=k), 1e-3, 1e-9, np.full(k, np.nan)


def hold_rigid(rng):
    G, b, mu, p, _, _, case = state(rng)
    return alone(G), b, mu, case, rng.random() < 0.5, 1e-10, p


def hold_as_compliant(rng):
    G, b, mu, p, *_ = state(rng)
    return alone(G), soften_of(alone(G)), b, mu, rng.random() < 0.5, 1e-10, p


def soften_of(law):
    return law._replace(G=law.G + 1e-2 * np.eye(len(law.G)), compliance=1e-2)


def stiffen(rng):
    law, b, mu, limit, p = attempt(rng)
    return law, b, mu, False, rng.random() < 0.5, 1e-2, limit, p


def improve_coulomb(rng):
    G, b, mu, limit, p = attempt(rng)
    return G, b, mu, False, 1.0, limit, p.copy(), p


COULOMB_ARGUMENTS = {
    arguments.__name__: arguments
    for arguments in (
        coulomb_defect,
        contact_velocities,
        find_slip,
        solve_contact,
        closing_order,
        sweep_contacts,
        tangential_scale,
        find_cases,
        case_error,
        solve_linear,
        tangential_rates,
        eliminate_contact,
        add_contact,
        takes_fewer_velocities,
        direction_by_velocities,
        without_rows,
        soften,
        newton_direction,
        newton_coulomb,
        hold_cases,
        resume_newton,
        hold_rigid,
        hold_as_compliant,
        stiffen,
        improve_coulomb,
        solve_compliant,
        solve_coulomb,
        solve_softened,
        couples_weakly,
        independent_rows,
        keep_better,
        bind,
        delassus,
        apply_percussions,
        clip_to_cones,
        scale_cones,
        set_bounds,
        acts,
        free_speeds,
        scale_speeds,
        solve_scaled,
        coulomb_law,
        law_of_all,
        share_a_velocity,
        label_contacts,
        law_of_island,
        newton_in_rounds,
        interleave,
        row_speeds,
        write_closing_speeds,
    )
} | dict.fromkeys(("proximal_newton", "sweeps_and_newton", "quick_coulomb"), attempt)

"""Realistic random arguments of every kernel, and what of its answers can be compared with those of its plain form."""

import copy

import numpy as np
import pinocchio as pin
from scipy.sparse import block_array, csr_array

from mbvi.constraints import HalfSpaceContacts
from mbvi.constraints.families import sphere_walls
from mbvi.constraints.families.half_space import points_within
from mbvi.geometry.broad.separating_axis import SeparatingAxes
from mbvi.geometry.meshes import triangles
from mbvi.geometry.narrow.spread import FEW_POINTS
from mbvi.geometry.shapes.seams import seams_of
from mbvi.geometry.shapes.shape_table import ShapeTable
from mbvi.geometry.shapes.shapes import Box, Capsule, Cylinder, Ellipsoid, HalfSpace, Hull, PlacedShape, Sphere
from support.address_arguments import ADDRESS_ARGUMENTS, results_by_address
from support.carried_arguments import CARRIED_ARGUMENTS
from support.closed_form_arguments import CLOSED_FORM_ARGUMENTS
from support.contact_block_arguments import CONTACT_BLOCK_ARGUMENTS
from support.control_arguments import CONTROL_ARGUMENTS
from support.coulomb_arguments import COULOMB_ARGUMENTS
from support.distance_kernel_arguments import DISTANCE_ARGUMENTS
from support.equality_arguments import EQUALITY_ARGUMENTS
from support.held_arguments import HELD_ARGUMENTS
from support.held_row_arguments import HELD_ROW_ARGUMENTS
from support.joint_tree_arguments import JOINT_TREE_ARGUMENTS
from support.loop_arguments import LOOP_ARGUMENTS, arrays_of
from support.momentum_arguments import MOMENTUM_ARGUMENTS
from support.patch_kernel_arguments import PATCH_ARGUMENTS, WHEEL, walls_of
from support.plain.gram import islands_plain
from support.plain.incomplete_cholesky import incomplete_cholesky_plain
from support.plain.refinement import solve_island_plain
from support.plain.support_points import stand_plain
from support.robot_arguments import cone, contact_rows, moving_robot, restitution, rotation, unit
from support.settle_arguments import SETTLE_ARGUMENTS
from support.spin_arguments import SPIN_ARGUMENTS
from support.surface_arguments import SURFACE_ARGUMENTS

SEEDS = range(20)
SHAPES = [
    Sphere(0.2),
    Box((0.3, 0.4, 0.2)),
    Ellipsoid((0.3, 0.2, 0.1)),
    Capsule(0.1, 0.4),
    Cylinder(0.15, 0.3),
    Hull(0.3 * np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], dtype=float)),
]
# random but realistic arguments


def place(rng):
    return np.array([*rotation(rng), rng.normal(size=3)])


def placed_on(rng, bodies, shapes=SHAPES):
    """Every shape once, on random bodies."""
    return [
        PlacedShape(f"s{k}", shape, int(rng.choice(bodies)), rotation(rng), 0.2 * rng.normal(size=3))
        for k, shape in enumerate(shapes)
    ]


def percussions_before(rng, m):
    """What settled the last step: nothing, as many rows, or another number of rows."""
    return rng.choice([0.0, 1.0], size=int(rng.choice([0, m, m + 1]))) * rng.random()


def forces(rng, system, q, v):
    """Mass matrix, damping, tree, velocity, step, torques, nonlinear effects and the order of damping."""
    system.metric(q)
    mass = np.array(system.evaluation.mass)
    effects = np.array(pin.nonLinearEffects(system.model, system.model.createData(), q, v))
    damping = system.damping * rng.choice([0.0, 1.0])
    return (
        mass,
        damping,
        system.evaluation.parent,
        v,
        1e-3,
        rng.normal(size=system.nv),
        effects,
        bool(rng.random() < 0.5),
    )


def factor_of(rng):
    system, q, _ = moving_robot(rng)
    return system, np.array(system.metric(q).lower)


def indefinite(rng, mass):
    """Now and then a mass matrix that is none."""
    mass = np.array(mass)
    if rng.random() < 0.3:
        k = rng.integers(len(mass))
        mass[k, k] = rng.choice([-1.0, 0.0])
    return mass


def factor(rng):
    system, _, _ = moving_robot(rng)
    n = system.nv
    return (
        indefinite(rng, system.evaluation.mass),
        1e-3,
        system.damping,
        system.evaluation.parent,
        np.full((n, n), np.nan),
    )


def back(rng):
    system, L = factor_of(rng)
    # a gradient is zero for most joints
    return L, system.evaluation.parent, rng.normal(size=system.nv) * (rng.random(system.nv) < 0.5)


def unwhiten_four(rng):
    """Rows of which some move a few joints only."""
    L, parent, x = whiten_four(rng)
    return L, parent, np.zeros(len(parent), bool), x


def whiten_four(rng):
    """Rows of which some touch a few joints only."""
    system, L = factor_of(rng)
    x = rng.normal(size=(4, system.nv))
    x[:, rng.random(x.shape[1]) < 0.3] = 0.0
    return L, system.evaluation.parent, x


def squared(rng):
    return (rng.normal(size=int(rng.integers(0, 12))),)


def remove_parts(rng):
    m, n = int(rng.integers(0, 7)), 8
    Q = np.ascontiguousarray(np.linalg.qr(rng.normal(size=(n, n)))[0][:m])
    return Q, rng.normal(size=n), np.zeros(m + 1)


def remove_four(rng):
    Q = np.ascontiguousarray(np.linalg.qr(rng.normal(size=(8, 8)))[0][: int(rng.integers(4, 9))])
    return Q, int(rng.integers(len(Q) - 3)), rng.normal(size=8)


def damp_slowed(rng):
    """Of joints some of which stand still, or reverse."""
    free = rng.normal(size=8) * (rng.random(8) < 0.7)
    return rng.random(8), free, free * rng.uniform(-1.0, 2.0, 8), np.full(8, np.nan)


def factor_again(rng):
    """Of a mechanism with another factor, which is damped or not."""
    system, L = factor_of(rng)
    damping = system.damping * rng.choice([0.0, 1.0])
    return np.array(system.evaluation.mass), damping, system.evaluation.parent, bool(rng.random() < 0.5), 2.0 * L


def solve(rng):
    system, L = factor_of(rng)
    rows = rng.normal(size=(rng.integers(0, 6), system.nv))
    return L, system.evaluation.parent, rows, np.full(rows.shape, np.nan), np.full(rows.shape, np.nan)


def advance_by(rng):
    system, q, v = moving_robot(rng)
    mass, *others = forces(rng, system, q, v)
    L = np.full(mass.shape, np.nan)
    return indefinite(rng, mass), *others, L[:0], L, np.zeros((2, len(v))), np.full(len(v), np.nan)


def is_damped(rng):
    damping = rng.normal(size=rng.integers(1, 5)) * rng.choice([0.0, 1.0])
    return (damping,)


def scaled_rows(rng):
    """Rows of unit length, every other time with multiples of one of them, and what they demand of some z."""
    m, n = (int(k) for k in rng.integers(1, 9, size=2))
    W = rng.normal(size=(m, n + 1))
    if m > 1 and rng.random() < 0.5:
        W[1:] = rng.choice([-1.0, 1.0], size=(m - 1, 1)) * W[rng.integers(0, m, m - 1)]
    W /= np.linalg.norm(W, axis=1)[:, None]
    return W, W @ rng.normal(size=n + 1)


def pivoted_cholesky(rng):
    W, _ = scaled_rows(rng)
    return W @ W.T, np.full((len(W), len(W)), np.nan)


def factors(rng):
    """Independent rows, their factors with room for one more, and a row that may depend on them."""
    size = int(rng.integers(1, 5))
    n = size + int(rng.integers(0, 3))
    L, Q = np.zeros((size + 1, size + 1)), np.zeros((size + 1, n))
    W = rng.normal(size=(size, n))
    basis, R = np.linalg.qr(W.T)
    L[:size, :size], Q[:size] = (R * np.sign(R.diagonal())[:, None]).T, (basis * np.sign(R.diagonal())).T
    return W, size, L, Q


def append_row(rng):
    W, size, L, Q = factors(rng)
    # one that depends on the others has no direction across
    W = np.vstack([W, W.sum(axis=0)]) if size == W.shape[1] else rng.normal(size=(1, W.shape[1]))
    least = 1e-4 if size == Q.shape[1] else 0.0
    return W[-1].copy(), size, least, L, Q


def remove_row(rng):
    _, size, L, Q = factors(rng)
    return size, int(rng.integers(size)), L, Q


def solve_triangle(rng):
    _, size, L, _ = factors(rng)
    return L, size, rng.normal(size=size + 1)


def solve_on_active(rng):
    W, size, L, Q = factors(rng)
    return rng.normal(size=size), rng.permutation(size), size, L, Q, np.zeros(size + 1), np.full(W.shape[1], np.nan)


def active_set(W):
    """What the dual active-set method writes to: rows, factors, percussions and z."""
    most, n = min(W.shape) + 1, W.shape[1]
    return np.zeros(most, int), np.zeros((most, most)), np.zeros((most, n)), np.zeros(most), np.zeros(n)


def start_from(rng):
    W, d = scaled_rows(rng)
    return W, np.abs(d), rng.random(len(d)) < 0.5, *active_set(W)


def first_set(rng):
    W, d, *others = start_from(rng)
    return W, d, percussions_before(rng, len(d)), *others[1:]


def goldfarb_idnani(rng):
    W, d = scaled_rows(rng)
    if rng.random() < 0.4:
        # rows may contradict each other
        d = np.abs(d)
    return W, d, 1e-13, 0, *active_set(W), np.zeros(len(d))


def least_violation(rng):
    """Rows that contradict each other, or not, with percussions that prove it."""
    rows = rng.normal(size=(3, 4))
    W = np.vstack([rows, -rows.sum(axis=0) + rng.choice([0.0, 0.1])])
    return W, rng.choice([-1.0, 1.0]) * rng.random(4), np.arange(4), 4, np.ones(4)


def least_norm(rng):
    """Rows that span all columns, and a sum of them; some have no part in it."""
    rank = int(rng.integers(1, 5))
    count = rank + int(rng.integers(0, 5))
    B = rng.normal(size=(count + 1, rank + 1))
    b = (rng.random(count) * (rng.random(count) < 0.7)) @ B[:count, :rank]
    # a start, or none
    return B, count, rank, np.append(b, 0.0), (rng.random() < 0.5) * (rng.random(count + 1) - 0.3)


def newton_step(rng):
    B, count, rank, b, _ = least_norm(rng)
    return B, rng.random(len(B)), count, rank, 1e-3, np.zeros((rank, rank)), b[:rank].copy()


def share(rng):
    """Corners of a face, three of which are active."""
    W = np.array([[1.0, a, b] for a in (-1, 1) for b in (-1, 1)]) + (rng.random() < 0.2) * rng.normal(size=(4, 3))
    basis, R = np.linalg.qr(W[:3].T)
    signs, L, Q = np.sign(R.diagonal()), np.zeros((4, 4)), np.zeros((4, 3))
    L[:3, :3], Q[:3] = (R * signs[:, None]).T, (basis * signs).T
    z, slack = (rng.random(4) + 0.1) @ W, np.array([0.0, 0.0, 0.0, rng.choice([0.0, 1.0])])
    last = rng.random(4) * (rng.random(4) < 0.7) if rng.random() < 0.5 else np.zeros(0)
    return W, slack, 1e-13, np.array([0, 1, 2, -1]), 3, L, Q, z, last, np.zeros(4)


def solve_active_set(rng):
    J, metric, v, x = cone(rng)
    m, n = J.shape
    lower = -restitution(rng, m) * (J @ v)
    if m > 1 and rng.random() < 0.2:
        # rows that contradict each other
        J[1], lower[:2] = -J[0], 1.0
    elif rng.random() < 0.2:
        # a row that is far open, because its gradient is little more than rounding
        J[0], lower[0] = 1e-17 * J[0], -1.0
    W = np.ascontiguousarray(metric.whiten(J.T).T)
    last, table = percussions_before(rng, m), np.full((3, m), np.nan)
    return J, metric.solve_rows(J), W, x, lower, last, 0.0, np.full(n, np.nan), table


def scale_rows(rng):
    J, _, W, x, lower, *_ = solve_active_set(rng)
    m = len(J)
    table = np.array([np.zeros(m), J @ x, J @ x])
    return J, W, x, lower, table, np.ones(m), np.zeros(m)


def natural_residual(rng):
    J, A, _, x, lower, *_, w, table = solve_active_set(rng)
    u = rng.random(len(J))
    return J, A, x, lower, rng.uniform(0.5, 2.0, size=len(J)), u, 2.0, np.zeros(len(J)), w, table


def newton_law(rng):
    J, _, v, _ = cone(rng)
    m = len(J)
    return J, v, restitution(rng, m), opened(rng, m), np.full(m, np.nan), np.full((4, m), np.nan)


def opened(rng, m):
    """Speeds at which open rows may close; now and then none is open."""
    return rng.choice([0.0, 0.1], size=m) if rng.random() < 0.3 else np.zeros(0)


def tree_law(rng):
    system, q, v = moving_robot(rng)
    J = contact_rows(rng, system, q)
    mass, *others = forces(rng, system, q, v)
    if rng.random() < 0.1:
        mass[0, 0] = -1.0
    m, n = J.shape
    last = percussions_before(rng, m)
    return mass, *others, J, restitution(rng, m), opened(rng, m), last, 0.0, np.full(n, np.nan), np.full((4, m), np.nan)


def law_of_rows(rng):
    system, L = factor_of(rng)
    x, v = rng.normal(size=(2, system.nv))
    m = int(rng.integers(1, 5))
    J, last = rng.normal(size=(m, system.nv)), percussions_before(rng, m)
    out = np.full(system.nv, np.nan), np.full((4, m), np.nan)
    return L, system.evaluation.parent, x, v, J, restitution(rng, m), opened(rng, m), last, 0.0, *out


def frictional_law_of_rows(rng):
    system, L = factor_of(rng)
    x, v = rng.normal(size=(2, system.nv))
    return L, system.evaluation.parent, x, v, *frictional_rows(rng, system.nv)


def frictional_tree_law(rng):
    """Perhaps damped, with rates of walls, or with open contacts; some have no friction, now and then none has."""
    system, q, v = moving_robot(rng)
    mass, *others = forces(rng, system, q, v)
    if rng.random() < 0.1:
        mass[0, 0] = -1.0
    return mass, *others, *frictional_rows(rng, system.nv)


def frictional_rows(rng, n):
    """From J on, the arguments of the laws with friction."""
    m = int(rng.integers(1, 1 + max(1, n // 3)))
    J, T = rng.normal(size=(m, n)), rng.normal(size=(2 * m, n))
    drift = rng.normal(size=3 * m) if rng.random() < 0.3 else np.zeros(0)
    given = restitution(rng, m), drift, opened(rng, m), rng.choice([0.0, 0.5], size=m), 0, 1e-12
    out = np.full(n, np.nan), np.full((4, m), np.nan), np.full((4, m, 2), np.nan)
    return J, T, *given, np.zeros(3 * m), *out


def tangent_rows(rng):
    columns, support, first, second, point, normal, _ = separation(rng)
    m, nv = len(first), columns.shape[0]
    return columns, support, first, second, point, normal, np.full((m, 2, 3), np.nan), np.full((2 * m, nv), np.nan)


def row(rng):
    system, q, _ = moving_robot(rng)
    _, columns, support = system.kinematics(q)
    first, second = rng.integers(0, len(support), 2)
    return np.array(columns), support[first], support[second], rng.normal(size=4), unit(rng), np.full(system.nv, np.nan)


def turning_row(rng):
    columns, first, second, _, axis, out = row(rng)
    return columns, first, second, axis, out


def separation(rng):
    system, q, _ = moving_robot(rng)
    _, columns, support = system.kinematics(q)
    m = rng.integers(0, 7)
    first, second = rng.integers(0, len(support), (2, m))
    return (
        np.array(columns),
        support,
        first,
        second,
        rng.normal(size=(m, 3)),
        unit(rng, m),
        np.full((m, system.nv), np.nan),
    )


def bias(rng):
    system, q, _ = moving_robot(rng)
    m = int(rng.integers(0, 6))
    bodies = rng.integers(1, len(system.bodies), m)
    return (
        np.array(system.kinematics(q).poses), bodies, rng.normal(size=(m, 3)), rng.normal(size=(m, 6)),
        rng.normal(size=(m, 6)), np.full((m, 3), np.nan),
    )  # fmt: skip


def consume_clearance(rng):
    n, nv = rng.integers(0, 5), rng.integers(1, 9)
    clearance = rng.choice([-np.inf, 0.1, 1.0, np.inf], size=n)
    return rng.normal(size=nv), rng.random((n, nv)), rng.random((n, nv)), clearance, 0.2 * rng.random()


def list_candidates(rng):
    nv, n = rng.integers(1, 9), rng.integers(0, 12)
    clearance = rng.choice([-np.inf, 0.0, 1.0, np.inf], size=n) + rng.random(n)
    travel = rng.random(nv) * (rng.random(nv) < 0.7)
    return clearance, rng.random((nv, n)), travel, 1e-8, np.full(n, -1)


def filter_active(rng):
    pair = np.repeat(np.arange(5), rng.integers(0, 4, size=5))
    gap = rng.normal(size=len(pair))
    return pair, gap, 0.1 * rng.normal(), rng.normal(size=5), np.full(len(pair), -1)


def normals(rng):
    """Unit normals, some of them straight down or along an axis."""
    normal = rng.normal(size=(5, 3))
    normal[0], normal[1] = [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]
    return np.ascontiguousarray(normal / np.linalg.norm(normal, axis=1)[:, None]), np.full((5, 2, 3), np.nan)


def contacts_of_one_surface(rng):
    """Normals that are equal or not, and gradients of the same bodies or of others."""
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    gradient = rng.normal(size=6)
    return (
        normal,
        normal.copy() if rng.random() < 0.7 else -normal,
        gradient,
        rng.choice([1.0, 0.0]) * gradient + rng.choice([0.1, 1.0]) * rng.normal(size=6),
    )


def contacts_that_go_on(rng):
    """One contact and three others, of which some go on from it, and some are others' own."""
    normal, other, gradient, _ = contacts_of_one_surface(rng)
    turned = np.array([normal, other, normal])
    gradients = np.array([gradient, gradient, rng.normal(size=6)])
    points, owner = rng.normal(size=(4, 3)), rng.integers(-1, 3, size=2)
    return (
        int(rng.integers(2)), points[0], normal, gradient, rng.integers(0, 2, size=3), points[1:], turned, gradients,
        owner, rng.uniform(0.5, 3.0),
    )  # fmt: skip


def contacts_at_two_configurations(rng):
    """Contacts of a few constraints at points of a grid, where many are equally near; some have no points."""
    k, m = rng.integers(0, 9, size=2)
    number, others = rng.integers(0, 4, size=k), rng.integers(0, 4, size=m)
    point, places = (rng.integers(0, 3, size=(n, 3)).astype(float) for n in (k, m))
    point[number == 0], places[others == 0] = np.nan, np.nan
    return number, point, others, places, others.argsort(kind="stable"), np.full(k, -7)


def shapes_on_walls(rng):
    """Shapes of every kind on a robot above two walls, and the points of some pairs; now and then a rim is level."""
    system, q, _ = moving_robot(rng)
    shapes = placed_on(rng, range(1, len(system.bodies)), [*SHAPES, WHEEL])
    walls = walls_of(rng, shapes)
    cylinder = next(k for k, placed in enumerate(shapes) if isinstance(placed.shape, Cylinder))
    if rng.random() < 0.3:
        axis = shapes[cylinder].rotation[:, 2] @ system.kinematics(q).poses[shapes[cylinder].body, :3]
        walls[cylinder] = HalfSpace(tuple(axis), 0.0)
    names = [placed.name for placed in shapes]
    contacts = HalfSpaceContacts(system, walls, shapes, names, np.zeros(len(shapes)))
    asked = np.union1d(np.flatnonzero(rng.random(len(shapes)) < 0.5), [cylinder])
    return system.kinematics(q), contacts, asked


def point_selection(rng):
    kinematics, contacts, asked = shapes_on_walls(rng)
    return kinematics, contacts._select(np.flatnonzero(np.isin(contacts.owner, asked)))


def lowest(rng):
    kinematics, selection = point_selection(rng)
    i = int(rng.integers(len(selection.pair)))
    return kinematics.poses, int(selection.owners[i, 0]), selection.numbers, i, np.full(4, np.nan)


def stand(rng):
    kinematics, selection = point_selection(rng)
    k = len(selection.pair)
    return kinematics.poses, selection.owners, selection.numbers, np.full(k, np.nan), np.full((k, 3), np.nan)


def some_tolerance(rng, kinematics, contacts, asked):
    selection = contacts._select(np.flatnonzero(np.isin(contacts.owner, asked)))
    gap, point = np.empty(len(selection.pair)), np.empty((len(selection.pair), 3))
    stand_plain(kinematics.poses, selection.owners, selection.numbers, gap, point)
    return float(rng.choice([gap.min() - 1.0, np.median(gap) + 1e-6, gap.max() + 1.0]))


def points_below(rng):
    kinematics, contacts, asked = shapes_on_walls(rng)
    table, pair = contacts._table, int(rng.choice(asked))
    tolerance = some_tolerance(rng, kinematics, contacts, asked)
    return kinematics.poses, table, pair, tolerance, 0


def spread_below(rng):
    kinematics, contacts, _ = shapes_on_walls(rng)
    table = contacts._table
    pair = int(np.argmax(np.diff(table.begin)))
    count = int(table.begin[pair + 1] - table.begin[pair])
    table.found[:count] = np.arange(table.begin[pair], table.begin[pair + 1])
    table.size[pair] = rng.choice([0.1, 10.0])
    return kinematics.poses, table, pair, float(rng.choice([0.0, 0.1, 10.0])), 0, count


def stays_above(rng):
    poses, table, pair, _, _, _ = spread_below(rng)
    place = np.ascontiguousarray(poses[table.body[pair]])
    return place, table, int(rng.integers(table.begin[pair], table.begin[pair + 1])), float(rng.choice([0.0, 1.0]))


def few_of_each_face(rng):
    _, table, pair, _, at, count = spread_below(rng)
    return table, pair, at, rng.choice([0.0, 1.0]) * rng.normal(size=count), 0.1, rng.random(count) < 0.8


def points_within_(rng):
    kinematics, contacts, asked = shapes_on_walls(rng)
    tolerance = some_tolerance(rng, kinematics, contacts, asked)
    return kinematics.poses, contacts._plain_table, asked, tolerance, rng.normal(size=contacts.size)


def few_points_within(rng):
    kinematics, contacts, asked = shapes_on_walls(rng)
    # -1 now and then, which leaves the rest unsaid
    few = asked[np.diff(contacts.points.begin)[asked] <= rng.choice([FEW_POINTS, 100])]
    tolerance = some_tolerance(rng, kinematics, contacts, asked)
    return kinematics.poses, contacts._plain_table, few, tolerance, rng.normal(size=contacts.size)


def last_time(rng, gap, tolerance):
    """Which gaps were within a tolerance the last time, often the same as now, and where to write these gaps to."""
    others = rng.random(len(gap)) < rng.choice([0.0, 2.0]) / len(gap)
    near = np.flatnonzero((gap <= tolerance) ^ others)
    index = np.full(len(gap) + 1, -1)
    index[0], index[1 : 1 + len(near)] = len(near), near
    return index, np.full(len(near), np.nan)


def half_space_rows(rng):
    kinematics, contacts, asked = shapes_on_walls(rng)
    table, tolerance = contacts._table, some_tolerance(rng, kinematics, contacts, asked)
    count, _ = points_within(kinematics.poses, contacts._plain_table, asked, tolerance, np.zeros(contacts.size))
    index = table.found[:count].copy()
    if count and rng.random() < 0.5:
        index = index[: int(rng.integers(count))]
    k, nv = len(index), kinematics.support.shape[1]
    written = np.full(k, np.nan), np.full((k, 3), np.nan), np.full((k, nv), np.nan)
    shared = contacts._plain_table, asked, tolerance, rng.normal(size=contacts.size)
    return *kinematics, *shared, index, contacts.owner[index], *written


def reached(rng):
    m = rng.integers(1, 9)
    where, sign, offset = rng.normal(size=m), rng.choice([-1.0, 1.0], size=m), rng.random(m)
    index, gap = last_time(rng, sign * where + offset, 1e-8)
    return where, sign, offset, np.ones(m), 1e-8, index, gap


def shape_pairs(rng, shapes=SHAPES):
    """Shapes on some bodies and the world, all their pairs, and where the bodies are."""
    placed = placed_on(rng, range(4), shapes)
    sides = np.array([(a, b) for a in range(len(placed)) for b in range(len(placed)) if a != b])
    axes = SeparatingAxes(ShapeTable(placed), sides)
    places = np.array([place(rng) for _ in axes.bodies]).reshape(-1, 4, 3)
    axes.axis[:] = unit(rng, len(sides))
    axes.axis[rng.random(len(sides)) < 0.2] = np.nan
    return placed, axes, places


def reach(rng):
    _, axes, _ = shape_pairs(rng)
    return place(rng), unit(rng), axes.shapes, int(rng.integers(len(axes.shapes.sides))), int(rng.integers(2))


def clear(rng):
    _, axes, places = shape_pairs(rng)
    n = len(axes.axis)
    due = np.flatnonzero(rng.random(n) < 0.7)
    return (
        places, axes.tables, axes.axis, due, 0.5 * rng.normal(), rng.normal(size=n), np.full(len(due), -1),
    )  # fmt: skip


def guess(rng):
    return clear(rng)[:5]


def keep(rng):
    _, axes, places = shape_pairs(rng)
    pairs = np.flatnonzero(rng.random(len(axes.axis)) < 0.3)
    return places, axes.frame, axes.shapes.sides, axes.axis, pairs, unit(rng, len(pairs))


def note(rng):
    m, n = rng.integers(0, 6), 4
    percussion = rng.random(m) * (rng.random(m) < 0.5)
    before = rng.choice([-1.0, 0.0, 1.0], size=m) * rng.random(m)
    free = before + 0.5 * rng.normal(size=m)
    rates = np.array([percussion, free, rng.normal(size=m), before])
    number, lever = rng.integers(0, 5, m), rng.random(3)
    noted, limits = (rng.random(n), rng.random(n), rng.random(n)), int(rng.integers(0, 4))
    return int(rng.integers(n)), number, 0.1 * rng.normal(size=m), rates, rng.random(), lever, limits, 1e-12, *noted


def carried_points(rng):
    m = int(rng.integers(0, 5))
    return rng.normal(size=(m, 3)), *rng.normal(size=(2, m, 4, 3)), np.empty((m, 3))


def struck(rng):
    m, k = rng.integers(0, 6), rng.integers(0, 6)
    rates, last = (rng.normal(size=(4, n)) * (rng.random((4, n)) < 0.7) for n in (m, k))
    for r in (rates, last):
        r[0] = np.abs(r[0])
    point, last_point = rng.normal(size=(m, 3)), rng.normal(size=(k, 3))
    # a limit has no point; every other contact stays near
    point[rng.random(m) < 0.2] = np.nan
    numbers, last_numbers = rng.integers(0, 4, m), np.sort(rng.integers(0, 4, k))
    for a in range(min(m, k)):
        if rng.random() < 0.5:
            last_point[a], last_numbers[a] = point[a] + 0.01, numbers[a]
    order = np.argsort(last_numbers, kind="stable")
    last_numbers, last_point, last = last_numbers[order], last_point[order], np.ascontiguousarray(last[:, order])
    # one of both bodies, the other or both may have carried a contact to where it is now
    carried = np.array([last_point, last_point])
    carried[rng.random((2, k)) < 0.3] += rng.normal(size=3)
    before = last_numbers, carried, last
    return numbers, point, rates, rng.random(m), *before, 0.1, rng.random(2), 1e-12, np.zeros(m, np.int8)


def balls_in_a_heap(rng):
    """Centres and radii over two powers of ten; now and then two coincide."""
    n = int(rng.integers(2, 40))
    centres, radii = rng.normal(size=(n, 3)), 0.3 * 10.0 ** rng.uniform(-2.0, 0.0, n)
    if rng.random() < 0.2:
        centres[1] = centres[0]
    return centres, radii


def near_balls(rng):
    centres, radii = balls_in_a_heap(rng)
    level = np.log2(radii / radii.min()).astype(np.int64)
    largest = np.zeros(level.max() + 1)
    np.maximum.at(largest, level, radii)
    reach = 0.5 * rng.random()
    return centres, radii, level, 2.0 * largest + reach, reach, np.full(len(radii) ** 2, -1)


def farthest_moved(rng):
    n, turning = int(rng.integers(1, 9)), int(rng.integers(2))
    return *rng.normal(size=(2, n, 3)), *rng.normal(size=(2, turning * n, 3, 3)), rng.random(n)


def room_for(k):
    return np.full(k, -1), np.full(k, np.nan), np.full((k, 3), np.nan), np.full((k, 3), np.nan)


def touching(rng):
    centres, radii = balls_in_a_heap(rng)
    i, j = np.triu_indices(len(radii), 1)
    chosen = rng.random(len(i)) < 0.5
    pairs = (i * len(radii) + j)[chosen]
    return centres, radii, pairs, rng.choice([0.0, 0.5, np.inf]), *room_for(len(pairs))


def wall_contacts(rng):
    centres, radii = balls_in_a_heap(rng)
    shapes = [
        HalfSpace(tuple(unit(rng)), rng.normal()),
        *placed_on(rng, [0], [Box((0.9, 0.4, 1.2)), Capsule(0.1, 0.8)]),
    ]
    walls = np.array([sphere_walls._wall_numbers(w) for w in shapes])
    kind = np.array([sphere_walls._kind_of(w) for w in shapes])
    return centres, radii, kind, walls, rng.choice([0.0, 0.5, np.inf]), *room_for(3 * len(radii))


def wall_and_point(index):
    """A box or a capsule, and a point near it or within it."""

    def arguments(rng):
        centres, _, _, walls, *_ = wall_contacts(rng)
        centres *= rng.choice([0.1, 1.0])
        return walls, index, centres, int(rng.integers(len(centres))), np.inf, np.full(3, np.nan)

    return arguments


def unit_rows(rng):
    """Sparse unit rows between bodies of three velocities each and one of two that is dense; some stand twice."""
    n, m = int(rng.integers(2, 7)), int(rng.integers(1, 14))
    rows = np.zeros((m, 3 * n + 2))
    for row in rows:
        for body in rng.choice(n, size=2, replace=False) if rng.random() < 0.8 else rng.choice(n, size=1):
            row[3 * body : 3 * body + 3] = rng.normal(size=3)
        if rng.random() < 0.2:
            row[-2:] = rng.normal(size=2)
    for a in range(1, m):
        if rng.random() < 0.1:
            rows[a] = rows[a - 1]
    rows /= np.linalg.norm(rows, axis=1)[:, None]
    U = csr_array(rows)
    return U, U.indices.astype(np.uint32), U.indptr.astype(np.uint32)


def delassus_of(rng):
    U, _, _ = unit_rows(rng)
    G = csr_array(U @ U.T)
    G.sort_indices()
    return U, G, G.indptr.astype(np.uint32), G.indices.astype(np.uint32)


def gram_of(rng):
    U, columns, starts = unit_rows(rng)
    room = int(rng.choice([0, 14 * 14]))
    return (
        U.data,
        columns,
        starts,
        U.shape[1],
        np.zeros(len(starts), np.uint32),
        np.zeros(room, np.uint32),
        np.zeros(room),
    )


def sort_by_column(rng):
    U, columns, starts = unit_rows(rng)
    n, k = U.shape[1], len(columns)
    return U.data, columns, starts, np.zeros(n + 1, np.int64), np.zeros(k, np.uint32), np.zeros(k), np.ones(n + 1, bool)


def islands(rng):
    U, columns, starts = unit_rows(rng)
    kept = rng.random(U.shape[0]) < 0.8
    kept[0] = True
    return columns, starts, U.shape[1], kept, np.full(len(kept), -2)


def missing_rates(rng, U):
    """What some velocity can meet."""
    return U @ rng.normal(size=U.shape[1]) - rng.random(U.shape[0])


def incomplete_cholesky(rng):
    _, G, starts, columns = delassus_of(rng)
    room = (len(columns) + len(starts) - 1) // 2
    written = np.zeros(len(starts), np.uint32), np.zeros(room, np.uint32), np.zeros(room)
    return starts, columns, G.data, rng.choice([1e-4, 0.1]), *written


def solve_factor(rng):
    starts, columns, data, _, rows, places, L = incomplete_cholesky(rng)
    assert incomplete_cholesky_plain(starts, columns, data, 3.0, rows, places, L)
    return rows, places, L, rng.normal(size=len(rows) - 1), np.full(len(rows) - 1, np.nan)


def solve_island(rng):
    U, G, starts, columns = delassus_of(rng)
    start = rng.random(U.shape[0]) * (rng.random(U.shape[0]) < 0.5)
    return starts, columns, G.data, missing_rates(rng, U), 1e-11, start


def projected_pcg(rng):
    starts, columns, data, d, target, start = solve_island(rng)
    return starts, columns, data, d, target, 0.0, 2000, np.zeros(6), np.full(len(d), np.nan), start


def dual_residual(rng):
    starts, columns, data, d, _, u = solve_island(rng)
    return starts, columns, data, d, np.zeros(len(d)), u


def gauss_seidel(rng):
    starts, columns, data, d, _, u = solve_island(rng)
    g = csr_array((data, columns, starts), shape=(len(d), len(d))) @ u - d
    return starts, columns, data, 2, g, u


def restrict_to_face(rng):
    starts, columns, data, d, _, u = solve_island(rng)
    return (
        starts, columns, data, u, np.zeros(len(d), np.uint32), np.zeros(len(d) + 1, np.uint32),
        np.zeros(len(data), np.uint32), np.zeros(len(data)),
    )  # fmt: skip


def pcg_on_face(rng):
    starts, columns, data, d, _, _ = solve_island(rng)
    return starts, columns, data, 1e-3, 0.0, 1e-4, d, np.zeros(len(d))


def line_search(rng):
    starts, columns, data, d, _, u = solve_island(rng)
    g = csr_array((data, columns, starts), shape=(len(d), len(d))) @ u - d
    return starts, columns, data, np.arange(len(d), dtype=np.uint32), g, -g * rng.uniform(0.5, 3.0), u


def refine_subset(rng):
    """Percussions that fit but for three."""
    starts, columns, data, d, target, u = solve_island(rng)
    solve_island_plain(starts, columns, data, d, 0.1 * target, u)
    u[rng.integers(len(u), size=3)] += 0.1
    return starts, columns, data, target, csr_array((data, columns, starts), shape=(len(d), len(d))) @ u - d, u


def solve_islands(rng):
    U, G, starts, columns = delassus_of(rng)
    kept, label = rng.random(U.shape[0]) < 0.9, np.empty(U.shape[0], np.int64)
    kept[0] = True
    count = islands_plain(U.indices.astype(np.uint32), U.indptr.astype(np.uint32), U.shape[1], kept, label)
    start = rng.random(U.shape[0]) * (rng.random(U.shape[0]) < 0.5)
    return starts, columns, G.data, missing_rates(rng, U), label, count, 1e-11, start


def merge_repeated(rng):
    """Rows of which some are there two or three times."""
    U, _, _ = unit_rows(rng)
    U = csr_array(U[rng.integers(U.shape[0], size=2 * U.shape[0])])
    G = csr_array(U @ U.T)
    G.sort_indices()
    m = U.shape[0]
    d = rng.choice([0.5, 1.0], m)
    return G.indptr.astype(np.uint32), G.indices.astype(np.uint32), G.data, d, np.zeros(m, bool), rng.random(m)


def solve_left(rng):
    U, columns, starts = unit_rows(rng)
    u, label = rng.random(U.shape[0]), np.empty(U.shape[0], np.int64)
    return U.data, columns, starts, U.shape[1], missing_rates(rng, U), 1e-11, label, u


def solve_working_set(rng):
    """Few rows, or some with large islands."""
    if rng.random() < 0.5:
        data, columns, starts, n, d, _, label, u = solve_left(rng)
        return data, columns, starts, n, d, rng.random(len(d)) < 0.8, 1e-11, label, u
    data, columns, starts, n, d, label, _, _, u = sweep_islands(rng)
    return data, columns, starts, n, d, rng.random(len(d)) < 0.95, 1e-11, label, u


def whiten_bodies(rng):
    n, k = int(rng.integers(1, 5)), int(rng.integers(0, 9))
    lower = np.linalg.inv(np.linalg.cholesky(np.eye(6) + np.array([a @ a.T for a in rng.normal(size=(n, 6, 6))])))
    return lower, rng.integers(n, size=k), rng.normal(size=6 * k), np.full(6 * k, np.nan)


def row_lengths(rng):
    U, _, starts = unit_rows(rng)
    return starts.astype(np.int64), rng.normal(size=len(U.data)), np.full(U.shape[0], np.nan)


def scale_percussions(rng):
    starts, columns, data, d, _, u = solve_island(rng)
    return starts, columns, data, d, [1e-11, 1e3][rng.integers(2)], 1.0, u


def combine_rows(rng):
    U, columns, starts = unit_rows(rng)
    u = rng.random(U.shape[0]) * (rng.random(U.shape[0]) < 0.5)
    return U.data, columns, starts, u, np.full(U.shape[1], np.nan)


def scaled_residual(rng):
    data, columns, starts, u, z = combine_rows(rng)
    return data, columns, starts, rng.normal(size=len(u)), z, u


def sweep(rng):
    U, columns, starts = unit_rows(rng)
    u, last, d = rng.random(U.shape[0]), rng.random(U.shape[0]), rng.normal(size=U.shape[0])
    return U.data, columns, starts, d, last, U.T @ u, u


def extrapolate(rng):
    U, columns, starts = unit_rows(rng)
    u, last = rng.random(U.shape[0]), rng.random(U.shape[0])
    return U.data, columns, starts, rng.random(), U.T @ last, last, U.T @ u, u


def accelerated_sweeps(rng):
    U, columns, starts = unit_rows(rng)
    u = rng.random(U.shape[0]) * (rng.random(U.shape[0]) < 0.5)
    return U.data, columns, starts, missing_rates(rng, U), 1e-3, 30, np.full(U.shape[1], np.nan), u


def sweep_islands(rng):
    """Two islands of many rows in few columns, and a small one."""
    U = block_array([[None, normal_rows(rng, 60, 9)], [normal_rows(rng, 55, 12), None]], format="csr")
    U = block_array([[U, None], [None, normal_rows(rng, 5, 4)]], format="csr")
    label, u = np.repeat([0, 1, 2], [60, 55, 5]), rng.random(120)
    columns, starts = U.indices.astype(np.uint32), U.indptr.astype(np.uint32)
    return U.data, columns, starts, U.shape[1], missing_rates(rng, U), label, 1e-2, np.ones(3, bool), u


def normal_rows(rng, m, n):
    rows = rng.normal(size=(m, n))
    return csr_array(rows / np.linalg.norm(rows, axis=1)[:, None])


def sort_by_island(rng):
    label = rng.integers(-1, 4, 20)
    return label, np.zeros(5, np.int64), np.zeros(20, np.int64), np.zeros(20, np.uint32)


def extract_island(rng):
    starts, columns, data, _, _, u = solve_island(rng)
    label = np.where(rng.random(len(u)) < 0.7, 0, -1)
    rows = np.flatnonzero(label == 0)
    local = np.zeros(len(u), np.uint32)
    local[rows] = np.arange(len(rows))
    return (
        starts, columns, data, label, rows, local,
        np.zeros(len(rows) + 1, np.uint32), np.zeros(len(data), np.uint32), np.zeros(len(data)),
    )  # fmt: skip


def solve_small_island(rng):
    starts, columns, data, d, _, u = solve_island(rng)
    return starts, columns, data, d, u


def free_bodies(rng):
    """Three bodies' q, v, and a tangent vector, of which one stands, one turns a little and one by more than a turn."""
    q = rng.normal(size=(3, 7))
    q[:, 3:] /= np.linalg.norm(q[:, 3:], axis=1)[:, None]
    dv = rng.normal(size=(3, 6))
    dv[:, 3:] *= np.array([[0.0], [0.05], [2.0]])
    return q.ravel(), rng.normal(size=18), dv.ravel()


def moved(rng):
    q, _, dv = free_bodies(rng)
    return q, dv, np.zeros(21)


def differences(rng):
    q, *_ = free_bodies(rng)
    return q, free_bodies(rng)[0], np.zeros(18)


def chart_rates(rng):
    _, v, dv = free_bodies(rng)
    return dv, v, np.zeros(18)


def accelerations(rng):
    turned = np.array([rotation(rng) for _ in range(3)])
    inertias = turned @ (rng.uniform(0.1, 2.0, (3, 3))[:, :, None] * turned.transpose(0, 2, 1))
    inertias = 0.5 * (inertias + inertias.transpose(0, 2, 1))
    return rng.normal(size=18), rng.normal(size=(3, 3)), inertias, np.linalg.inv(inertias), np.zeros(18)


def placed(rng):
    return free_bodies(rng)[0], rng.integers(1, 4, 5), np.zeros((5, 4, 3))


def pulled(rng):
    points, normals = rng.normal(size=(2, 5, 3))
    return free_bodies(rng)[0], rng.integers(0, 4, 5), rng.choice([-1.0, 1.0]), points, normals, np.full((5, 6), np.nan)


def pulled_in_plane(rng):
    q, bodies, sign, points, normals, _ = pulled(rng)
    return q, bodies, sign, rotation(rng), points, normals, np.full((5, 3), np.nan)


def first_of_lines(rng):
    """Points of which some stand in line."""
    line = rng.normal(size=3)
    line /= np.linalg.norm(line)
    points = rng.normal(size=(4, 3))[rng.integers(0, 4, 7)] + rng.normal(size=(7, 1)) * line
    return points, line, np.full(7, -1)


def mesh(rng):
    """A mesh of a few triangles, some of which share edges and corners, and points near it; one is a corner of it."""
    rounded = np.round(rng.uniform(-1, 1, (9, 3)), 1)
    surface = triangles.Surface(rounded, np.array([rng.permutation(9)[:3] for _ in range(int(rng.integers(1, 20)))]))
    centres = rng.uniform(-1.5, 1.5, (9, 3))
    centres[3] = surface.vertices[surface.triangles[0, 0]]
    return surface, centres


def mesh_tree(rng):
    surface, centres = mesh(rng)
    return surface, (surface.vertices, surface.triangles, *surface.tree), centres


def shared_length(rng):
    # a free base, and three joints
    return np.array([0, 0, 0, 3, 3, 3, 6, 7, 8]), int(rng.integers(9)), rng.normal(size=9)


def nearest_on_triangle(rng):
    surface, centres = mesh(rng)
    return surface.vertices, surface.triangles, 0, centres, int(rng.integers(9)), np.zeros(3)


def mesh_distances(rng):
    _, tree, centres = mesh_tree(rng)
    return *tree, centres, np.zeros(len(centres))


def seams(rng):
    """Boxes side by side with corners on a grid, a shape of them, and a point and a normal of one of its faces."""
    placed = []
    for k in range(5):
        edges, low = rng.integers(1, 3, size=3).astype(float), rng.integers(0, 2, size=3).astype(float)
        placed.append(PlacedShape(f"{k}", Box(tuple(edges)), 0, np.eye(3), low + 0.5 * edges))
    shape, side, axis = int(rng.integers(5)), rng.choice([-1.0, 1.0]), int(rng.integers(3))
    share = rng.choice([-0.5, -0.25, 0.5], size=3)
    share[axis] = 0.5 * side
    return seams_of(placed), shape, placed[shape].position + share * placed[shape].shape.size, side * np.eye(3)[axis]


def is_covered(rng):
    found, shape, point, normal = seams(rng)
    return found, shape, 0.0, point, -normal, -1.0


def at_seam(rng):
    found, shape, point, normal = seams(rng)
    first, second = [(shape, -1), (-1, shape), (-1, -1)][rng.integers(3)]
    return found, first, second, 0.0, point, normal if first >= 0 else -normal


def uncovered(rng):
    found, shape, point, normal = seams(rng)
    first, second = np.array([shape, -1, shape]), np.array([-1, shape, -1])
    points, normals = np.array([point, point, point + 0.1]), np.array([normal, -normal, normal])
    return found, first, second, np.zeros(3), points, normals, np.zeros(3, np.int64)


def near_triangles(rng):
    surface, tree, centres = mesh_tree(rng)
    room, reach = int(rng.integers(1, 30)), float(rng.choice([0.3, 1.0, np.inf]))
    i = int(rng.integers(9))
    outs = np.zeros(room, np.int64), np.zeros(room, np.int64), np.zeros(room), np.zeros((room, 3)), np.zeros(room, int)
    return *tree, surface.features, centres, i, reach, *outs


def listed_triangles(rng, centres):
    """Room for the triangles near some points, where these were last; none in some cases."""
    listed = np.zeros((len(centres), int(rng.choice([0, 1, 9]))), np.int64)
    return listed, np.column_stack([centres + rng.uniform(-0.1, 0.1, centres.shape), np.zeros(len(centres))])


def still_near(rng):
    arguments = near_triangles(rng)
    return *arguments[:8], *listed_triangles(rng, arguments[5]), *arguments[8:]


def add_near(rng):
    vertices, corners, order, _, features, centres, i, reach, *outs = near_triangles(rng)
    count = int(rng.integers(len(outs[0]) + 2))
    return vertices, corners, int(order[0]), features, centres, i, reach, count, *outs, np.zeros(3)


def sort_by_feature(rng):
    k = int(rng.integers(0, 60))
    distance = np.round(rng.uniform(size=k), 1)
    return rng.permutation(k), rng.integers(0, 6, k), distance, k, np.arange(k)


def feature_normal(rng):
    surface = triangles.Surface(*bipyramid(rng))
    number = int(rng.integers(len(surface.sharers)))
    sharing = np.flatnonzero((surface.features == number).any(axis=1))
    rank = np.concatenate([[0], rng.permutation(len(sharing))])
    return surface.vertices, surface.triangles, sharing, rank, 1, len(sharing), number, np.zeros(3)


def side_of(rng):
    points, corners, sharing, rank, first, count, number, normal = feature_normal(rng)
    # sharing triangles stand behind one that does not
    numbers = np.full(len(sharing), number)
    foot, centres = points[corners[sharing, 0]], rng.normal(size=(2, 3))
    return points, corners, sharing, numbers, rank, first, first + count, centres, 1, foot, normal


def bipyramid(rng):
    """A closed mesh of six triangles."""
    ring = np.array([[1.0, 0, 0], [-0.5, 0.8, 0], [-0.5, -0.8, 0], [0, 0, 0.9], [0, 0, -0.7]])
    faces = [[k, (k + 1) % 3, 3] for k in range(3)] + [[(k + 1) % 3, k, 4] for k in range(3)]
    return ring + rng.uniform(-0.1, 0.1, (5, 3)), np.array(faces)


def mesh_contacts(rng):
    """Of a sheet, or of a closed mesh that is solid."""
    if rng.integers(2):
        surface, (_, centres) = triangles.Surface(*bipyramid(rng), None), mesh(rng)
        sides = surface.rim
    else:
        surface, centres = mesh(rng)
        sides = np.ones(len(surface.sharers), bool)
    radii, tolerance = rng.uniform(0.1, 0.4, 9), rng.uniform(0.0, 0.2)
    scratch = np.zeros(20, int), np.zeros(20, int), np.zeros(20), np.zeros((20, 3)), np.zeros(20, int)
    found = np.zeros(200, int), np.zeros(200), np.zeros((200, 3)), np.zeros((200, 3))
    sheet = surface.vertices, surface.triangles, *surface.tree, surface.features, surface.sharers, sides
    reach, deepest = radii + tolerance + 1e-12, float(rng.choice([0.5, np.inf]))
    return *sheet, centres, radii, reach, tolerance, deepest, *listed_triangles(rng, centres), *scratch, *found


def box_square(rng):
    surface, centres = mesh(rng)
    boxes = surface.tree.boxes
    return boxes, int(rng.integers(1, len(boxes))), centres, int(rng.integers(9))


def raise_levels(rng):
    number, known = rng.integers(0, 20, 12), np.unique(rng.integers(0, 20, 6))
    return number, rng.normal(size=12), known, np.zeros(len(known))


def placing_side(rng):
    _, axes, places = shape_pairs(rng)
    s, side = int(rng.integers(len(axes.frame))), int(rng.integers(2))
    return places, axes.frame, axes.shapes.fixed, s, side, np.full((2, 4, 3), np.nan)


def core_reach(rng):
    _, axes, _ = shape_pairs(rng, [s for s in SHAPES if isinstance(s, Sphere | Capsule | Box)])
    world = np.array([place(rng), place(rng)])
    side, sign = int(rng.integers(2)), float(rng.choice([-1.0, 1.0]))
    return world, side, sign, unit(rng), axes.shapes.sizes, int(rng.integers(len(axes.frame)))


def placing_shapes(rng):
    _, axes, places = shape_pairs(rng)
    return places, axes.frame, axes.shapes.fixed, np.full((len(axes.frame), 4, 3), np.nan)


def near_boxes(rng):
    n = int(rng.integers(2, 12))
    world = np.array([place(rng) for _ in range(n)])
    i, j = np.triu_indices(n, 1)
    pairs = (i * n + j)[rng.random(len(i)) < 0.7]
    half = 0.5 * 10.0 ** rng.uniform(-1.0, 0.0, (n, 3))
    return world, 0.1 * rng.normal(size=(n, 3)), half, pairs, 0.3 * rng.random(), np.full(len(pairs), -1)


def carry_axes(rng):
    parts = []
    for _ in range(2):
        n = int(rng.integers(0, 12))
        number = np.sort(rng.choice(20, n, replace=False))
        parts += [number, rng.normal(size=(n, 3)), rng.integers(0, 9, (n, 2))]
    return parts


def bodies_of_rows(rng):
    m = int(rng.integers(0, 8))
    first = rng.integers(0, 4, m)
    return m, first, rng.integers(first == 0, 4, m)


def write_blocks(rng):
    m, first, second = bodies_of_rows(rng)
    left, right = rng.normal(size=(2, m, 3))
    return first, second, left, right, np.full(6 * m, np.nan), np.full(6 * m, -1), np.full(m + 1, -1)


def row_products(rng):
    m, n = rng.integers(0, 8, 2)
    starts = np.concatenate([[0], np.cumsum(rng.integers(0, 4, m) * (n > 0))]).astype(np.uint32)
    columns = rng.integers(0, max(n, 1), starts[-1]).astype(np.uint32)
    return rng.normal(size=starts[-1]), columns, starts, rng.normal(size=n), np.full(m, np.nan)


def sparse_separation_rows(rng):
    m, first, second = bodies_of_rows(rng)
    numbers = np.full(12 * m, 99, np.uint32), np.full(m + 1, 99, np.uint32)
    q = free_bodies(rng)[0]
    return q, first, second, rng.normal(size=(m, 3)), unit(rng, m), np.full(12 * m, np.nan), *numbers


def write_row(rng):
    q, _, _, point, normal, *_ = sparse_separation_rows(rng)
    if not len(point):
        return write_row(rng)
    sign = float(rng.choice([-1.0, 1.0]))
    return q, int(rng.integers(1, 4)), sign, point, normal, int(rng.integers(len(point))), np.full(9, np.nan), 3


ARGUMENTS = {
    **ADDRESS_ARGUMENTS,
    **CONTROL_ARGUMENTS,
    **LOOP_ARGUMENTS,
    **DISTANCE_ARGUMENTS,
    **PATCH_ARGUMENTS,
    **SURFACE_ARGUMENTS,
    **CLOSED_FORM_ARGUMENTS,
    **CONTACT_BLOCK_ARGUMENTS,
    **COULOMB_ARGUMENTS,
    **CARRIED_ARGUMENTS,
    **SETTLE_ARGUMENTS,
    **SPIN_ARGUMENTS,
    **HELD_ARGUMENTS,
    **JOINT_TREE_ARGUMENTS,
    **HELD_ROW_ARGUMENTS,
    **EQUALITY_ARGUMENTS,
    **MOMENTUM_ARGUMENTS,
    "_raise_levels": raise_levels,
    "_near_balls": near_balls,
    "farthest_moved": farthest_moved,
    "pairs_within": touching,
    "wall_contacts": wall_contacts,
    "distance_from_box": wall_and_point(1),
    "distance_from_capsule": wall_and_point(2),
    "gram": gram_of,
    "sort_by_column": sort_by_column,
    "islands": islands,
    "incomplete_cholesky": incomplete_cholesky,
    "solve_factor": solve_factor,
    "projected_pcg": projected_pcg,
    "dual_residual": dual_residual,
    "sort_by_island": sort_by_island,
    "extract_island": extract_island,
    "solve_small_island": solve_small_island,
    "gauss_seidel": gauss_seidel,
    "restrict_to_face": restrict_to_face,
    "pcg_on_face": pcg_on_face,
    "line_search": line_search,
    "combine_rows": combine_rows,
    "scaled_residual": scaled_residual,
    "sweep": sweep,
    "extrapolate": extrapolate,
    "accelerated_sweeps": accelerated_sweeps,
    "sweep_islands": sweep_islands,
    "refine_subset": refine_subset,
    "solve_island": solve_island,
    "_solve_islands": solve_islands,
    "merge_repeated": merge_repeated,
    "solve_left": solve_left,
    "solve_working_set": solve_working_set,
    "scale_percussions": scale_percussions,
    "whiten_bodies": whiten_bodies,
    "row_lengths": row_lengths,
    "near_triangles": near_triangles,
    "still_near": still_near,
    "add_near": add_near,
    "shared_length": shared_length,
    "bounded_way": lambda rng: (*rng.random(6), float(rng.choice([0.0, 0.1, 2.0]))),
    "lessen_ways": lambda rng: (rng.normal(size=(5, 6)), *rng.random((5, 5)), np.empty(5)),
    "reach_along": lambda rng: [seams(rng)[k] for k in (0, 1, 3)],
    "is_hidden_at": seams,
    "is_covered": is_covered,
    "at_seam": at_seam,
    "uncovered": uncovered,
    "nearest_on_triangle": nearest_on_triangle,
    "feature_normal": feature_normal,
    "side_of": side_of,
    "mesh_distances": mesh_distances,
    "sort_by_feature": sort_by_feature,
    "mesh_contacts": mesh_contacts,
    "_box_square": box_square,
    "integrate": moved,
    "differences": differences,
    "chart_rates": chart_rates,
    "accelerations": accelerations,
    "placements": placed,
    "separation_rows": pulled,
    "planar_separation_rows": pulled_in_plane,
    "first_of_lines": first_of_lines,
    "_choose_rows": struck,
    "carry_points": carried_points,
    "factor": factor,
    "factor_mass": factor,
    "whiten": back,
    "unwhiten": back,
    "unwhiten_four": unwhiten_four,
    "whiten_four": whiten_four,
    "squared": squared,
    "remove_parts": remove_parts,
    "remove_four": remove_four,
    "remove_one": remove_four,
    "factor_again": factor_again,
    "damp_slowed": damp_slowed,
    "solve": solve,
    "advance_by": advance_by,
    "is_damped": is_damped,
    "solve_active_set": solve_active_set,
    "newton_law": newton_law,
    "pivoted_cholesky": pivoted_cholesky,
    "solve_on_active": solve_on_active,
    "append_row": append_row,
    "inner": lambda rng: tuple(rng.normal(size=(2, int(rng.integers(0, 9))))),
    "remove_row": remove_row,
    "solve_lower": solve_triangle,
    "solve_upper": solve_triangle,
    "start_from": start_from,
    "first_set": first_set,
    "goldfarb_idnani": goldfarb_idnani,
    "newton_step": newton_step,
    "least_norm": least_norm,
    "least_violation": least_violation,
    "share": share,
    "scale_rows": scale_rows,
    "natural_residual": natural_residual,
    "tree_law": tree_law,
    "law_of_rows": law_of_rows,
    "frictional_tree_law": frictional_tree_law,
    "frictional_law_of_rows": frictional_law_of_rows,
    "tangent_rows": tangent_rows,
    "row": row,
    "turning_row": turning_row,
    "separation": separation,
    "write_bias": bias,
    "consume_clearance": consume_clearance,
    "list_candidates": list_candidates,
    "mutual_nearest": contacts_at_two_configurations,
    "goes_on": contacts_of_one_surface,
    "nearest_going_on": contacts_that_go_on,
    "write_axes": normals,
    "filter_active": filter_active,
    "lowest": lowest,
    "is_tilted": lambda rng: lowest(rng)[:4],
    "stand": stand,
    "half_space_rows": half_space_rows,
    "points_below": points_below,
    "spread_below": spread_below,
    "stays_above": stays_above,
    "few_of_each_face": few_of_each_face,
    "points_within": points_within_,
    "each_point_below": points_below,
    "few_points_within": few_points_within,
    "_limits_within": reached,
    "reach": reach,
    "separated": clear,
    "guess_axes": guess,
    "keep_normals": keep,
    "place_side": placing_side,
    "core_reach": core_reach,
    "place_shapes": placing_shapes,
    "near_boxes": near_boxes,
    "carry_axes": carry_axes,
    "row_products": row_products,
    "write_blocks": write_blocks,
    "sparse_separation_rows": sparse_separation_rows,
    "_write_row": write_row,
    "record_depth": note,
}
# how many of the last arguments mean something only where the kernel did not refuse
IF_ACCEPTED = {
    "factor": 1,
    "factor_mass": 1,
    "advance_by": 3,
    "goldfarb_idnani": 6,
    "share": 1,
    "solve_active_set": 2,
    "tree_law": 2,
    "frictional_tree_law": 4,
    "half_space_rows": 3,
    "_limits_within": 1,
}


def seeds(name):
    """One of three in turns for the kernels of the compiled loop: their arguments cost runs by the interpreter."""
    return [SEEDS[[*LOOP_ARGUMENTS].index(name) % 3]] if name in LOOP_ARGUMENTS else SEEDS


def arguments(item, seed):
    if item.__name__ in LOOP_ARGUMENTS:
        return LOOP_ARGUMENTS[item.__name__](np.random.default_rng(seed), seed)
    made = ARGUMENTS[item.__name__](np.random.default_rng(seed))
    # a copy of addresses would name the memory of the original
    return made if item.__name__ in {**ADDRESS_ARGUMENTS, **HELD_ROW_ARGUMENTS} else copy.deepcopy(made)


def accepted(name, result):
    """Whether a kernel that may refuse wrote an answer."""
    if name in ("factor", "factor_mass", "advance_by"):
        return result == 0
    if name in ("solve_active_set", "tree_law"):
        return 0.0 <= result < np.inf
    if name == "goldfarb_idnani":
        return result[0] >= 0
    if name == "frictional_tree_law":
        return 0.0 <= result[0] < np.inf
    return result[-1] if isinstance(result, tuple) else result


def specified(name, result, arguments):
    """What the plain form's description promises of the result and of the arguments afterwards."""
    if name in ADDRESS_ARGUMENTS:
        return results_by_address(name, arguments)
    if {name} & {*LOOP_ARGUMENTS, *HELD_ROW_ARGUMENTS, *SURFACE_ARGUMENTS, "write_torque"}:
        return [*(result if isinstance(result, tuple) else [result]), *(part for _, part in arrays_of(arguments))]
    # the last field of `Points` is scratch
    end = -1 if name in ("points_below", "half_space_rows") else None
    arguments = [part for one in arguments for part in (one[:end] if isinstance(one, tuple) else (one,))]
    if name in IF_ACCEPTED:
        yes = accepted(name, result)
        if not yes:
            del arguments[-IF_ACCEPTED[name] :]
        elif name == "goldfarb_idnani":
            # of dependent rows any may be active, but z is the same
            del arguments[4:8]
            return [yes, *arguments]
        return [*(result if isinstance(result, tuple) else [yes]), *arguments]
    if name == "_near_balls":
        return [result, np.sort(arguments[-1][:result])]
    if name in ("pairs_within", "wall_contacts"):
        # in their first places only
        return [result, *(part[:result] for part in arguments[-4:])]
    if name == "mesh_contacts":
        # all that is behind the contacts is scratch
        return [*result, *(part[: result[0]] for part in arguments[-4:])]
    if name == "gram":
        count = result[0] if isinstance(result, tuple) else result
        return [
            count,
            *arguments[:4],
            *([] if count > len(arguments[-1]) else [arguments[4], *(a[:count] for a in arguments[5:])]),
        ]
    if name == "incomplete_cholesky":
        rows, places, L = arguments[-3:]
        if not (result if isinstance(result, bool) else result[0]):
            return [False]
        return [True, rows, places[: rows[-1]], L[: rows[-1]]]
    if name in ("projected_pcg", "refine_subset", "solve_island", "_solve_islands"):
        # percussions may be shared between rows that depend on each other: what they bring about is the same
        starts, columns, G = arguments[:3]
        full = csr_array((G, columns, starts), shape=(len(starts) - 1, len(starts) - 1))
        label = arguments[4] if name == "_solve_islands" else np.zeros(len(starts) - 1, int)
        done = result if name == "refine_subset" else bool(result <= 1e-11)
        return [done, np.round(np.where(label < 0, 0.0, full @ arguments[-1]), 7)]
    if name in ("solve_left", "solve_working_set"):
        # the same of rows: what their percussions add up to
        data, columns, starts, n = arguments[:4]
        U = csr_array((data, columns, starts), shape=(len(starts) - 1, n))
        return [arguments[-2], np.round(U.T @ arguments[-1], 7)]
    if name == "held_tangents":
        # behind the basis there is what rounding leaves of tangents that depend on it
        L, Q = arguments[-2:]
        return [result, *arguments[:-2], np.tril(L)[: max(result, 0)], Q[: max(result, 0)]]
    if name == "diagonalise":
        # eigenvectors of equal eigenvalues may be any
        A, V = arguments
        return [np.diag(A), V @ np.diag(np.diag(A)) @ V.T, V @ V.T]
    if name == "strongest_tangents":
        Q = arguments[-1][:result]
        return [result, *arguments[:-1], Q.T @ Q]
    if name == "first_of_lines":
        return [result, arguments[-1][:result]]
    if name in ("list_candidates", "filter_active", "separated", "near_boxes"):
        # in its first places only
        count = result if name in ("separated", "near_boxes") else result[0]
        arguments[-1] = arguments[-1][:count]
    return [*(result if isinstance(result, tuple) else [result]), *arguments]


def equal(a, b):
    """Counts, truths and NaN exactly, numbers to rounding of the largest."""
    if a is None or np.asarray(a).dtype.kind in "biu":
        np.testing.assert_array_equal(a, b)
        return
    finite = np.abs(a)[np.isfinite(a)]
    np.testing.assert_allclose(b, a, rtol=1e-10, atol=max(1e-10 * finite.max(initial=0.0), 1e-13))

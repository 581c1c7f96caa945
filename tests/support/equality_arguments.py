"""Random equalities of robots, and arguments of the kernels that work on them."""

import numpy as np

from mbvi.projection.tree import factor
from mbvi.projection.tree_factor import span_equalities
from mbvi.system import ArticulatedSystem
from mbvi.system.mechanisms.equalities import CoupledJoints, PointRows, equalities_of
from support.robot_arguments import moving_robot, unit


def random_points(rng, model, name="points"):
    """A point of two bodies that coincides along some directions."""
    first, second = (int(k) for k in rng.permutation(model.njoints)[:2])
    m = int(rng.integers(1, 4))
    return PointRows(name, first, second, 0.1 * rng.normal(size=(m, 6)), unit(rng, m))


def random_coupling(rng, model, name="coupling"):
    """Two joints with one degree of freedom each; the ratio is whole where one turns without limits."""
    joints = [j for j in range(1, model.njoints) if model.nvs[j] == 1]
    first, second = (
        (model.idx_qs[j], model.idx_vs[j], model.nqs[j]) for j in (int(k) for k in rng.permutation(joints)[:2])
    )
    return CoupledJoints(name, first, second, float(rng.integers(-2, 3)), float(rng.normal()))


def tied_robot(rng, closed=False):
    """A robot with up to three equalities, a configuration, and a velocity."""
    free, q, v = moving_robot(rng)
    kinds = [random_points, random_coupling, random_points][: int(rng.integers(1, 4))]
    tied = ArticulatedSystem(free.model, free.name, None, [kind(rng, free.model) for kind in kinds])
    if closed:
        # the points of the second body are those of the first where it stands
        tied = ArticulatedSystem(free.model, free.name, None, [_met(one, free, q) for one in tied.equalities])
    tied.metric(q)
    return tied, q, v


def _met(one, system, q):
    poses = system.kinematics(q).poses
    if isinstance(one, CoupledJoints):
        places = [q[i] if n == 1 else np.arctan2(q[i + 1], q[i]) for i, _, n in (one.first, one.second)]
        return CoupledJoints(one.name, one.first, one.second, one.ratio, float(places[0] - one.ratio * places[1]))
    world = one.points[:, :3] @ poses[one.first, :3] + poses[one.first, 3]
    own = (world - poses[one.second, 3]) @ poses[one.second, :3].T
    return PointRows(one.name, one.first, one.second, np.hstack([one.points[:, :3], own]), one.normals)


def _factored(rng):
    system, q, v = tied_robot(rng)
    return system, np.array(system.evaluation.mass), np.array(system.metric(q).lower), v


def _spanned(rng):
    system, mass, L, _ = _factored(rng)
    m = len(mass) - system.nv
    if rng.random() < 0.3:
        mass[-1] = mass[system.nv]
    L[system.nv :] = np.nan
    R = np.full((m, m), np.nan) if rng.random() < 0.7 else np.zeros((0, 0))
    return mass, system.evaluation.parent, float(rng.choice([1e-9, 0.3])), L, R


def _along(rng):
    system, _, L, _ = _factored(rng)
    own = L[system.nv] * rng.normal()
    return L, own if rng.random() < 0.3 else rng.normal(size=system.nv)


def _kept(rng):
    system, _, L, v = _factored(rng)
    return L, system.evaluation.parent, v


def _advanced(rng):
    system, mass, L, v = _factored(rng)
    torque, effects = rng.normal(size=(2, system.nv))
    damping, known, changes, h = rng.random(system.nv), np.zeros(L.shape), np.zeros((2, system.nv)), 1e-2
    factor(mass, 0.5 * h, damping, system.evaluation.parent, known)
    known = known[: rng.choice([0, len(L)])]
    room = np.full(L.shape, np.nan), changes, np.full(system.nv, np.nan)
    return mass, damping, system.evaluation.parent, v, h, torque, effects, known, *room


def _changed(rng):
    system, mass, L, _ = _factored(rng)
    m = len(mass) - system.nv
    R = np.zeros((m, m))
    factor(mass, 0.0, system.damping, system.evaluation.parent, L)
    span_equalities(mass, system.evaluation.parent, 1e-9, L, R)
    return L, system.evaluation.parent, R, rng.normal(size=m), np.full(system.nv, np.nan)


def _gaps(rng):
    system, q, _ = tied_robot(rng)
    record = equalities_of(system.equalities, system.nq, system.nv)
    record.gap[:] = np.nan
    return record, np.array(system.kinematics(q).poses), np.array(q)


def _rows(rng):
    system, q, _ = tied_robot(rng)
    record = equalities_of(system.equalities, system.nq, system.nv)
    return record, *map(np.array, system.kinematics(q)), np.full(system.evaluation.mass.shape, np.nan)


def _value(rng):
    angle = rng.normal()
    return (np.array([np.cos(angle), np.sin(angle)]), 0, int(rng.integers(1, 3)))


def _matrices(rng):
    matrix = rng.normal(size=(4, 3))
    return matrix, np.full(matrix.shape, np.nan)


def _losing(rng):
    """Two or three parts, of which some have damping, dry friction or contacts."""
    n, k = 7, int(rng.integers(0, 4))
    part = np.sort(rng.integers(0, 3, size=n))
    J = rng.normal(size=(k, n)) * (part == rng.integers(0, 3, size=(k, 1)))
    damping, friction = ((rng.random(n) < 0.1).astype(float) for _ in range(2))
    e, mu, percussion = rng.choice([0.0, 1.0], size=k), rng.choice([0.0, 0.5], size=k), rng.choice([0.0, 1.0], size=k)
    return part, damping, friction, J, e, mu, percussion, np.zeros(n, bool)


EQUALITY_ARGUMENTS = {
    "span_equalities": _spanned,
    "mark_dissipating": _losing,
    "take_off": _along,
    "keep_equalities": _kept,
    "solve_keeping": _kept,
    "advance_keeping": _advanced,
    "subtract_equalities": _along,
    "least_change": _changed,
    "write_gaps": _gaps,
    "write_rows": _rows,
    "joint_value": _value,
    "copy_matrix": _matrices,
}

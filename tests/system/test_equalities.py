"""Equalities of a mechanism against finite differences, dense linear algebra and Pinocchio's constrained dynamics."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.linalg import null_space

from mbvi.projection.damped_rows import moving_rows
from mbvi.projection.tree import tangent
from mbvi.projection.tree_factor import span_equalities
from mbvi.system import ArticulatedSystem, BlockSystem, FreeBodies
from mbvi.system.mechanisms.equalities import CoupledJoints, PointRows
from support.equality_arguments import tied_robot

each_seed = pytest.mark.parametrize("seed", range(12))


def rows_of(system, q):
    """M and J_e at q."""
    system.metric(q)
    n = system.nv
    lower = np.tril(system.evaluation.mass[:n])
    return lower + np.tril(lower, -1).T, system.evaluation.mass[n:].copy()


def nearest(M, J, v):
    """The velocity nearest to v with J w = 0, by multipliers, which rows that depend on each other share."""
    G = J @ np.linalg.solve(M, J.T)
    return v - np.linalg.solve(M, J.T @ np.linalg.lstsq(G, J @ v, rcond=1e-12)[0])


@each_seed
def test_rows_are_the_gradients_of_the_gaps(seed):
    system, q, _ = tied_robot(np.random.default_rng(seed), closed=True)
    J, step = rows_of(system, q)[1], 1e-6
    free = ArticulatedSystem(system.model)
    for k, direction in enumerate(np.eye(system.nv)):
        ahead, behind = (system.gaps(free.integrate(q, sign * step * direction)) for sign in (1.0, -1.0))
        np.testing.assert_allclose((ahead - behind) / (2.0 * step), J[:, k], rtol=0.0, atol=1e-8)


@each_seed
def test_the_metric_is_that_of_the_velocities_that_keep_the_equalities(seed):
    rng = np.random.default_rng(seed)
    system, q, v = tied_robot(rng)
    M, J = rows_of(system, q)
    metric, gradients = system.metric(q), rng.normal(size=(5, system.nv))
    expected = np.array([nearest(M, J, w) for w in np.linalg.solve(M, gradients.T).T])
    scale = np.abs(expected).max()
    np.testing.assert_allclose(metric.solve_rows(gradients), expected, rtol=0.0, atol=1e-9 * scale)
    np.testing.assert_allclose(metric.unwhiten(metric.whiten(gradients.T)).T, expected, rtol=0.0, atol=1e-9 * scale)
    w = metric.tangent(v)
    np.testing.assert_allclose(w, nearest(M, J, v), rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(J @ w, 0.0, rtol=0.0, atol=1e-12 * np.abs(v).max())


@each_seed
def test_a_metric_may_keep_the_equalities_of_another_place(seed):
    """Of one mechanism, and of a part beside bodies, which have none."""
    rng = np.random.default_rng(seed)
    system, q, v = tied_robot(rng)
    M, metric = rows_of(system, q)[0], system.metric(q)
    there = ArticulatedSystem(system.model).integrate(q, 0.1 * rng.normal(size=system.nv))
    J = rows_of(system, there)[1]
    expected = nearest(M, J, v)
    np.testing.assert_allclose(system.keeping(there, metric).tangent(v), expected, rtol=0.0, atol=1e-9)
    bodies = FreeBodies(np.ones(1), np.eye(3)[None], np.zeros(3), ("body",))
    both, pose = BlockSystem([system, bodies]), np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    found = both.keeping(np.concatenate([there, pose]), both.metric(np.concatenate([q, pose])))
    twist = rng.normal(size=6)
    np.testing.assert_allclose(tangent(found, np.concatenate([v, twist])), [*expected, *twist], rtol=0.0, atol=1e-9)


@each_seed
@pytest.mark.parametrize("twice", [False, True])
def test_a_free_motion_keeps_the_equalities(seed, twice):
    """The velocity after it, or with `Centered` the mean velocity of the step, whose energy only forces change."""
    system, q, v = tied_robot(np.random.default_rng(seed))
    M, J = rows_of(system, q)
    v, h = system.tangent(q, v) + 1e-2 * v, 1e-2
    free = system.centered_motion(0.0, q, v, h, v).free if twice else system.free_motion(0.0, q, v, h).free
    kept = 0.5 * (v + free) if twice else free
    np.testing.assert_allclose(J @ kept, 0.0, rtol=0.0, atol=1e-12 * np.abs(v).max())
    if twice and not system.damping.any():
        force = system.force(0.0, q, v)
        gained = 0.5 * (free @ M @ free - v @ M @ v)
        assert abs(gained - h * force @ kept) <= 1e-12 * np.abs(M).max() * max(1.0, v @ v)


@each_seed
def test_damping_of_joints_acts_along_the_equalities(seed):
    """Order 2 is 2 E^3 - E^4 of implicit steps E of h / 2 in coordinates along the velocities that keep them."""
    system, q, v = tied_robot(np.random.default_rng(seed))
    model = system.model.copy()
    model.damping = np.random.default_rng(seed).uniform(0.0, 5.0, model.nv)
    # some of the files state dry friction, which changes the damping of a step
    model.upperDryFrictionLimit = np.zeros(model.nv)
    system, h = ArticulatedSystem(model, equalities=system.equalities), 1e-2
    M, J = rows_of(system, q)
    Z = null_space(J, rcond=1e-9)
    m, D = Z.T @ M @ Z, Z.T @ np.diag(system.damping) @ Z
    force = Z.T @ (system.force(0.0, q, v) + system.damping * v)
    start = np.linalg.solve(m, Z.T @ M @ v)
    ends = [start]
    for _ in range(4):
        ends.append(ends[-1] + np.linalg.solve(m + 0.5 * h * D, 0.5 * h * (force - D @ ends[-1])))
    kept = 0.5 * (v + system.centered_motion(0.0, q, v, h, v).free)
    expected = 0.5 * (start + 2.0 * ends[3] - ends[4])
    np.testing.assert_allclose(kept, Z @ expected, rtol=0.0, atol=1e-9 * np.abs(v).max())


@each_seed
def test_rows_that_equalities_hold_do_not_move(seed):
    """Sums of the equalities, and others, with and without a small part of one of these."""
    rng = np.random.default_rng(seed)
    system, q, _ = tied_robot(rng)
    metric, (_, J) = system.metric(q), rows_of(system, q)
    held, free = rng.normal(size=(3, len(J))) @ J, rng.normal(size=(3, system.nv))
    # of the same size without equalities
    bare = ArticulatedSystem(system.model).metric(q)
    free *= (np.linalg.norm(bare.whiten(held.T), axis=0) / np.linalg.norm(bare.whiten(free.T), axis=0))[:, None]
    assert not moving_rows(metric, np.concatenate([held, held + 1e-11 * free])).any()
    assert moving_rows(metric, np.concatenate([free, held + 1e-6 * free])).all()
    assert moving_rows(metric, free[:0]).size == 0


@each_seed
def test_an_open_mechanism_is_closed_by_the_least_displacement(seed):
    rng = np.random.default_rng(seed)
    system, q, _ = tied_robot(rng, closed=True)
    free = ArticulatedSystem(system.model)
    size, moved = 1e-3, rng.normal(size=system.nv)
    apart = free.integrate(q, size * moved)
    found = system.closed(apart)
    assert np.abs(system.gaps(found)).max() <= 3e-13
    M, J = rows_of(system, found)
    back = free.difference(apart, found)
    # to first order it is normal to the velocities that keep the equalities
    along = nearest(M, J, back)
    assert np.sqrt(along @ M @ along) <= 0.2 * np.sqrt(back @ M @ back)
    np.testing.assert_array_equal(system.closed(found), found)


@pytest.mark.parametrize("robot", ["free", "fixed"])
def test_accelerations_are_those_of_pinocchio(robot):
    """Of a tree of random joints with two pairs of points that coincide."""
    rng = np.random.default_rng(3)
    pin.seed(3)
    model = pin.Model()
    joint = 0
    kinds = [pin.JointModelFreeFlyer() if robot == "free" else pin.JointModelRY(), pin.JointModelRX()]
    kinds += [pin.JointModelSpherical(), pin.JointModelRevoluteUnaligned(np.array([0.6, 0.0, 0.8])), pin.JointModelPZ()]
    kinds += [pin.JointModelRZ(), pin.JointModelRUBX()]
    for k, kind in enumerate(kinds):
        joint = model.addJoint(joint if k != 4 else 2, kind, pin.SE3.Random(), f"joint_{k}")
        model.appendBodyToJoint(joint, pin.Inertia.Random(), pin.SE3.Identity())
    q = pin.integrate(model, pin.neutral(model), rng.normal(size=model.nv))
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    rows, constraints = [], pin.StdVec_RigidConstraintModel()
    for first, second in ((4, 7), (2, 5)):
        place = rng.normal(size=3)
        own = data.oMi[second].actInv(data.oMi[first].act(place))
        rows.append(PointRows(f"{first}", first, second, np.tile(np.concatenate([place, own]), (3, 1)), np.eye(3)))
        ends = (pin.SE3(np.eye(3), place), pin.SE3(np.eye(3), own))
        constraints.append(
            pin.RigidConstraintModel(
                pin.ContactType.CONTACT_3D, model, first, ends[0], second, ends[1], pin.ReferenceFrame.LOCAL
            )
        )
    kept = pin.StdVec_RigidConstraintData()
    for one in constraints:
        kept.append(one.createData())
    system = ArticulatedSystem(model, equalities=rows)
    v = system.tangent(q, rng.normal(size=model.nv))
    pin.initConstraintDynamics(model, data, constraints, kept)
    settings = pin.ProximalSettings(1e-14, 1e-12, 100)
    expected = pin.constraintDynamics(model, data, q, v, np.zeros(model.nv), constraints, kept, settings)
    np.testing.assert_allclose(system.acceleration(0.0, q, v), expected, rtol=0.0, atol=1e-9 * np.abs(expected).max())


def test_rows_that_are_said_twice_change_nothing():
    system, q, v = tied_robot(np.random.default_rng(5), closed=True)
    twice = ArticulatedSystem(system.model, equalities=(*system.equalities, *system.equalities))
    np.testing.assert_allclose(twice.tangent(q, v), system.tangent(q, v), rtol=0.0, atol=1e-12 * np.abs(v).max())
    moved = [one.integrate(q, 1e-2 * one.tangent(q, v)) for one in (system, twice)]
    np.testing.assert_allclose(*moved, rtol=0.0, atol=1e-12)


def test_a_coupled_joint_moves_as_one_that_was_left_out():
    """M and forces on the joints that are left: those of the whole mechanism with q_a = ratio q_b put in."""
    model = pin.buildSampleModelManipulator()
    lead, follower, ratio = 1, 3, -2.0
    joints = [(model.idx_qs[j], model.idx_vs[j], 1) for j in (follower + 1, lead + 1)]
    system = ArticulatedSystem(model, equalities=[CoupledJoints("both", *joints, ratio, 0.1)])
    rng = np.random.default_rng(1)
    q = system.closed(rng.normal(size=model.nq))
    assert abs(q[follower] - ratio * q[lead] - 0.1) <= 1e-13
    put = np.delete(np.eye(model.nv), follower, axis=1)
    put[follower, lead] = ratio
    v, h = put @ rng.normal(size=model.nv - 1), 1e-3
    M = rows_of(system, q)[0]
    expected = v + h * put @ np.linalg.solve(put.T @ M @ put, put.T @ system.force(0.0, q, v))
    np.testing.assert_allclose(system.free_motion(0.0, q, v, h).free, expected, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("size", [1.0, 1e-3, 1e-6])
def test_the_basis_is_orthonormal_also_where_rows_are_nearly_parallel(size):
    """Of six bodies on slides with the mass 1, whose factor is the identity."""
    rng, n, m = np.random.default_rng(5), 6, 4
    rows = rng.normal(size=n) + size * rng.normal(size=(m, n))
    mass, L, R = np.vstack([np.eye(n), rows]), np.zeros((n + m, n)), np.zeros((m, m))
    L[:n] = np.eye(n)
    assert span_equalities(mass, np.full(n, -1), 1e-9, L, R) == m
    np.testing.assert_allclose(L[n:] @ L[n:].T, np.eye(m), atol=1e-14)
    np.testing.assert_allclose(R @ L[n:], rows, atol=1e-14)

"""The projection onto many sparse rows: the same problem as onto full ones, and the same answer."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import csr_array, vstack

import mbvi
from mbvi.compiled import compile_all
from mbvi.projection import BodiesMetric, DiagonalMetric, Projector
from mbvi.projection.sparse.accelerated_sweeps import accelerated_sweeps, extrapolate, sweep
from mbvi.projection.sparse.refinement import refine_subset, solve_island
from mbvi.system.free.sparse_rows import rows_of_two

SEEDS = st.integers(0, 10_000)


def heap(rng, n, walls=True):
    """Unit spheres thrown together: the rows of those that touch, the metric, and a velocity that presses them."""
    size = (1.2 * n) ** (1 / 3)
    centres = size * rng.random((n, 3))
    i, j = np.triu_indices(n, 1)
    apart = centres[j] - centres[i]
    near = np.linalg.norm(apart, axis=1) < 1.3
    first, second, normal = i[near] + 1, j[near] + 1, apart[near] / np.linalg.norm(apart[near], axis=1)[:, None]
    if walls:
        low = np.flatnonzero(centres[:, 2] < 0.7) + 1
        first, second = np.append(first, np.zeros(len(low), int)), np.append(second, low)
        normal = np.vstack([normal, np.tile([0.0, 0.0, 1.0], (len(low), 1))])
    J = rows_of_two(3 * n, True, first, second, -normal, normal)
    metric = DiagonalMetric(np.repeat(10.0 ** rng.uniform(-1.0, 1.0, n), 3))
    x = rng.normal(size=3 * n) - np.tile([0.0, 0.0, 2.0], n)
    return x, metric, J


def natural_residual(x, metric, J, lower, w, p):
    """The KKT residual and the error of the balance, from nothing but the problem and its answer."""
    full = J.toarray()
    lengths = np.sqrt(np.diag(full @ np.linalg.solve(metric.dense(), full.T)))
    largest = ((np.abs(J @ x) + np.abs(lower)) / lengths).max()
    complementarity = np.abs(np.minimum(p * lengths, (J @ w - lower) / lengths)).max() / largest
    balance = np.abs(metric.apply(w - x) - J.T @ p).max() / np.abs(metric.apply(w - x)).max()
    return complementarity, balance


@settings(deadline=None, max_examples=20)
@given(SEEDS, st.sampled_from([1e-4, 1e-7, 1e-10]))
def test_the_answer_meets_the_conditions_to_the_residual_that_was_asked(seed, residual):
    rng = np.random.default_rng(seed)
    x, metric, J = heap(rng, 60)
    lower = -0.3 * rng.random(J.shape[0])
    w, p, told = Projector(residual).project(x, metric, J, lower)
    assert (p >= 0.0).all()
    found, balance = natural_residual(x, metric, J, lower, w, p)
    assert found <= residual
    assert told == pytest.approx(found, rel=1e-3, abs=1e-13)
    assert balance < 1e-12


def unit_rows(rng, n):
    """Sparse unit rows of a heap as the kernels take them, their matrix, and violations that some velocity removes."""
    _, metric, J = heap(rng, n)
    U = metric.whiten_rows(J)
    U = csr_array(U / np.sqrt((U * U).sum(axis=1))[:, None])
    told = U.data, U.indices.astype(np.uint32), U.indptr.astype(np.uint32)
    return told, U, U @ rng.normal(size=U.shape[1]) - 0.3 * rng.random(U.shape[0])


@settings(deadline=None, max_examples=12)
@given(SEEDS)
def test_a_sweep_lowers_the_energy_and_both_kernels_keep_the_velocity(seed):
    rng = np.random.default_rng(seed)
    told, U, d = unit_rows(rng, 60)
    u, last = rng.random(len(d)), rng.random(len(d))
    z, last_z, before = U.T @ u, U.T @ last, u.copy()
    change, uphill = sweep(*told, d, last, z, u)
    assert (u >= 0.0).all()
    assert change == np.abs(u - before).max()
    assert uphill == pytest.approx((before - u) @ (u - last), abs=1e-12)
    np.testing.assert_allclose(z, U.T @ u, atol=1e-12)
    assert 0.5 * z @ z - d @ u < 0.5 * (U.T @ before) @ (U.T @ before) - d @ before
    after = u.copy()
    extrapolate(*told, 0.7, last_z, last, z, u)
    assert (last == after).all()
    assert (u >= 0.0).all()
    np.testing.assert_allclose(z, U.T @ u, atol=1e-12)


@settings(deadline=None, max_examples=12)
@given(SEEDS, st.sampled_from([1e-2, 1e-4, 1e-6]))
def test_accelerated_sweeps_tell_their_residual_and_stay_where_it_is_reached(seed, target):
    rng = np.random.default_rng(seed)
    told, U, d = unit_rows(rng, 80)
    u, z = np.zeros(len(d)), np.empty(U.shape[1])
    reached = accelerated_sweeps(*told, d, target, 2000, z, u)
    assert reached <= target
    assert reached == pytest.approx(np.abs(np.minimum(u, U @ (U.T @ u) - d)).max(), rel=1e-6, abs=1e-14)
    np.testing.assert_allclose(z, U.T @ u, atol=1e-12)
    found = u.copy()
    assert accelerated_sweeps(*told, d, target, 2000, z, u) == reached
    assert (u == found).all()


@settings(deadline=None, max_examples=12)
@given(SEEDS, st.sampled_from([1e-2, 1e-3, 1e-8]))
def test_no_residual_raises_the_kinetic_energy(seed, residual):
    """The largest residual included: percussions do no work beyond that of the bounds."""
    rng = np.random.default_rng(seed)
    v, metric, J = heap(rng, 60)
    lower = -rng.random(J.shape[0]) * (rng.random(J.shape[0]) < 0.3)
    found = Projector(residual).project(v, metric, J, lower)
    before, after = v @ metric.apply(v), found.velocity @ metric.apply(found.velocity)
    assert found.percussion.any()
    assert found.percussion @ (J @ found.velocity - lower) == pytest.approx(0.0, abs=1e-9 * before)
    assert after <= before * (1.0 + 1e-12)


def test_acceleration_solves_a_column_in_a_tenth_of_the_sweeps():
    """Sweeps upwards carry the weight of a column of equal spheres one sphere down at a time."""
    height, target = 40, 1e-4
    up = np.tile([0.0, 0.0, 1.0], (height, 1))
    J = rows_of_two(3 * height, True, np.arange(height), np.arange(1, height + 1), -up, up)
    U = csr_array(J / np.sqrt((J * J).sum(axis=1))[:, None])
    told = U.data, U.indices.astype(np.uint32), U.indptr.astype(np.uint32)
    d, u, z, plain = U @ np.tile([0.0, 0.0, 1.0], height), np.zeros(height), np.zeros(3 * height), 0
    while np.abs(np.minimum(u, U @ z - d)).max() > target:
        sweep(*told, d, u.copy(), z, u)
        plain += 1
    assert plain > 1000
    found = np.zeros(height)
    assert accelerated_sweeps(*told, d, target, plain // 10, z, found) <= target
    np.testing.assert_allclose(z, np.tile([0.0, 0.0, 1.0], height), atol=0.1)


@settings(deadline=None, max_examples=12)
@given(SEEDS, st.integers(1, 4))
def test_a_refined_subset_lowers_the_energy_and_leaves_rows_far_away_alone(seed, count):
    rng = np.random.default_rng(seed)
    _, metric, J = heap(rng, 60)
    full = metric.whiten_rows(J).toarray()
    full /= np.linalg.norm(full, axis=1)[:, None]
    G = csr_array(full @ full.T)
    d = full @ rng.normal(size=full.shape[1]) - 0.3 * rng.random(len(full))
    told = G.indptr.astype(np.uint32), G.indices.astype(np.uint32), G.data
    compile_all()
    target, u = 1e-9, np.zeros(len(d))
    assert solve_island(*told, d, 0.1 * target, u) <= 0.1 * target
    spoiled = rng.choice(len(d), count, replace=False)
    u[spoiled] += rng.random(count)
    before, g = u.copy(), G @ u - d
    off = np.abs(np.minimum(u, g)) > 0.5 * target
    near = (np.abs(G) @ off) > 0.0
    assert refine_subset(*told, target, g, u)
    after = G @ u - d
    assert np.abs(np.minimum(u, after))[near].max() <= 0.3 * target
    assert (u[~near] == before[~near]).all()
    assert 0.5 * u @ (after - d) < 0.5 * before @ (g - d)


@settings(deadline=None, max_examples=12)
@given(SEEDS)
def test_sparse_rows_and_full_ones_give_the_same_velocity(seed):
    rng = np.random.default_rng(seed)
    x, metric, J = heap(rng, 25)
    lower = -0.3 * rng.random(J.shape[0])
    sparse = Projector(1e-11).project(x, metric, J, lower).velocity
    full = Projector(1e-9).project(x, metric, J.toarray(), lower).velocity
    np.testing.assert_allclose(sparse, full, atol=1e-8)


@settings(deadline=None, max_examples=12)
@given(SEEDS)
def test_islands_do_not_see_each_other(seed):
    """Heaps solved together and each for itself."""
    rng = np.random.default_rng(seed)
    parts = [heap(rng, 30), heap(rng, 20, walls=False), heap(rng, 40)]
    x = np.concatenate([part[0] for part in parts])
    metric = DiagonalMetric(np.concatenate([part[1].diagonal for part in parts]))
    n, start, rows = len(x), 0, []
    for part in parts:
        J = part[2]
        rows.append(csr_array((J.data, J.indices + start, J.indptr), shape=(J.shape[0], n)))
        start += J.shape[1]
    together = Projector(1e-11).project(x, metric, vstack(rows, format="csr"), np.zeros(sum(r.shape[0] for r in rows)))
    apart = [Projector(1e-11).project(p[0], p[1], p[2], np.zeros(p[2].shape[0])).velocity for p in parts]
    np.testing.assert_allclose(together.velocity, np.concatenate(apart), atol=1e-8)


def test_rows_that_stand_twice_change_nothing(rng):
    x, metric, J = heap(rng, 60)
    once = Projector(1e-10).project(x, metric, J, np.zeros(J.shape[0]))
    lower = np.concatenate([np.zeros(J.shape[0]), np.full(J.shape[0], -0.1), np.zeros(J.shape[0])])
    again = Projector(1e-10).project(x, metric, vstack([J, J, J], format="csr"), lower)
    np.testing.assert_allclose(again.velocity, once.velocity, atol=1e-8)
    assert again.residual <= 1e-10


@pytest.mark.parametrize("height", [10, 60])
def test_a_column_under_a_million_times_its_mass_comes_to_rest(height):
    floor, above = np.arange(height), np.arange(1, height + 1)
    up = np.tile([0.0, 0.0, 1.0], (height, 1))
    J = rows_of_two(3 * height, True, floor, above, -up, up)
    masses = np.ones(height)
    masses[-1] = 1e6
    metric, x = DiagonalMetric(np.repeat(masses, 3)), np.tile([0.0, 0.0, -0.02], height)
    w, p, residual = Projector(1e-9).project(x, metric, J, np.zeros(height))
    assert residual <= 1e-9
    # each contact carries what is above it
    np.testing.assert_allclose(p, 0.02 * np.cumsum(masses[::-1])[::-1], rtol=1e-6)
    assert np.abs(w).max() < 1e-5


@pytest.mark.parametrize("count", [2, 30])
def test_boxes_on_too_many_corners_carry_their_weight(count):
    """Columns of boxes, four points a face: percussions are not unique, their sums are."""
    corners = 0.1 * np.array([[a, b, 0.0] for a in (-1, 1) for b in (-1, 1)])
    first, second = np.repeat(np.arange(count), 4), np.repeat(np.arange(1, count + 1), 4)
    up, arm = np.tile([0.0, 0.0, 1.0], (4 * count, 1)), np.tile(corners, (count, 1))
    pull = np.concatenate([up, np.cross(arm, up)], axis=1)
    J = rows_of_two(6 * count, True, first, second, -pull, pull)
    metric = BodiesMetric(np.tile(np.diag([1.0, 1.0, 1.0, 0.01, 0.01, 0.01]), (count, 1, 1)))
    x = np.tile([0.0, 0.0, -0.02, 0.0, 0.0, 0.0], count)
    w, p, residual = Projector(1e-9).project(x, metric, J, np.zeros(4 * count))
    assert residual <= 1e-9
    assert np.abs(w).max() < 1e-8
    np.testing.assert_allclose(p.reshape(-1, 4).sum(axis=1), 0.02 * np.arange(count, 0, -1), rtol=1e-6)


def test_percussions_are_carried_by_what_names_a_contact(rng):
    """In another order, with rows gone and rows new, an answer found before is found at once: bit for bit the same."""
    x, metric, J = heap(rng, 80)
    lower, names = np.zeros(J.shape[0]), 10 * np.arange(J.shape[0])
    projector = Projector(1e-8)
    first = projector.project(x, metric, J, lower, names)
    assert first.percussion.any()
    order = rng.permutation(J.shape[0])
    again = projector.project(x, metric, J[order], lower, names[order])
    cold = Projector(1e-8).project(x, metric, J[order], lower)
    large = np.abs(again.percussion - first.percussion[order]).max()
    assert large <= 1e-12 * first.percussion.max() < np.abs(cold.percussion - first.percussion[order]).max()


def test_rows_that_contradict_each_other_are_named_so():
    push = np.tile([1.0, 0.0, 0.0], (2, 1)) * np.array([[1.0], [-1.0]])
    J = rows_of_two(120, True, np.zeros(2, int), np.ones(2, int), -push, push)
    with pytest.raises(mbvi.InfeasibleError):
        Projector().project(np.zeros(120), DiagonalMetric(np.ones(120)), J, np.full(2, 0.1))


def test_a_row_without_a_gradient_asks_for_nothing_or_for_too_much():
    J = csr_array((np.array([0.0, 1.0]), np.array([0, 1]), np.array([0, 1, 2])), shape=(2, 120))
    metric, x = DiagonalMetric(np.ones(120)), np.full(120, -1.0)
    w, p, _ = Projector().project(x, metric, J, np.array([-0.1, 0.0]))
    np.testing.assert_allclose([w[1], p[0], p[1]], [0.0, 0.0, 1.0], atol=1e-12)
    with pytest.raises(mbvi.ProjectionError):
        Projector().project(x, metric, J, np.array([0.1, 0.0]))


def test_a_user_may_give_sparse_rows_and_solve_a_failed_problem_again(rng):
    x, metric, J = heap(rng, 60)
    expected = Projector(1e-10).project(x, metric, J, np.zeros(J.shape[0])).velocity
    found = mbvi.project(x, metric, J)
    assert found.residual <= 1e-6
    np.testing.assert_allclose(found.velocity, expected, atol=1e-4)
    np.testing.assert_allclose(mbvi.project(x, metric.dense(), J.tocsc()).velocity, expected, atol=1e-4)
    push = np.tile([1.0, 0.0, 0.0], (2, 1)) * np.array([[1.0], [-1.0]])
    contradiction = rows_of_two(120, True, np.zeros(2, int), np.ones(2, int), -push, push)
    with pytest.raises(mbvi.InfeasibleError) as error:
        mbvi.project(np.zeros(120), np.eye(120), contradiction, 0.1)
    with pytest.raises(mbvi.InfeasibleError):
        mbvi.project(**error.value.problem)


def test_what_moves_as_one_misses_nothing_but_rounding():
    """Rows of grains that touch, all at one speed: J x is the rounding of that speed, and no scale of its own."""
    rng = np.random.default_rng(3)
    normals = rng.normal(size=(300, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    first = rng.integers(1, 60, 300)
    second = first + rng.integers(1, 5, 300)
    J = rows_of_two(192, True, first, second, -normals, normals)
    x = np.tile([0.1, 0.2, 0.668547884], 64)
    assert 0.0 < np.abs(J @ x).max() < 1e-15
    found = mbvi.project(x, np.diag(np.full(192, 0.1)), J, 0.0)
    np.testing.assert_allclose(found.velocity, x, rtol=1e-14)

"""Coulomb's law for many contacts: its statement from outside, energy, and the same answers as the dense solvers."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import block_array, csr_array

import mbvi
from mbvi.projection import DiagonalMetric, Projector, project_frictional_sparse
from mbvi.projection.coulomb.friction import project_frictional
from mbvi.projection.coulomb.sweeps import accelerated_contacts
from support.contact_block_arguments import packed
from support.friction_heap import law_residual, of_normals, sphere_heap

SEEDS = st.integers(0, 10_000)


@settings(deadline=None, max_examples=25)
@given(SEEDS, st.sampled_from([1e-2, 1e-3, 1e-4]))
def test_the_answer_meets_coulombs_law_to_the_residual_that_was_asked(seed, residual):
    rng = np.random.default_rng(seed)
    x, metric, J = sphere_heap(rng, 40)
    m = J.shape[0] // 3
    mu, lower = rng.choice([0.0, 0.2, 0.5], size=m), of_normals(-0.3 * rng.random(m) * (rng.random() < 0.5))
    if rng.random() < 0.3:
        # what they touch moves
        lower.reshape(m, 3)[:, 1:] = 0.3 * rng.normal(size=(m, 2))
    w, p, told = project_frictional_sparse(x, metric, J, lower, mu, residual)
    found = law_residual(x, metric, J, lower, mu, p)
    assert found <= residual
    assert told == pytest.approx(found, rel=1e-6, abs=1e-13)
    np.testing.assert_allclose(metric.apply(w - x), J.T @ p, atol=1e-11 * np.abs(metric.apply(w - x)).max())
    # percussions lie in the cones
    assert (np.hypot(p[1::3], p[2::3]) <= (1.0 + 1e-12) * mu * p[::3]).all()


@settings(deadline=None, max_examples=25)
@given(SEEDS, st.sampled_from([0.0, 0.3, 0.6]))
def test_without_restitution_the_kinetic_energy_never_rises(seed, mu):
    """Up to what the residual may do."""
    rng = np.random.default_rng(seed)
    x, metric, J = sphere_heap(rng, 30)
    m = J.shape[0] // 3
    w = project_frictional_sparse(x, metric, J, np.zeros(3 * m), np.full(m, mu), 1e-4).velocity
    before, after = x @ metric.apply(x), w @ metric.apply(w)
    assert after <= (1.0 + 1e-3) * before


@settings(deadline=None, max_examples=25)
@given(SEEDS)
def test_where_rows_are_independent_the_answer_is_that_of_the_dense_solver(seed):
    rng = np.random.default_rng(seed)
    x, metric, J = sphere_heap(rng, 12, 3.0)
    m = J.shape[0] // 3
    if m == 0 or m > 30 or np.linalg.svd(J.toarray(), compute_uv=False)[-1] < 0.1:
        return
    mu, lower = np.full(m, 0.2), np.zeros(3 * m)
    dense = project_frictional(x, metric, J.toarray(), lower, mu)
    found = project_frictional_sparse(x, metric, J, lower, mu, 1e-9)
    np.testing.assert_allclose(found.velocity, dense.velocity, atol=1e-6 * np.abs(x).max())
    np.testing.assert_allclose(found.percussion, dense.percussion, atol=1e-5 * np.abs(dense.percussion).max(initial=0))


def test_contacts_without_friction_give_the_projection_of_the_paper(rng):
    x, metric, J = sphere_heap(rng, 40)
    m = J.shape[0] // 3
    lower = -0.3 * rng.random(m)
    found = project_frictional_sparse(x, metric, J, of_normals(lower), np.zeros(m), 1e-8)
    expected = Projector(1e-10).project(x, metric, J[::3], lower)
    np.testing.assert_allclose(found.velocity, expected.velocity, atol=1e-6 * np.abs(x).max())
    assert not found.percussion.reshape(m, 3)[:, 1:].any()
    # such contacts need no tangents
    bare = J.toarray().reshape(m, 3, -1)
    bare[:, 1:] = 0.0
    bare = csr_array(bare.reshape(3 * m, -1))
    again = project_frictional_sparse(x, metric, bare, of_normals(lower), np.zeros(m), 1e-8)
    np.testing.assert_allclose(again.velocity, found.velocity, atol=1e-6 * np.abs(x).max())
    assert law_residual(x, metric, bare, of_normals(lower), np.zeros(m), again.percussion) <= 1e-8


def test_percussions_of_an_answer_start_the_next(rng):
    x, metric, J = sphere_heap(rng, 40)
    m = J.shape[0] // 3
    mu, lower = np.full(m, 0.5), np.zeros(3 * m)
    first = project_frictional_sparse(x, metric, J, lower, mu, 1e-4)
    again = project_frictional_sparse(x, metric, J, lower, mu, 1.2e-4, first.percussion)
    # they fit already, so that no sweep changes them
    np.testing.assert_allclose(again.percussion, first.percussion, atol=1e-13 * first.percussion.max())
    repeated = project_frictional_sparse(x, metric, J, lower, mu, 1e-4)
    assert repeated.velocity.tobytes() == first.velocity.tobytes()


@pytest.mark.parametrize("seed", [4, 8, 12])
def test_strong_friction_needs_percussions_that_are_held_back(seed):
    """Accelerated sweeps alone do not reach the residual."""
    rng = np.random.default_rng(seed)
    x, metric, J = sphere_heap(rng, 40)
    m = J.shape[0] // 3
    mu, lower = np.full(m, 1.0), np.zeros(3 * m)
    p = project_frictional_sparse(x, metric, J, lower, mu).percussion
    assert law_residual(x, metric, J, lower, mu, p) <= 1e-3
    U = metric.whiten_rows(J)
    blocks, columns, starts, local = packed(U)
    scale = local[:, 6]
    b = (J @ x).reshape(m, 3) * scale[:, None]
    cos, sin = local[:, 4], local[:, 5]
    turned = np.column_stack([b[:, 0], cos * b[:, 1] + sin * b[:, 2], cos * b[:, 2] - sin * b[:, 1]])
    rows = blocks, columns, starts, local, turned.ravel(), mu, np.full(m, -1), 1e-3 * np.abs(b).max(), 1000
    assert accelerated_contacts(*rows, np.empty(len(x)), np.zeros(3 * m)) > rows[-2]


def test_islands_do_not_see_each_other(rng):
    x, metric, J = sphere_heap(rng, 30)
    m = J.shape[0] // 3
    both = block_array([[J, None], [None, J]], format="csr")
    alone = project_frictional_sparse(x, metric, J, np.zeros(3 * m), np.full(m, 0.5))
    found = project_frictional_sparse(
        np.tile(x, 2), DiagonalMetric(np.tile(metric.diagonal, 2)), both, np.zeros(6 * m), np.full(2 * m, 0.5)
    )
    np.testing.assert_array_equal(found.velocity, np.tile(alone.velocity, 2))


def test_newton_solves_a_column_with_heavy_bodies_on_light_ones():
    """Boxes with four contacts between each two; sweeps stop at 1e-4."""
    n, up = 9, np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    mass, rows = 100.0 ** (np.arange(n) / (n - 1)), []
    for k in range(n):
        for x in (-0.1, 0.1):
            for y in (-0.1, 0.1):
                row = np.zeros((3, 6 * n))
                row[:, 6 * k : 6 * k + 6] = np.hstack([up, np.cross((x, y, -0.1), up)])
                if k > 0:
                    row[:, 6 * k - 6 : 6 * k] = -np.hstack([up, np.cross((x, y, 0.1), up)])
                rows.append(row)
    J, metric = csr_array(np.vstack(rows)), DiagonalMetric(np.column_stack([*[mass] * 3, *[mass / 150.0] * 3]).ravel())
    x, mu, lower = np.tile([0.0, 0.0, -1e-2, 0.0, 0.0, 0.0], n), np.full(4 * n, 0.5), np.zeros(12 * n)
    p = project_frictional_sparse(x, metric, J, lower, mu, 1e-8).percussion
    assert law_residual(x, metric, J, lower, mu, p) <= 1e-8
    # the floor bears the weight
    np.testing.assert_allclose(p[:12:3].sum(), 1e-2 * mass.sum(), rtol=1e-6)


def block_on_incline(angle):
    """A unit mass on a slope, its normal first: x is the step of gravity."""
    x = 0.1 * np.array([np.sin(angle), 0.0, -np.cos(angle)])
    return x, DiagonalMetric(np.ones(3)), csr_array(np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]))


@pytest.mark.parametrize("steeper", [0.999, 1.001])
def test_a_mass_on_a_slope_slips_above_the_angle_of_friction(steeper):
    angle = np.arctan(0.5 * steeper)
    x, metric, J = block_on_incline(angle)
    w = project_frictional_sparse(x, metric, J, np.zeros(3), np.array([0.5]), 1e-12).velocity
    expected = max(0.1 * (np.sin(angle) - 0.5 * np.cos(angle)), 0.0)
    np.testing.assert_allclose(w, [expected, 0.0, 0.0], atol=1e-15)


def test_a_residual_that_is_not_reached_is_an_error_with_the_problem(rng):
    x, metric, J = sphere_heap(rng, 20)
    # two rows that demand the opposite of each other
    J = csr_array(np.vstack([J.toarray(), -J[:3].toarray()]))
    m = J.shape[0] // 3
    lower = np.zeros(3 * m)
    lower[[0, -3]] = 1.0
    with pytest.raises(mbvi.ProjectionError, match="Coulomb's law") as caught:
        project_frictional_sparse(x, metric, J, lower, np.full(m, 0.5))
    assert caught.value.problem["J"] is J
    assert caught.value.residual > 1e-3


def test_a_contact_whose_normal_moves_no_body_bears_nothing(rng):
    x, metric, J = sphere_heap(rng, 20)
    m = J.shape[0] // 3
    full = J.toarray()
    full[:3] = 0.0
    lower = np.zeros(3 * m)
    found = project_frictional_sparse(x, metric, csr_array(full), lower, np.full(m, 0.5))
    assert not found.percussion[:3].any()
    lower[0] = 1.0
    with pytest.raises(mbvi.ProjectionError, match="normal row vanishes"):
        project_frictional_sparse(x, metric, csr_array(full), lower, np.full(m, 0.5))

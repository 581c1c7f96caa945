"""Sparse rows of many bodies: products, choices and stacks as scipy makes them, and few rows on the columns touched."""

import numpy as np
import pytest
from scipy.sparse import csr_array

import mbvi
from mbvi.projection import DiagonalMetric, FreeMotion, Projector
from mbvi.projection.row_speeds import times
from mbvi.projection.sparse.column_blocks import touched_columns
from mbvi.system.free.sparse_rows import stack_rows, take_rows


def sparse_rows(rng, m, n=12):
    full = rng.normal(size=(m, n)) * (rng.random((m, n)) < 0.3)
    return csr_array(full), full


@pytest.mark.parametrize("seed", range(20))
def test_sparse_rows_are_those_of_full_arrays(seed):
    rng = np.random.default_rng(seed)
    rows, full = sparse_rows(rng, int(rng.integers(0, 9)))
    v, mask = rng.normal(size=12), rng.random(len(full)) < 0.5
    index = rng.integers(0, max(len(full), 1), 5)[: len(full)]
    for one in (rows, full):
        assert (times(one, v) == rows @ v).all() if one is rows else np.allclose(times(one, v), full @ v)
        for chosen in (mask, index):
            taken = take_rows(one, chosen)
            assert type(taken) is type(one)
            np.testing.assert_array_equal(csr_array(taken).toarray(), full[chosen])
    others, more = sparse_rows(rng, 4)
    stacked = stack_rows([rows, others, full])
    np.testing.assert_array_equal(stacked.toarray(), np.concatenate([full, more, full]))
    np.testing.assert_array_equal((stacked @ v), csr_array(stacked.toarray()) @ v)
    part, here = touched_columns(rows)
    np.testing.assert_array_equal(part, np.flatnonzero(full.any(axis=0)))
    np.testing.assert_array_equal(here, full[:, part])


@pytest.mark.parametrize("seed", range(10))
def test_few_sparse_rows_are_projected_as_the_dense_ones(seed):
    """The law and the projection of spheres, most of which no row touches."""
    rng = np.random.default_rng(seed)
    n, m = 90, int(rng.integers(1, 12))
    full = np.zeros((m, n))
    for row in full:
        i, j = 3 * rng.choice(n // 3, 2, replace=False)
        row[i : i + 3] = rng.normal(size=3)
        row[j : j + 3] = -row[i : i + 3]
    x, v, e, lower = rng.normal(size=n), rng.normal(size=n), rng.choice([0.0, 0.5, 1.0], m), -rng.random(m)
    metric = DiagonalMetric(rng.uniform(0.5, 5.0, n // 3).repeat(3))
    sparse, dense = (Projector().project(x, metric, J, lower, np.arange(m)) for J in (csr_array(full), full))
    np.testing.assert_allclose(sparse.velocity, dense.velocity, atol=1e-12)
    assert (full @ sparse.velocity >= lower - 1e-12).all() and (sparse.percussion >= 0.0).all()
    w, rates, residual = Projector().law(v, FreeMotion(x, metric), csr_array(full), e, np.arange(m))
    expected, *_ = Projector().law(v, FreeMotion(x, metric), full, e)
    np.testing.assert_allclose(w, expected, atol=1e-12)
    np.testing.assert_allclose(metric.apply(w - x), full.T @ rates[0], atol=1e-12)
    np.testing.assert_allclose(rates[1:], [full @ x, full @ w, full @ v], atol=1e-12)
    assert residual < 1e-12
    # what no row touches moves as without rows, to the bit
    apart = ~full.any(axis=0)
    np.testing.assert_array_equal(w[apart], x[apart])


def test_spheres_that_turn_are_one_system_with_the_other_bodies():
    scene = mbvi.Scene(friction=0.3)
    scene.add_halfspace((0, 0, 1))
    scene.add_box((0.2, 0.2, 0.2), 8.0, position=(1.0, 0.0, 0.1), name="box")
    scene.add_spheres([(0.5 * k, 1.0, 0.1) for k in range(3)], 0.1, 2.0, name="balls")
    scene.add_force("box", lambda t, q, v: np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    scene.add_force("balls[1]", lambda t, q, v: np.array([0.0, 2.0, 0.0, 0.0, 0.0, 0.0]))
    problem = scene.build()
    assert problem.system.bodies == ("world", "box", "balls[0]", "balls[1]", "balls[2]")
    assert len(problem.system.located_parts()) == 1
    pushed = problem.system.added_acceleration(0.0, problem.q0, problem.v0).reshape(4, 6)
    np.testing.assert_allclose(pushed[:, :2], [[1.0 / 8.0, 0.0], [0.0, 0.0], [0.0, 1.0], [0.0, 0.0]], atol=1e-15)

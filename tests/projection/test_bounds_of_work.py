"""Solvers end in a bounded time, and say which bound ended them."""

import time

import numpy as np
import pytest

import mbvi
from mbvi.projection import DenseMetric, Projector
from mbvi.projection.dense.dual_active_set import dual_active_set


def dependent_rows(rng, rows, velocities):
    """Rows of a cone with few edges, which depend on each other, and a velocity outside."""
    edges = rng.normal(size=(max(velocities // 2, 3), velocities))
    J = np.abs(rng.normal(size=(rows, len(edges)))) @ edges
    return 3.0 * rng.normal(size=velocities) - 2.0 * J.mean(axis=0), J


@pytest.mark.parametrize(("rows", "velocities"), [(3000, 30), (16000, 35), (2000, 200)])
def test_thousands_of_dependent_rows_take_less_than_seconds(rows, velocities):
    x, J = dependent_rows(np.random.default_rng(rows), rows, velocities)
    Projector().project(x, DenseMetric(np.eye(velocities)), J[:600], np.zeros(600))
    start = time.process_time()
    w, p, residual = Projector().project(x, DenseMetric(np.eye(velocities)), J, np.zeros(rows))
    assert time.process_time() - start < 3.0
    assert residual <= 1e-9
    size = np.abs(x).max() * np.linalg.norm(J, axis=1).max()
    assert (J @ w).min() >= -1e-9 * size
    assert np.allclose(w - x, J.T @ p, atol=1e-9 * np.abs(x).max())
    assert p.min() >= 0.0 and np.abs(p * (J @ w)).max() <= 1e-9 * size * p.max()


@pytest.mark.parametrize("seed", range(4))
def test_a_working_set_of_many_rows_gives_the_answer_of_all(seed, monkeypatch):
    rng = np.random.default_rng(seed)
    x, J = dependent_rows(rng, 350, 20)
    A = np.ascontiguousarray((J / np.linalg.norm(J, axis=1)[:, None]).T)
    d = -(A.T @ x)
    d /= d.max()
    whole = dual_active_set(A, d)
    monkeypatch.setattr("mbvi.projection.dense.dual_active_set._WORKING", 12)
    some = dual_active_set(A, d)
    assert np.allclose(some.z, whole.z, atol=1e-10 * np.abs(whole.z).max())
    assert not some.stopped
    # rows that contradict each other
    assert dual_active_set(np.hstack([A, -A]), np.concatenate([d, np.abs(d) + 1.0])) is None


def test_an_error_says_which_bound_ended_the_solver(monkeypatch):
    rng = np.random.default_rng(0)
    x, J = dependent_rows(rng, 60, 12)
    monkeypatch.setattr("mbvi.projection.dense.proxqp._ITERATIONS", 1)
    monkeypatch.setattr("mbvi.projection.dense.proxqp._FEWEST_ITERATIONS", 1)
    with pytest.raises(mbvi.ProjectionError, match="after 1 iterations"):
        Projector(1e-12, mbvi.ProxQP()).project(x, DenseMetric(np.eye(12)), J, np.zeros(60))

"""The cap on restitution: no gain after it, no change where none can occur, and Kane's pendulum."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from mbvi.projection.coulomb.energy_cap import capped_restitution, energy_gain
from mbvi.projection.coulomb.friction import project_frictional
from mbvi.projection.metric import DenseMetric

EXAMPLES = settings(max_examples=60, deadline=None)
UP = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def random_impact(rng):
    """A few contacts anywhere on a system of random inertia: M, J, v, mu."""
    nv, m = int(rng.integers(4, 9)), int(rng.integers(1, 3))
    B = rng.normal(size=(nv, nv))
    M, J = B @ B.T + 0.3 * np.eye(nv), rng.normal(size=(3 * m, nv))
    return M, J, rng.normal(size=nv), rng.choice([0.1, 0.3, 0.7], size=m)


def capped(M, J, v, mu, e):
    return capped_restitution(v, DenseMetric(M), J, J[::3] @ v, np.full(len(mu), e), mu)


@given(seed=st.integers(0, 100_000), e=st.sampled_from([0.3, 0.6, 0.9, 1.0]))
@EXAMPLES
def test_nothing_is_gained_after_the_cap(seed, e):
    M, J, v, mu = random_impact(np.random.default_rng(seed))
    found = capped(M, J, v, mu, e)
    w = found.projection.velocity
    assert w @ M @ w <= (1.0 + 1e-10) * (v @ M @ v)
    assert (found.e >= 0.0).all() and (found.e <= e).all()
    # the law itself, with the restitution that is reported
    again = project_frictional(v, DenseMetric(M), J, -found.e * (J[::3] @ v), mu)
    np.testing.assert_allclose(again.velocity, w, atol=1e-10 * np.abs(v).max())


@given(seed=st.integers(0, 100_000), e=st.sampled_from([0.3, 0.6, 0.9]))
@EXAMPLES
def test_the_gain_is_the_change_of_kinetic_energy(seed, e):
    M, J, v, mu = random_impact(np.random.default_rng(seed))
    found = project_frictional(v, DenseMetric(M), J, -e * (J[::3] @ v), mu)
    w = found.velocity
    size = v @ M @ v
    assert energy_gain(found) == pytest.approx(0.5 * (w @ M @ w - size), abs=1e-10 * size)


@given(seed=st.integers(0, 100_000), e=st.sampled_from([0.1, 0.3, 0.6]))
@EXAMPLES
def test_restitution_is_kept_where_no_state_can_gain(seed, e):
    """(1 - e^2) G_nn >= G_nt G_tt^+ G_tn."""
    M, J, v, mu = random_impact(np.random.default_rng(seed))
    # tangents that act little on normals
    J[np.arange(len(J)) % 3 > 0] *= 0.1
    J[:, : len(v) // 2] *= np.where(np.arange(len(J)) % 3 > 0, 0.1, 1.0)[:, None]
    G = J @ np.linalg.solve(M, J.T)
    n = np.arange(len(J)) % 3 == 0
    coupled = G[np.ix_(n, ~n)] @ np.linalg.pinv(G[np.ix_(~n, ~n)]) @ G[np.ix_(~n, n)]
    assume(np.linalg.eigvalsh((1.0 - e * e) * G[np.ix_(n, n)] - coupled)[0] > 0.0)
    found = capped(M, J, v, mu, e)
    np.testing.assert_array_equal(found.e, e)
    assert found.gain <= 1e-12 * (v @ M @ v)


def kanes_pendulum(e):
    """Two rods of mass and length 1, whose tip meets rough ground: M, J, v, mu, e."""
    first, second = np.radians([20.0, 30.0])
    off = 0.5 * np.cos(second - first)
    M = np.array([[4.0 / 3.0, off], [off, 1.0 / 3.0]])
    J = np.array([[np.sin(first), np.sin(second)], [np.cos(first), np.cos(second)], [0.0, 0.0]])
    return M, J, np.array([-0.1, -0.2]), np.array([0.5]), e


def test_kanes_pendulum_gains_energy_and_does_not_after_the_cap():
    M, J, v, mu, e = kanes_pendulum(0.7)
    energy = 0.5 * v @ M @ v
    found = capped(M, J, v, mu, e)
    assert found.gain > 0.1 * energy
    # the largest such restitution: its energy is that before
    w = found.projection.velocity
    assert 0.0 < found.e[0] < e
    assert 0.5 * w @ M @ w == pytest.approx(energy, rel=1e-9)
    assert capped(*kanes_pendulum(0.0)).gain <= 0.0


def test_the_work_of_a_belt_is_not_a_gain():
    """A ball that lands on a belt is sped up by it."""
    M, J = np.eye(3), UP
    rate = np.array([0.0, -2.0, 0.0])
    found = capped_restitution(
        np.array([0.0, 0.0, -1.0]), DenseMetric(M), J, np.array([-1.0]), np.array([0.5]), np.array([0.4]), rate
    )
    np.testing.assert_allclose(found.projection.velocity, [0.6, 0.0, 0.5], atol=1e-12)
    assert found.e[0] == 0.5
    assert found.gain < 0.0

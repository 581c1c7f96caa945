"""One projection with friction after the other: starts, cases, joint limits among contacts, and what is unique."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mbvi.projection.coulomb.friction import project_frictional
from mbvi.projection.coulomb.law import NOTHING, UNIQUE
from mbvi.projection.coulomb.newton.cases import OPEN, SLIP, STICK
from mbvi.projection.coulomb.separate_laws import coulomb_law
from mbvi.projection.metric import DenseMetric
from projection.test_friction import UP, body, contact, stack

EXAMPLES = settings(max_examples=40, deadline=None)
CORNERS = np.vstack([contact((x, y, -0.1), UP) for x in (-0.1, 0.1) for y in (-0.1, 0.1)])


def legs(rng):
    """Four contacts on a system of eighteen velocities: independent rows, weakly coupled to each other."""
    B = rng.normal(size=(18, 18))
    J = np.hstack([np.eye(12), rng.normal(size=(12, 6))]) + 0.1 * rng.normal(size=(12, 18))
    return 0.05 * B @ B.T + np.eye(18), J


@given(seed=st.integers(0, 100_000), mu=st.sampled_from([0.0, 0.2, 0.7, 1.5]), independent=st.booleans())
@EXAMPLES
def test_a_start_does_not_change_the_answer(seed, mu, independent):
    """From a problem nearby, from one that is not, and from that itself."""
    rng = np.random.default_rng(seed)
    M, J = legs(rng) if independent else stack(range(int(rng.integers(1, 4))))
    metric, m = DenseMetric(M), len(J) // 3
    x, lower, mu = rng.normal(size=len(M)), np.zeros(m), np.full(m, mu)
    expected = project_frictional(x, metric, J, lower, mu)
    for size in (0.0, 1e-3, 0.1, 3.0):
        start = project_frictional(x + size * rng.normal(size=len(M)), metric, J, lower, mu)
        found = project_frictional(x, metric, J, lower, mu, start=start)
        np.testing.assert_allclose(J @ found.velocity, J @ expected.velocity, atol=1e-8 * np.abs(J @ x).max())
        np.testing.assert_array_equal(found.case, expected.case)


def test_a_start_of_other_contacts_is_ignored():
    metric, x = DenseMetric(body(1.0, (0.2, 0.2, 0.2))), np.array([1.0, 0, -1.0, 0, 0, 0])
    start = project_frictional(x, metric, CORNERS, np.zeros(4), np.full(4, 0.5))
    found = project_frictional(x, metric, CORNERS[:9], np.zeros(3), np.full(3, 0.5), start=start)
    expected = project_frictional(x, metric, CORNERS[:9], np.zeros(3), np.full(3, 0.5))
    np.testing.assert_array_equal(found.velocity, expected.velocity)


@pytest.mark.parametrize(
    ("x", "mu", "case"),
    [
        ([0, 0, 1.0, 0, 0, 0], 0.5, OPEN),
        ([0.1, 0, -1.0, 0, 0, 0], 0.5, STICK),
        ([3.0, 0, -1.0, 0, 0, 0], 0.1, SLIP),
        ([3.0, 0, -1.0, 0, 0, 0], 0.0, SLIP),
    ],
)
def test_what_each_contact_does(x, mu, case):
    # thin, so that no corner opens
    corners = np.vstack([contact((x, y, -1e-3), UP) for x in (-0.1, 0.1) for y in (-0.1, 0.1)])
    metric = DenseMetric(body(1.0, (0.2, 0.2, 0.002)))
    found = project_frictional(np.array(x, float), metric, corners, np.zeros(4), np.full(4, mu))
    np.testing.assert_array_equal(found.case, case)
    np.testing.assert_allclose(found.free, corners @ x)
    np.testing.assert_allclose(found.after, corners @ found.velocity, atol=1e-14)


def test_joint_limits_among_contacts_have_no_tangents():
    """Their tangents are zero rows, or are there and bear nothing."""
    rng = np.random.default_rng(0)
    M, J = legs(rng)
    metric, x, mu = DenseMetric(M), -rng.random(18), np.array([0.4, 0.0, 0.4, 0.0])
    full = project_frictional(x, metric, J, np.zeros(4), mu)
    bare = J.copy()
    bare[[4, 5, 10, 11]] = 0.0
    found = project_frictional(x, metric, bare, np.zeros(4), mu)
    np.testing.assert_allclose(found.velocity, full.velocity, atol=1e-12)
    np.testing.assert_array_equal(full.percussion[[4, 5, 10, 11]], 0.0)
    assert found.unique and full.unique
    # a normal that moves nothing bears nothing
    bare[3] = 0.0
    still = project_frictional(x, metric, bare, np.zeros(4), mu)
    assert still.case[1] == OPEN and still.percussion[3] == 0.0


def test_contacts_stick_to_a_belt():
    found = project_frictional(
        np.array([0.0, 0, -1.0]), DenseMetric(np.eye(3)), UP, np.array([0.0, 2.0, 0.0]), np.array([5.0])
    )
    np.testing.assert_allclose(found.velocity, [2.0, 0.0, 0.0], atol=1e-14)
    assert found.case[0] == STICK


def test_what_is_unique():
    metric = DenseMetric(body(1.0, (0.2, 0.2, 0.2)))
    x = np.array([0.3, 0, -1.0, 0, 0, 0.1])
    one = np.full(1, 0.3)
    assert project_frictional(x, metric, CORNERS[:3], np.zeros(1), one).unique
    assert not project_frictional(x, metric, CORNERS, np.zeros(4), np.full(4, 0.3)).unique
    # friction that acts on normals: not known
    assert not project_frictional(x, metric, CORNERS[:3], np.zeros(1), 5.0 * one).unique


def test_a_wrong_start_is_no_answer():
    """The kernel itself, from percussions that have nothing to do with the problem."""
    rng = np.random.default_rng(1)
    M, J = legs(rng)
    A, x, mu = DenseMetric(M).solve_rows(J), -rng.random(18), np.full(4, 0.6)

    def solve(known, start):
        w, table, case = np.empty(18), np.empty((3, 12)), np.empty(4, np.int64)
        residual, unique = coulomb_law(J, A, x, np.zeros(12), mu, np.full(4, -1), known, 1e-12, start, w, table, case)
        assert residual <= 1e-11 and unique
        return w

    expected = solve(NOTHING, np.zeros(12))
    for size in (1.0, 1e3, 1e9):
        np.testing.assert_allclose(solve(UNIQUE, size * rng.normal(size=12)), expected, atol=1e-10)

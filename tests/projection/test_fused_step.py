"""The compiled projection: its laws on rows that depend on each other, feet of robots, and rows that contradict."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mbvi
from mbvi.projection import DenseMetric, Projector
from mbvi.projection.dense.fused_step import FusedStep
from mbvi.projection.dense.scaled_qp import ScaledQP
from mbvi.projection.dense.shared_percussions import least_norm
from mbvi.projection.warm_start import LastPercussions
from support.robot_problems import problem_of

SEEDS, ROWS, SIZES = st.integers(0, 2**32 - 1), st.integers(1, 64), st.integers(3, 30)
KINDS = st.sampled_from(["independent", "repeated", "feet", "low rank"])
MASS_RATIOS = st.sampled_from([1.0, 1e2, 1e4, 1e6])


def gradients(rng, kind, m, n):
    """Rows of one kind: points of faces have rank three each."""
    J = rng.normal(size=(m, n))
    if kind == "repeated":
        return J[rng.integers(0, 1 + m // 4, m)] * rng.choice([1.0, 2.0, 0.5], m)[:, None]
    if kind == "feet":
        faces = rng.normal(size=(int(rng.integers(1, 5)), 3, n))
        points = np.column_stack([np.ones(m), 0.1 * rng.uniform(-1.0, 1.0, (m, 2))])
        return np.einsum("ma,man->mn", points, faces[rng.integers(0, len(faces), m)])
    if kind == "low rank":
        return J[:, :3] @ rng.normal(size=(3, n))
    return J


def projection(seed, kind, m, n, ratio):
    """A projection that some velocity meets; masses differ by up to a ratio."""
    rng = np.random.default_rng(seed)
    scale = ratio ** rng.uniform(-0.5, 0.5, n)
    B = rng.normal(size=(n, n))
    M = scale[:, None] * (B @ B.T / n + 0.1 * np.eye(n)) * scale
    J, x = gradients(rng, kind, m, n), rng.normal(size=n) / scale
    allowed = J @ (rng.normal(size=n) / scale)
    lower = (np.zeros(m), -0.5 * (J @ x), allowed - rng.random(m) * np.abs(allowed))[rng.integers(3)]
    return x, M, J, lower


def lengths_of(M, J):
    return np.sqrt(np.einsum("ij,ij->i", J, np.linalg.solve(M, J.T).T))


def fused(x, M, J, lower):
    return FusedStep(LastPercussions(), 1e-6).project(x, DenseMetric(M), J, lower)


@settings(max_examples=300)
@given(SEEDS, KINDS, ROWS, SIZES, MASS_RATIOS)
def test_the_answer_meets_the_kkt_conditions(seed, kind, m, n, ratio):
    x, M, J, lower = projection(seed, kind, m, n, ratio)
    w, p, residual = mbvi.project(x, M, J, lower)
    lengths = lengths_of(M, J)
    largest = ((np.abs(J @ x) + np.abs(lower)) / lengths).max()
    assert residual <= 1e-9
    assert (p >= 0.0).all()
    assert np.abs(np.minimum(p * lengths, (J @ w - lower) / lengths)).max() <= 1e-9 * largest
    L = np.linalg.cholesky(M)
    off = np.linalg.norm(np.linalg.solve(L, M @ (w - x) - J.T @ p))
    assert off <= 1e-9 * max(np.linalg.norm(L.T @ x), np.linalg.norm(L.T @ w))


@settings(max_examples=100)
@given(SEEDS, KINDS, ROWS, SIZES, st.sampled_from([1.0, 1e2]))
def test_the_kernel_answers_alone_and_as_proxqp(seed, kind, m, n, ratio):
    x, M, J, lower = projection(seed, kind, m, n, ratio)
    found = fused(x, M, J, lower)
    # many random rows in few dimensions can have percussions that cancel: then another solver goes on
    assert found is not None or (kind == "independent" and m > n)
    if found is None:
        return
    expected = Projector(1e-6, mbvi.ProxQP()).project(x, DenseMetric(M), J, lower)
    off = found.velocity - expected.velocity
    # |w - w*|^2 <= r (|u| + |u*|), r the residual of ProxQP
    lengths = lengths_of(M, J)
    r = max(expected.residual, 1e-13) * ((np.abs(J @ x) + np.abs(lower)) / lengths).max()
    assert off @ M @ off <= max(1e-18 * (x @ M @ x), 2.0 * r * lengths @ (found.percussion + expected.percussion))


@given(SEEDS, KINDS, st.integers(1, 40), SIZES, st.floats(3.0, 17.0))
def test_a_row_that_is_far_open_takes_no_digits_from_the_others(seed, kind, m, n, digits):
    """Two links that turn about the same axis have a pair whose gradient is rounding; its gap is open all the same."""
    x, M, J, lower = projection(seed, kind, m, n, 1e2)
    far = np.random.default_rng(seed).normal(size=n) * 10.0**-digits
    w, _, _ = mbvi.project(x, M, J, lower)
    # the answer must not reach the row
    opening = max(1.0, -10.0 * min(far @ w, far @ x))
    found, p, residual = mbvi.project(x, M, np.vstack([J, far]), np.append(lower, -opening))
    assert p[-1] == 0.0 and residual <= 1e-9
    assert (found - w) @ M @ (found - w) <= 1e-18 * max(x @ M @ x, w @ M @ w)


def test_where_no_row_is_violated_the_unit_of_residuals_is_the_largest_speed():
    """As in islands of a heap whose bodies separate."""
    x, lower = np.array([3.0, 0.5]), np.array([-1.0, 0.0])
    assert ScaledQP(x, DenseMetric(np.eye(2)), np.eye(2), lower, 1e-9).largest == pytest.approx(4.0)


@given(SEEDS, KINDS, st.integers(1, 12), st.integers(3, 10), st.floats(1e-3, 1.0))
def test_rows_that_contradict_each_other_are_named_so_by_the_kernel(seed, kind, m, n, rate):
    x, M, J, lower = projection(seed, kind, m, n, 1e2)
    # J w >= c and -J w >= rate - c
    opposite, bound = np.vstack([J, -J[:1]]), np.append(lower, rate - lower[0])
    with pytest.raises(mbvi.InfeasibleError, match="contradict") as caught:
        fused(x, M, opposite, bound)
    problem = caught.value.problem
    assert np.array_equal(problem["J"], opposite) and np.array_equal(problem["lower"], bound)
    np.testing.assert_allclose(problem["M"], M)


def test_a_contradiction_below_the_allowed_residual_is_none():
    J, lower = np.array([[1.0, 0.0], [-1.0, 0.0]]), np.array([1.0, -1.0 + 1e-9])
    w, _, residual = mbvi.project([0.0, 0.0], np.eye(2), J, lower)
    assert residual <= 1e-8
    np.testing.assert_allclose(w, [1.0, 0.0], atol=1e-8)


@given(SEEDS, st.sampled_from(["repeated", "feet", "low rank"]), ROWS, SIZES)
def test_dependent_rows_share_the_percussions_of_least_norm(seed, kind, m, n):
    """A u of least norm is the positive part of A' y; rows that repeat each other have equal shares."""
    x, M, J, lower = projection(seed, kind, m, n, 1.0)
    lower = np.zeros(m)
    w, p, _ = fused(x, M, J, lower)
    lengths = lengths_of(M, J)
    W, u = np.linalg.solve(np.linalg.cholesky(M), J.T).T / lengths[:, None], p * lengths
    tight = (J @ w) / lengths <= 1e-12 * np.abs(J @ x / lengths).max()
    positive = tight & (u > 1e-9 * u.max(initial=0.0))
    if not positive.any():
        return
    y = np.linalg.lstsq(W[positive], u[positive], rcond=1e-9)[0]
    np.testing.assert_allclose(W[positive] @ y, u[positive], atol=1e-8 * u.max())
    same = np.abs(W @ W.T - 1.0) < 1e-14
    assert np.abs(u[:, None] - u)[same & tight[:, None] & tight].max() <= 1e-10 * u.max()


@pytest.mark.parametrize("guess", ["none", "any", "the answer"])
def test_percussions_of_least_norm_are_found(guess):
    """Of feasible problems, also with few rows in the answer or with rows that repeat each other, from any start.

    At most one of 500 is so near to a degenerate one that its multipliers are huge; none is returned wrong.
    """
    missed = 0
    for seed in range(2000):
        rng = np.random.default_rng(seed)
        rank, more = int(rng.integers(1, 13)), int(rng.integers(0, 41))
        count = rank + more
        B = np.vstack([np.eye(rank), rng.normal(size=(more, rank))])
        B[rank + more // 2 :] = B[rng.integers(0, rank + more // 2, count - rank - more // 2)]
        known = rng.random(count) * (rng.random(count) < rng.choice([0.05, 0.3, 1.0]))
        known[rng.integers(count)] += 0.1
        b, u = known @ B, np.zeros(count)
        found = least_norm(B, count, rank, b, u)
        if guess != "none":
            expected, certain = u.copy(), found
            if guess == "any":
                u[:] = np.maximum(rng.normal(size=count), 0.0)
            found = least_norm(B, count, rank, b, u)
            if found and certain:
                np.testing.assert_allclose(u, expected, atol=1e-8 * np.abs(known).max())
        missed += not found
        if found:
            np.testing.assert_allclose(u @ B, b, atol=1e-13 * np.abs(b).max())
            assert (u >= 0.0).all()
            assert np.linalg.norm(u) <= np.linalg.norm(known) * (1.0 + 1e-12)
    assert missed <= 4


@pytest.mark.parametrize("corners", [4, 8, 16, 33, 64, 200])
def test_a_flat_foot_of_any_number_of_corners_shares_the_percussion_evenly(corners):
    angle = 2.0 * np.pi * np.arange(corners) / corners
    J = np.column_stack([np.ones(corners), np.cos(angle), np.sin(angle)])
    w = fused(np.array([-1.0, 0.0, 0.0]), np.diag([float(corners), 1.0, 1.0]), J, np.zeros(corners))
    np.testing.assert_allclose(w.velocity, 0.0, atol=1e-13)
    np.testing.assert_allclose(w.percussion, 1.0, rtol=1e-12)


def test_percussions_do_not_depend_on_the_order_of_rows(rng):
    _, M, J, _ = projection(3, "feet", 40, 18, 1.0)
    # percussions of one at each row bring it to rest
    x, order = -np.linalg.solve(M, J.T @ np.ones(40)), rng.permutation(40)
    first, second = fused(x, M, J, np.zeros(40)), fused(x, M, J[order], np.zeros(40))
    assert (first.percussion > 0.0).sum() > 10
    np.testing.assert_allclose(second.percussion, first.percussion[order], atol=1e-11 * first.percussion.max())


@pytest.mark.parametrize(("name", "scheme"), [
    ("biped", mbvi.Paoli()), ("quadruped", mbvi.Paoli()), ("biped", mbvi.Centered(project_positions=True)),
    ("quadruped", mbvi.Centered(project_positions=True)),
])  # fmt: skip
def test_robots_need_no_solver_but_the_kernel(name, scheme, monkeypatch):
    monkeypatch.setattr(Projector, "_solve", lambda *arguments: pytest.fail("the kernel gave no answer"))
    run = mbvi.simulate(problem_of(name, "fall", 0.0), scheme, step=1e-3, duration=0.5, progress=False)
    assert max(len(impact.constraints) for impact in run.impacts) >= 4

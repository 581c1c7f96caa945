"""The laws of the projection and of the impact law (8), on random data and at their degenerate ends."""

import itertools
from contextlib import contextmanager, nullcontext
from fractions import Fraction
from unittest import mock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mbvi
from mbvi.projection.dense.fused_step import FusedStep

sizes = st.integers(1, 7)
seeds = st.integers(0, 2**32 - 1)
restitutions = st.sampled_from([0.0, 0.3, 0.8, 1.0])


def norm(w, M):
    return np.sqrt(max(w @ M @ w, 0.0))


def random_cone(seed, n, m):
    """Velocity, metric and gradients; every other cone has dependent rows, the masses span up to 1e8."""
    rng = np.random.default_rng(seed)
    scale = 10.0 ** (rng.integers(0, 3) * rng.uniform(-1, 1, n))
    B = rng.normal(size=(n, n))
    M = scale[:, None] * (B @ B.T + 0.1 * np.eye(n)) * scale
    J = rng.normal(size=(m, n))
    if m > 1 and rng.random() < 0.5:
        J[1] = rng.choice([1.0, 2.0, -1.0]) * J[0]
    return rng.normal(size=n), M, J


@given(seeds, sizes, sizes)
def test_moreau_decomposition(seed, n, m):
    x, M, J = random_cone(seed, n, m)
    w, p, _ = mbvi.project(x, M, J)
    tangent, polar = w, x - w
    scale = norm(x, M)
    assert abs(tangent @ M @ polar) <= 1e-10 * scale**2
    assert np.all(p >= 0)
    assert norm(np.linalg.solve(M, J.T @ p) + polar, M) <= 1e-9 * scale
    lengths = np.sqrt(np.einsum("ij,ij->i", J, np.linalg.solve(M, J.T).T))
    assert np.all(J @ w >= -1e-10 * lengths * scale)


@given(seeds, sizes, sizes)
def test_projecting_twice_changes_nothing(seed, n, m):
    x, M, J = random_cone(seed, n, m)
    w = mbvi.project(x, M, J).velocity
    assert norm(mbvi.project(w, M, J).velocity - w, M) <= 1e-8 * norm(x, M)


@given(seeds, sizes, sizes)
def test_projection_brings_points_no_further_apart(seed, n, m):
    x, M, J = random_cone(seed, n, m)
    y = np.random.default_rng(seed + 1).normal(size=n)
    apart = norm(mbvi.project(x, M, J).velocity - mbvi.project(y, M, J).velocity, M)
    assert apart <= norm(x - y, M) * (1 + 1e-9) + 1e-9 * norm(x, M)


@given(seeds, sizes, sizes, restitutions)
def test_impact_never_raises_the_energy(seed, n, m, e):
    v, M, J = random_cone(seed, n, m)
    assert norm(mbvi.impact(v, M, J, e), M) <= norm(v, M) * (1 + 1e-9)


@given(seeds, sizes, sizes)
def test_elastic_impact_keeps_the_energy(seed, n, m):
    v, M, J = random_cone(seed, n, m)
    assert norm(mbvi.impact(v, M, J, 1.0), M) == pytest.approx(norm(v, M), rel=1e-8)


@given(seeds, sizes, sizes, restitutions)
def test_impact_is_the_law_8(seed, n, m, e):
    v, M, J = random_cone(seed, n, m)
    law = -e * v + (1 + e) * mbvi.project(v, M, J).velocity
    assert norm(mbvi.impact(v, M, J, e) - law, M) <= 1e-8 * norm(v, M)


@given(seeds, sizes, restitutions)
def test_single_constraint_reflects_the_normal_velocity(seed, n, e):
    v, M, J = random_cone(seed, n, 1)
    before = (J @ v)[0]
    expected = -e * before if before < 0 else before
    assert (J @ mbvi.impact(v, M, J, e))[0] == pytest.approx(expected, rel=1e-9, abs=1e-9)


def exact(x, M, J, lower):
    """Solve by trying every active set in rational arithmetic; exact for data of few digits."""
    n, m = len(x), len(J)
    inverse = solve_rational(M, np.eye(n))
    J, x = [[Fraction(a) for a in row] for row in J], [Fraction(a) for a in x]
    columns = [[sum(inverse[i][k] * row[k] for k in range(n)) for i in range(n)] for row in J]
    G = [[sum(a * b for a, b in zip(row, c, strict=True)) for c in columns] for row in J]
    d = [Fraction(c) - sum(a * b for a, b in zip(row, x, strict=True)) for row, c in zip(J, lower, strict=True)]
    for size in range(m + 1):
        for active in itertools.combinations(range(m), size):
            block = [[G[a][b] for b in active] for a in active]
            try:
                p = [row[0] for row in solve_rational(block, [[d[a]] for a in active])]
            except ZeroDivisionError:
                continue
            gain = [sum(G[a][b] * pb for b, pb in zip(active, p, strict=True)) for a in range(m)]
            if all(value >= 0 for value in p) and all(g >= da for g, da in zip(gain, d, strict=True)):
                w = [x[i] + sum(columns[b][i] * pb for b, pb in zip(active, p, strict=True)) for i in range(n)]
                return np.array([float(value) for value in w])
    raise AssertionError("no active set fits")


def solve_rational(matrix, right):
    rows = [[Fraction(a) for a in (*m, *r)] for m, r in zip(matrix, right, strict=True)]
    n = len(rows)
    for k in range(n):
        pivot = next((i for i in range(k, n) if rows[i][k] != 0), None)
        if pivot is None:
            raise ZeroDivisionError
        rows[k], rows[pivot] = rows[pivot], rows[k]
        rows[k] = [a / rows[k][k] for a in rows[k]]
        for i in range(n):
            if i != k and rows[i][k] != 0:
                rows[i] = [a - rows[i][k] * b for a, b in zip(rows[i], rows[k], strict=True)]
    return [row[n:] for row in rows]


DEGENERATE = {
    "repeated": [[1, 2, 0], [1, 2, 0], [1, 2, 0]],
    "parallel": [[1, 2, 0], [2, 4, 0], [0, 0, 1]],
    "opposite": [[1, 0, 2], [-1, 0, -2], [0, 1, 0]],
    "opposite and scaled": [[1, 0, 2], [-3, 0, -6], [1, 1, 1]],
    "more rows than dimensions": [[1, 0, 0], [0, 1, 0], [1, 1, 0], [1, -1, 0], [2, 1, 0], [-1, 2, 0]],
    "nearly parallel": [[1, 0, 0], [1, 2**-20, 0], [1, 0, 2**-20]],
    "nearly opposite": [[1, 0, 0], [-1, 2**-20, 0], [0, 1, 1]],
    "a zero row": [[0, 0, 0], [1, 1, 1]],
    "empty cone interior": [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]],
}


@contextmanager
def without_the_fused_step():
    """Leave every projection to the solver behind the fused step."""
    mbvi.project([1.0], [[1.0]], [[1.0]])
    with mock.patch.object(FusedStep, "project", lambda *arguments: None):
        yield


@given(seeds, sizes, sizes, restitutions)
def test_the_fused_step_and_the_solver_behind_it_agree(seed, n, m, e):
    x, M, J = random_cone(seed, n, m)
    lower = -e * (J @ x)
    first = mbvi.project(x, M, J, lower)
    with without_the_fused_step():
        second = mbvi.project(x, M, J, lower)
    assert norm(first.velocity - second.velocity, M) <= 1e-9 * norm(x, M)


@pytest.mark.parametrize("way", [nullcontext, without_the_fused_step], ids=["fused step", "DualActiveSet"])
@pytest.mark.parametrize("gradients", DEGENERATE.values(), ids=DEGENERATE)
@pytest.mark.parametrize("masses", [(1, 1, 1), (1, 2, 4), (1, 1e4, 1e8), (1e8, 1, 1e4)])
@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_degenerate_active_sets_are_solved_exactly(gradients, masses, e, way):
    J, M = np.array(gradients, dtype=float), np.diag(np.array(masses, dtype=float))
    for x in ([-1.0, -2.0, 3.0], [2.0, -1.0, -1.0], [-3.0, 1.0, 2.0]):
        x = np.array(x)
        lower = -e * (J @ x)
        with way():
            w = mbvi.project(x, M, J, lower)
        assert norm(w.velocity - exact(x, M, J, lower), M) <= 1e-8 * norm(x, M)
        assert w.residual <= 1e-9


@pytest.mark.parametrize("way", [nullcontext, without_the_fused_step], ids=["fused step", "DualActiveSet"])
def test_a_box_landing_flat_shares_the_percussion_evenly(way):
    # vertical velocity and two tilts; four corners, rank three
    J = np.array([[1.0, x, y] for x in (-1, 1) for y in (-1, 1)])
    with way():
        w = mbvi.project(np.array([-1.0, 0, 0]), np.diag([4.0, 1, 1]), J)
    np.testing.assert_allclose(w.velocity, 0, atol=1e-14)
    np.testing.assert_allclose(w.percussion, 1.0, rtol=1e-12)


def test_touching_chain_of_three_balls_at_e_1():
    J = np.array([[-1.0, 1, 0], [0, -1, 1]])
    np.testing.assert_allclose(mbvi.impact([1.0, 0, 0], np.eye(3), J, 1.0), [-1 / 3, 2 / 3, 2 / 3], atol=1e-14)


def test_each_constraint_may_have_its_own_restitution():
    v = mbvi.impact([-1.0, -1.0], np.eye(2), np.eye(2), [0.25, 1.0])
    np.testing.assert_allclose(v, [0.25, 1.0], atol=1e-14)


def test_nothing_active_and_nothing_violated_leave_the_velocity():
    x = np.array([1.0, 2.0])
    assert np.array_equal(mbvi.project(x, np.eye(2), np.zeros((0, 2))).velocity, x)
    w = mbvi.project(x, np.eye(2), np.eye(2))
    assert np.array_equal(w.velocity, x)
    assert w.residual == 0.0


def test_many_rows_reach_rounding():
    rng = np.random.default_rng(3)
    n, m = 60, 200
    J, x = rng.normal(size=(m, n)), rng.normal(size=n)
    J[100:] = J[:100]
    w = mbvi.project(x, np.eye(n), J, -0.5 * (J @ x))
    assert w.residual <= 1e-10


def test_contradicting_rows_raise_and_carry_the_problem():
    with pytest.raises(mbvi.InfeasibleError, match="no velocity") as caught:
        mbvi.project([0.0, 0.0], np.eye(2), [[1.0, 0], [-1.0, 0]], [1.0, 1.0])
    assert caught.value.problem["J"].shape == (2, 2)
    with pytest.raises(mbvi.InfeasibleError, match="vanishes"):
        mbvi.project([0.0, 0.0], np.eye(2), [[0.0, 0.0]], [1.0])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([1.0, 0], np.eye(3), [[1.0, 0]]), "M has shape"),
        (([1.0, 0], np.eye(2), [[1.0, 0, 0]]), "J has shape"),
        (([1.0, np.nan], np.eye(2), [[1.0, 0]]), "finite"),
        (([1.0, 0], [[1.0, 0.5], [0, 1.0]], [[1.0, 0]]), "not symmetric"),
        (([1.0, 0], -np.eye(2), [[1.0, 0]]), "not positive definite"),
        (([1.0, 0], np.eye(2), [[1.0, 0]], [0.0, 0.0]), "lower has shape"),
    ],
)
def test_bad_arguments_of_project(arguments, message):
    with pytest.raises(mbvi.InputError, match=message):
        mbvi.project(*arguments)


@pytest.mark.parametrize("e", [-0.1, 1.1, np.nan, [0.5, 2.0]])
def test_impact_refuses_a_restitution_outside_the_unit_interval(e):
    with pytest.raises(mbvi.InputError):
        mbvi.impact([-1.0, -1.0], np.eye(2), np.eye(2), e)

"""Bodies that stick at one contact move with what they stick to: the answer is that of the law of all contacts."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mbvi.projection.coulomb.friction import project_frictional
from mbvi.projection.coulomb.law import COMPLIANT, UNIQUE, carried_law, free_speeds
from mbvi.projection.coulomb.newton.cases import SLIP, STICK
from mbvi.projection.coulomb.one_contact import coulomb_defect
from mbvi.projection.metric import DenseMetric

EXAMPLES = settings(max_examples=40, deadline=None)
UP = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
BOX, BALL, RADIUS, G, H = 10.0, 1.0, 0.5, 9.81, 1e-3


def pushed_box(places, force, mu_floor, mu_ball, sides=(4.0, 4.0, 1.0)):
    """M, J, x and mu of a box on its corners, at rest, under a force for a step, with a ball at each place on it."""
    n, half = len(places), np.array(sides) / 2.0
    inertia = BOX / 12.0 * (np.sum(np.square(sides)) - np.square(sides))
    M = np.diag(np.concatenate([[BOX] * 3, inertia, *[[BALL] * 3 + [0.4 * BALL * RADIUS**2] * 3] * n]))
    J = np.zeros((3 * (4 + n), len(M)))
    corners = [(x, y, -half[2]) for x in (-half[0], half[0]) for y in (-half[1], half[1])]
    for a, arm in enumerate(corners):
        J[3 * a : 3 * a + 3, :6] = np.hstack([UP, np.cross(arm, UP)])
    for k, (x, y) in enumerate(places):
        rows, first = slice(12 + 3 * k, 15 + 3 * k), 6 + 6 * k
        J[rows, :6] = -np.hstack([UP, np.cross((x, y, half[2]), UP)])
        J[rows, first : first + 6] = np.hstack([UP, np.cross((0.0, 0.0, -RADIUS), UP)])
    x = np.tile([0.0, 0.0, -H * G, 0.0, 0.0, 0.0], 1 + n)
    x[:3] += H * np.asarray(force) / BOX
    return M, J, x, np.repeat([mu_floor, mu_ball], [4, n])


def by_carrying(M, J, x, mu, last):
    """Velocity, percussions and residual of the kernel alone, from the last answer."""
    A, n = DenseMetric(M).solve_rows(J), len(J)
    w, table, lower = np.zeros(len(M)), np.zeros((3, n)), np.zeros(n)
    _, cancelled = free_speeds(J, x, lower, mu, table)
    own = np.zeros((n, n)), np.zeros(n // 3), *(np.zeros(n) for _ in range(4))
    known, bound = UNIQUE if last.unique else COMPLIANT, np.full(n // 3, -1)
    residual, unique = carried_law(
        J, A, x, lower, mu, bound, known, 1e-12, last.start.copy(), cancelled, *own, w, table
    )
    return w, table[0], residual, unique


def drawn(rng):
    places = rng.uniform(-1.9, 1.9, size=(int(rng.integers(5, 12)), 2))
    angle, size = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(80.0, 200.0)
    return places, size * np.array([np.cos(angle), np.sin(angle), 0.0]), rng.uniform(0.1, 0.4), rng.uniform(0.5, 0.8)


def natural_map(M, J, x, mu, p):
    """By plain numpy: how far percussions are from the law, relative to the largest speed of scaled rows."""
    D = J @ np.linalg.solve(M, J.T)
    scale = np.repeat(np.diagonal(D)[::3] ** -0.5, 3)
    u = scale * (J @ x + D @ p)
    return coulomb_defect.loops(u, p / scale, mu) / np.abs(scale * (J @ x)).max()


@pytest.mark.parametrize("number", [4, 9])
def test_balls_roll_on_a_box_that_is_pushed_as_newton_says(number):
    """The box slides at A and each ball rolls at 2 A / 7, with A (M + 2 n m / 7) = F - mu (M + n m) g."""
    grid = np.linspace(-1.5, 1.5, round(number**0.5))
    places, force = np.array([(x, y) for x in grid for y in grid]), np.array([60.0, 80.0, 0.0])
    M, J, x, mu = pushed_box(places, force, 0.3, 0.8)
    last = project_frictional(x, DenseMetric(M), J, np.zeros(len(mu)), mu)
    w, p, residual, unique = by_carrying(M, J, x, mu, last)
    assert residual <= 1e-12 and not unique
    exact = H * (100.0 - 0.3 * (BOX + number * BALL) * G) / (BOX + 2.0 / 7.0 * number * BALL)
    np.testing.assert_allclose(w[:3], exact * force / 100.0, atol=1e-13)
    np.testing.assert_allclose(w[6:].reshape(-1, 6)[:, :3] - 2.0 / 7.0 * w[:3], 0.0, atol=1e-13)
    np.testing.assert_allclose(p[12::3], H * BALL * G, rtol=1e-9)
    assert (last.case[:4] == SLIP).all() and (last.case[4:] == STICK).all()


@EXAMPLES
@given(st.integers(0, 2**32 - 1))
def test_carried_contacts_satisfy_the_law_of_all_and_have_its_answer(seed):
    rng = np.random.default_rng(seed)
    places, force, floor, ball = drawn(rng)
    M, J, x, mu = pushed_box(places, force, floor, ball)
    metric, lower = DenseMetric(M), np.zeros(len(mu))
    # from the answer under another force, which turns slowly
    near = pushed_box(places, force + rng.normal(size=3), floor, ball)[2]
    last = project_frictional(near, metric, J, lower, mu)
    expected = project_frictional(x, metric, J, lower, mu)
    w, p, residual, unique = by_carrying(M, J, x, mu, last)
    if residual <= 1e-12:
        assert natural_map(M, J, x, mu, p) <= 1e-11
        np.testing.assert_allclose(w, expected.velocity, atol=1e-12)
        assert unique == expected.unique
    else:
        # all stick under balls that stay on the box
        assert (expected.case[4:] != STICK).any() or (last.case[4:] != STICK).any()
    found = project_frictional(x, metric, J, lower, mu, start=last)
    np.testing.assert_allclose(found.velocity, expected.velocity, atol=1e-12)
    assert natural_map(M, J, x, mu, found.percussion) <= 1e-11


def test_a_ball_that_begins_to_slip_is_not_carried():
    """Under ten times the force balls slip on the box: percussions of the last answer, in which they stuck, mislead."""
    places, force = np.array([(x, y) for x in (-1.0, 0.0, 1.0) for y in (-1.0, 1.0)]), np.array([100.0, 0.0, 0.0])
    M, J, x, mu = pushed_box(places, force, 0.3, 0.2)
    metric, lower = DenseMetric(M), np.zeros(len(mu))
    last = project_frictional(x, metric, J, lower, mu)
    assert (last.case[4:] == STICK).all()
    x = pushed_box(places, 10.0 * force, 0.3, 0.2)[2]
    assert not by_carrying(M, J, x, mu, last)[2] <= 1e-12
    found = project_frictional(x, metric, J, lower, mu, start=last)
    assert (found.case[4:] == SLIP).all()
    # each ball is accelerated by mu g
    np.testing.assert_allclose(found.velocity[6::6], H * 0.2 * G, rtol=1e-9)


def test_compliant_contacts_that_are_kept_for_the_next_step_are_those_of_all_contacts():
    rng = np.random.default_rng(5)
    M, J, x, mu = pushed_box(*drawn(rng))
    metric, lower = DenseMetric(M), np.zeros(len(mu))
    expected = project_frictional(x, metric, J, lower, mu)
    found = project_frictional(x, metric, J, lower, mu, start=expected)
    assert by_carrying(M, J, x, mu, expected)[2] <= 1e-12
    np.testing.assert_allclose(found.start, expected.start, rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(found.percussion, expected.percussion, rtol=1e-8, atol=1e-10)

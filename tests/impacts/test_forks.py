"""What else could have happened at an impact: against brute force, against perturbed runs, and where (12) holds."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mbvi
from mbvi.impacts import condition_12_violation, cosines_between, independent, unit_gradients
from mbvi.projection import as_metric
from mbvi.reference.polyhedron import _fly

seeds = st.integers(0, 2**32 - 1)
restitutions = st.sampled_from([0.0, 0.3, 0.8, 1.0])


def norm(w, M):
    return np.sqrt(max(w @ M @ w, 0.0))


def random_metric(rng, n):
    B = rng.normal(size=(n, n))
    return B @ B.T + 0.2 * np.eye(n)


def corner(degrees, M=None):
    """Two walls with a kinetic angle between them, as rows of J."""
    M = np.eye(2) if M is None else M
    angle = np.radians(degrees)
    return np.array([[0.0, 1.0], [np.sin(angle), -np.cos(angle)]]) @ np.linalg.cholesky(M).T


def strike(w, M, J, a, e):
    """Return w after an impact on row a alone."""
    reaction = np.linalg.solve(M, J[a])
    return w - (1 + e) * (J[a] @ w) / (J[a] @ reaction) * reaction


def all_orders(M, J, v, e, depth=12):
    """Every order of single impacts, by plain recursion."""
    closing = np.flatnonzero(J @ v < -1e-11)
    if not closing.size:
        return [v]
    assert depth, "the cascade does not end"
    return [w for a in closing for w in all_orders(M, J, strike(v, M, J, a, e), e, depth - 1)]


def nearest(w, outcomes, M):
    return min(norm(w - o, M) for o in outcomes)


# kinetic angles between walls in three dimensions at which reflections form a finite group: all cascades end
GROUPS = {"A3": (60, 60, 90), "B3": (60, 45, 90), "A1 A2": (90, 60, 90), "A1 A1 A1": (90, 90, 90)}


@given(seeds, st.sampled_from(sorted(GROUPS)))
def test_every_order_is_found_and_nothing_else(seed, group):
    rng = np.random.default_rng(seed)
    M = random_metric(rng, 3)
    between = np.radians(GROUPS[group])
    G = np.eye(3)
    for (a, b), angle in zip(((0, 1), (1, 2), (0, 2)), between, strict=True):
        # the angle inside the domain is what is left of 180 degrees between the gradients
        G[a, b] = G[b, a] = -np.cos(angle)
    J = np.linalg.cholesky(G) @ np.linalg.cholesky(M).T
    v = rng.normal(size=3)
    found, expected = mbvi.forks(M, J, v, 1.0), all_orders(M, J, v, 1.0)
    assert found.complete
    assert max(nearest(w, found.outcomes, M) for w in expected) <= 1e-9 * norm(v, M)
    assert max(nearest(w, expected, M) for w in found.outcomes) <= 1e-9 * norm(v, M)
    apart = [norm(a - b, M) for i, a in enumerate(found.outcomes) for b in found.outcomes[:i]]
    assert min(apart, default=1.0) > 1e-9
    assert found.spread == pytest.approx(max([*apart, *(norm(a - found.law, M) for a in found.outcomes)]), abs=1e-12)


@given(seeds, st.integers(1, 4), st.integers(2, 5), restitutions)
def test_outcomes_are_admissible_and_gain_no_energy(seed, m, n, e):
    rng = np.random.default_rng(seed)
    M, J, v = random_metric(rng, n), rng.normal(size=(m, n)), rng.normal(size=n)
    found = mbvi.forks(M, J, v, e)
    np.testing.assert_allclose(found.law, mbvi.impact(v, M, J, e), atol=1e-12 * norm(v, M))
    for w in found.outcomes:
        assert (J @ w >= -1e-9 * norm(v, M)).all()
        assert norm(w, M) <= norm(v, M) * (1 + 1e-10)
        if e == 1.0:
            assert norm(w, M) == pytest.approx(norm(v, M), rel=1e-9)
        # only the constraints push
        pushed = np.linalg.lstsq(J.T, M @ (w - v), rcond=None)
        np.testing.assert_allclose(J.T @ pushed[0], M @ (w - v), atol=1e-8 * (1 + np.abs(M @ v).max()))


@given(seeds, st.integers(1, 4), st.booleans())
def test_where_condition_12_holds_every_order_ends_in_the_law(seed, m, inelastic):
    """The statement behind the short cut in `forks`, by following random orders to their limits."""
    rng = np.random.default_rng(seed)
    n = m + rng.integers(0, 3)
    M = random_metric(rng, n)
    G = np.eye(m)
    if inelastic:
        B = -rng.uniform(0, 1, size=(m, m)) / m
        G += (B + B.T) / 2 - np.diag(B.diagonal())
    turn = np.linalg.qr(rng.normal(size=(n, n)))[0]
    J = np.linalg.cholesky(G) @ turn[:m] @ np.linalg.cholesky(M).T
    e = 0.0 if inelastic else float(rng.uniform(0, 1))
    v = rng.normal(size=n)
    law = mbvi.impact(v, M, J, e)
    found = mbvi.forks(M, J, v, e)
    assert found.complete
    assert len(found.outcomes) == 1
    assert found.spread <= 1e-12 * norm(v, M)
    for _ in range(3):
        w = v
        for _ in range(2000):
            closing = np.flatnonzero(J @ w < -1e-13)
            if not closing.size:
                break
            w = strike(w, M, J, rng.choice(closing), e)
        np.testing.assert_allclose(w, law, atol=1e-8 * norm(v, M))
        np.testing.assert_allclose(found.outcomes[0], law, atol=1e-10 * norm(v, M))


def test_touching_chain_of_three_equal_balls():
    found = mbvi.forks(np.eye(3), [[-1.0, 1, 0], [0, -1, 1]], [1.0, 0, 0], 1.0)
    assert found.complete
    np.testing.assert_allclose(found.outcomes, [[0, 0, 1]], atol=1e-14)
    np.testing.assert_allclose(found.law, [-1 / 3, 2 / 3, 2 / 3], atol=1e-14)
    assert found.spread == pytest.approx(np.sqrt(2 / 3), abs=1e-14)


@pytest.mark.parametrize("M", [np.eye(2), np.array([[2.0, 0.7], [0.7, 0.5]])], ids=["unit mass", "a metric"])
@pytest.mark.parametrize(
    ("degrees", "outcomes", "law_among_them"), [(45, 1, True), (90, 1, True), (60, 1, False), (120, 2, True)]
)
def test_kinetic_corners_at_e_1(degrees, outcomes, law_among_them, M):
    """Left and right cascade agree at 180 / m degrees, and with the law where m is even; 120 is neither."""
    J = corner(degrees, M)
    # off the bisector, closing on both walls
    u = np.radians(degrees / 2 - 8)
    v = np.linalg.solve(np.linalg.cholesky(M).T, [-np.cos(u), -np.sin(u)])
    found = mbvi.forks(M, J, v, 1.0)
    assert found.complete
    assert len(found.outcomes) == outcomes
    assert (found.spread < 1e-12) == (outcomes == 1 and law_among_them)
    if degrees == 60:
        assert nearest(found.law, found.outcomes, M) > 0.1


def test_a_corner_of_120_degrees_by_hand():
    J = corner(120)
    v = np.array([-1.0, -0.1])
    left, right = (strike(v, np.eye(2), J, a, 1.0) for a in (1, 0))
    found = mbvi.forks(np.eye(2), J, v, 1.0)
    # each wall turns the velocity away from the other, or leaves it closing on that
    assert len(found.outcomes) == 2
    expected = [w for w in (left, right) if (J @ w >= 0).all()]
    assert expected
    assert max(nearest(w, found.outcomes, np.eye(2)) for w in expected) < 1e-12


@pytest.mark.parametrize("e", [0.5, 0.9])
def test_endless_cascades_are_followed_to_their_limit(e):
    J = corner(80)
    found = mbvi.forks(np.eye(2), J, [-1.0, -0.5], e)
    assert found.complete
    for a, w in ((0, np.array([-1.0, -0.5])), (1, np.array([-1.0, -0.5]))):
        while (J @ w < -1e-14).any():
            w = strike(w, np.eye(2), J, a, e)
            a = 1 - a
        assert nearest(w, found.outcomes, np.eye(2)) < 1e-9


def test_far_apart_impacts_combine():
    """Two corners of 120 degrees that share no mass: two outcomes each, four together."""
    one, v = corner(120), np.array([-1.0, -0.1])
    zero = np.zeros((2, 2))
    both = mbvi.forks(np.eye(4), np.block([[one, zero], [zero, one]]), [*v, *v], 1.0)
    alone = mbvi.forks(np.eye(2), one, v, 1.0)
    assert len(both.outcomes) == 4
    assert both.spread == pytest.approx(np.sqrt(2) * alone.spread)
    many = np.kron(np.eye(14), one)
    cut = mbvi.forks(np.eye(28), many, np.tile(v, 14), 1.0)
    assert not cut.complete
    assert "combine to more than 10000" in cut.reason
    assert cut.spread == pytest.approx(np.sqrt(14) * alone.spread)


def test_a_search_that_is_cut_says_so():
    # in a corner of a thousandth of a radian a cascade at e = 1/2 takes thousands of impacts
    found = mbvi.forks(np.eye(2), corner(np.degrees(1e-3)), [-1.0, -0.3], 0.5)
    assert not found.complete
    assert "ended after" in found.reason


def test_a_cascade_that_goes_round_is_not_complete():
    """Between two walls that touch it on both sides a point at e = 1 is sent back and forth."""
    found = mbvi.forks(np.eye(1), [[1.0], [-1.0]], [-1.0], 1.0)
    assert not found.complete
    assert "repeats without end" in found.reason
    assert len(found.outcomes) == 0
    assert np.isnan(found.spread)


def test_nothing_closing_leaves_the_velocity():
    v = np.array([1.0, 2.0])
    for J in (np.zeros((0, 2)), np.eye(2), np.zeros((1, 2))):
        found = mbvi.forks(np.eye(2), J, v, 0.5)
        np.testing.assert_array_equal(found.outcomes, [v])
        np.testing.assert_array_equal(found.law, v)
        assert found.complete
        assert found.spread == 0.0


def test_each_constraint_keeps_its_own_restitution():
    found = mbvi.forks(np.eye(2), np.eye(2), [-1.0, -1.0], [0.25, 1.0])
    np.testing.assert_allclose(found.outcomes, [[0.25, 1.0]], atol=1e-14)


def test_repeated_rows_and_order_of_rows_change_nothing():
    M, J, v = np.eye(2), corner(120), np.array([-1.0, -0.1])
    first = mbvi.forks(M, J, v, 1.0)
    for other in (J[::-1], J[[0, 1, 0, 1, 1]]):
        second = mbvi.forks(M, other, v, 1.0)
        assert len(second.outcomes) == len(first.outcomes)
        assert max(nearest(w, first.outcomes, M) for w in second.outcomes) < 1e-12


@pytest.mark.parametrize("e", [-0.1, 1.1, np.nan, [0.5, 2.0]])
def test_forks_refuses_a_restitution_outside_the_unit_interval(e):
    with pytest.raises(mbvi.InputError):
        mbvi.forks(np.eye(2), np.eye(2), [-1.0, -1.0], e)


def angles(J, M):
    columns, _ = unit_gradients(as_metric(M, len(M)), np.asarray(J, dtype=float))
    return cosines_between(columns), columns


def test_the_angle_is_the_kinetic_one():
    """Gradients 120 degrees apart are at right angles where M = diag(3, 1): -3/4 / 3 + 1/4 = 0."""
    J = np.array([[np.sqrt(3) / 2, 0.5], [-np.sqrt(3) / 2, 0.5]])
    for mass, cosine in ((3.0, 0.0), (1.0, -0.5)):
        cosines, _ = angles(J, np.diag([mass, 1.0]))
        assert cosines[0, 1] == pytest.approx(cosine, abs=1e-12)


@pytest.mark.parametrize(
    ("cosine", "e", "holds"),
    [
        (-0.5, (0, 0), True),
        (-0.5, (0.5, 0.5), False),
        (0.5, (0, 0), False),
        (0.5, (1, 1), False),
        (0.0, (0.5, 0.5), True),
        # a pair of which one bounces needs a right angle
        (-0.5, (0, 0.5), False),
        (5e-4, (1, 1), True),
    ],
)
def test_condition_12(cosine, e, holds):
    cosines = np.array([[1.0, cosine], [cosine, 1.0]])
    assert (not condition_12_violation(cosines, np.array(e, dtype=float), 1e-3).any()) == holds


def test_assumption_h4():
    M = np.diag([1.0, 1e4, 1e-4])
    for rows, expected in (
        (np.eye(3), True),
        ([[1.0, 1, 0], [1, 1, 1e-3], [0, 1, 0]], True),
        ([[1.0, 2, 3], [2, 4, 6]], False),
        (np.ones((4, 3)) + np.eye(4)[:, :3], False),
        ([[1.0, 0, 0], [0, 0, 0]], False),
    ):
        cosines, columns = angles(rows, M)
        assert independent(columns, cosines, 1e-6) == expected


@given(seeds, st.integers(2, 3))
def test_perturbed_motions_end_in_one_of_the_outcomes(seed, m):
    """Walls moved by 1e-6 of their distance, so that they are struck one by one: exact straight flights."""
    rng = np.random.default_rng(seed)
    n = m + rng.integers(0, 2)
    M, v = random_metric(rng, n), rng.normal(size=n)
    J = rng.normal(size=(m, n))
    # all walls meet at the origin, and v closes on each of them
    J *= -np.sign(J @ v)[:, None]
    found = mbvi.forks(M, J, v, 1.0)
    assert found.complete
    for _ in range(5):
        moved = 1e-6 * rng.uniform(-1, 1, m)
        at, impacts = _fly(M, J, moved, -v, v, 1.0, 50.0)
        if impacts[-1] < 2.0:
            assert nearest(at(50.0)[1], found.outcomes, M) < 1e-8 * norm(v, M)

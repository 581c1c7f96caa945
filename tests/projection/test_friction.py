"""Coulomb's law for one impact: its statement, energy, exact answers, and what must not change the answer."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mbvi
from mbvi.projection.coulomb.existence import existence_margin
from mbvi.projection.coulomb.friction import project_frictional
from mbvi.projection.coulomb.one_contact import coulomb_defect
from mbvi.projection.metric import DenseMetric, as_metric

EXAMPLES = settings(max_examples=60, deadline=None)
G_AXES = np.eye(3)


def body(mass, size):
    """Mass matrix of a box about its centre."""
    inertia = mass / 12.0 * (np.sum(np.square(size)) - np.square(size))
    return np.diag([mass] * 3 + [*inertia])


def contact(point, frame=G_AXES, first=None, second=0, bodies=1):
    """Rows of one contact at a point relative to the centre of a body; `first` is another body and the point on it."""
    rows = np.zeros((3, 6 * bodies))
    for body_number, sign, arm in ((second, 1.0, point), *([] if first is None else [(first[0], -1.0, first[1])])):
        columns = slice(6 * body_number, 6 * body_number + 6)
        rows[:, columns] = sign * np.hstack([frame, np.cross(np.asarray(arm, float), frame)])
    return rows


UP = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def stack(heights, mass_ratio=1.0):
    """Boxes on each other, four contacts between each two and on the floor: M and J."""
    n, size = len(heights), 0.2
    M = np.zeros((6 * n, 6 * n))
    rows = []
    for k in range(n):
        M[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] = body(mass_ratio**k, (size, size, size))
        for x in (-0.1, 0.1):
            for y in (-0.1, 0.1):
                below = None if k == 0 else (k - 1, (x, y, 0.1))
                rows.append(contact((x, y, -0.1), UP, below, k, n))
    return M, np.vstack(rows)


def random_problem(rng):
    """A few bodies with contacts anywhere, or a stack whose rows depend on each other."""
    if rng.random() < 0.5:
        M, J = stack(range(int(rng.integers(1, 4))), float(rng.choice([1.0, 10.0])))
    else:
        nv, m = int(rng.integers(3, 9)), int(rng.integers(1, 5))
        B = rng.normal(size=(nv, nv))
        M, J = B @ B.T + np.eye(nv), rng.normal(size=(3 * m, nv))
    m = len(J) // 3
    return M, J, rng.normal(size=J.shape[1]), rng.choice([0.0, 0.1, 0.3, 0.8], size=m)


def defect(M, J, p, w, lower, mu):
    """How far p is from the law, from its three cases, in the units of u."""
    u, worst = J @ w, 0.0
    for a in range(len(mu)):
        pn, pt, ut, un = p[3 * a], p[3 * a + 1 : 3 * a + 3], u[3 * a + 1 : 3 * a + 3], u[3 * a] - lower[a]
        worst = max(worst, -un, -pn, np.linalg.norm(pt) - mu[a] * pn, abs(min(un, pn)))
        slip = np.linalg.norm(ut)
        # maximal dissipation: friction is opposite to the slip, and as large as it may be
        worst = max(worst, (pt @ ut + mu[a] * pn * slip) / (1.0 + slip))
    return worst


@given(seed=st.integers(0, 100_000))
@EXAMPLES
def test_a_projection_with_friction_satisfies_coulombs_law(seed):
    rng = np.random.default_rng(seed)
    M, J, x, mu = random_problem(rng)
    lower = 0.3 * rng.normal(size=len(mu)) * (rng.random() < 0.3)
    found = mbvi.project(x, M, J, np.minimum(lower, 0.0), friction=mu)
    np.testing.assert_allclose(M @ (found.velocity - x), J.T @ found.percussion, atol=1e-9 * np.abs(M).max())
    assert found.residual <= 1e-11
    assert defect(M, J, found.percussion, found.velocity, np.minimum(lower, 0.0), mu) <= 1e-8


@given(seed=st.integers(0, 100_000))
@EXAMPLES
def test_an_inelastic_impact_never_gains_energy(seed):
    M, J, v, mu = random_problem(np.random.default_rng(seed))
    w = mbvi.impact(v, M, J, 0.0, friction=mu)
    assert w @ M @ w <= (1.0 + 1e-12) * (v @ M @ v)


@given(seed=st.integers(0, 100_000), many=st.booleans())
@settings(max_examples=25, deadline=None)
def test_neither_the_order_of_contacts_nor_their_tangents_change_the_velocity(seed, many):
    """Of stacks, where percussions are not unique and several velocities satisfy the law."""
    rng = np.random.default_rng(seed)
    M, J = stack(range(9 if many else int(rng.integers(1, 4))))
    m = len(J) // 3
    v, mu = rng.normal(size=J.shape[1]), rng.choice([0.1, 0.3, 0.5], size=m)
    other, order = J.copy(), rng.permutation(m)
    for a in range(m):
        turn = rng.uniform(0.0, 2.0 * np.pi)
        c, s = np.cos(turn), np.sin(turn)
        other[3 * a + 1 : 3 * a + 3] = np.array([[c, s], [-s, c]]) @ J[3 * a + 1 : 3 * a + 3]
    other = other.reshape(m, 3, -1)[order].reshape(3 * m, -1)
    first, second = mbvi.impact(v, M, J, 0.2, friction=mu), mbvi.impact(v, M, other, 0.2, friction=mu[order])
    np.testing.assert_allclose(second, first, atol=1e-8 * np.abs(v).max())


@given(seed=st.integers(0, 100_000))
@settings(max_examples=25, deadline=None)
def test_without_friction_it_is_the_law_without_tangents(seed):
    M, J, v, _ = random_problem(np.random.default_rng(seed))
    expected = mbvi.impact(v, M, np.ascontiguousarray(J[::3]), 0.5)
    np.testing.assert_allclose(mbvi.impact(v, M, J, 0.5, friction=0.0), expected, atol=1e-8)


# exact answers


@pytest.mark.parametrize(("mu", "speed"), [(0.05, 1.0 - 0.05 * 1.5 * 2.0), (10.0, 5.0 / 7.0)])
def test_an_oblique_impact_of_a_ball(mu, speed):
    """It slips to the end, or rolls off at 5/7 of its speed."""
    r, m = 0.1, 2.0
    M = np.diag([m] * 3 + [0.4 * m * r * r] * 3)
    w = mbvi.impact([1.0, 0, -2.0, 0, 0, 0], M, contact((0, 0, -r), UP), 0.5, friction=mu)
    np.testing.assert_allclose(w[[0, 1, 2]], [speed, 0.0, 1.0], atol=1e-12)
    # the spin that friction gives
    np.testing.assert_allclose(w[4], (1.0 - speed) * r * m / (0.4 * m * r * r), rtol=1e-12)


def test_a_block_that_lands_stops_or_slides():
    """It lands flat at 1 m/s and slides at 1 m/s: friction takes mu m/s."""
    size = (0.4, 0.4, 0.01)
    corners = [contact((x, y, -0.005), UP) for x in (-0.2, 0.2) for y in (-0.2, 0.2)]
    for mu in (0.2, 0.9, 1.0, 1.5):
        w = mbvi.impact([1.0, 0, -1.0, 0, 0, 0], body(1.0, size), np.vstack(corners), 0.0, friction=mu)
        np.testing.assert_allclose(w, [max(0.0, 1.0 - mu), 0, 0, 0, 0, 0], atol=1e-10)


def test_a_disc_that_spins_flat_stops_by_what_its_rim_gives():
    """Of many points on a rim each gives mu of its share of the percussion against the spin."""
    angles, r, mu = np.linspace(0, 2 * np.pi, 9)[:-1], 0.3, 0.25
    M = body(1.0, (0.5, 0.5, 0.02))
    rim = np.vstack([contact((r * np.cos(a), r * np.sin(a), 0.0), UP) for a in angles])
    w = mbvi.impact([0, 0, -1.0, 0, 0, 20.0], M, rim, 0.0, friction=mu)
    np.testing.assert_allclose(w, [0, 0, 0, 0, 0, 20.0 - mu * r / M[5, 5]], atol=1e-10)


def test_more_contacts_than_the_small_solver_takes():
    angles, r, mu = np.linspace(0, 2 * np.pi, 41)[:-1], 0.3, 0.25
    M = body(1.0, (0.5, 0.5, 0.02))
    rim = np.vstack([contact((r * np.cos(a), r * np.sin(a), 0.0), UP) for a in angles])
    found = mbvi.project([0, 0, -1.0, 0, 0, 20.0], M, rim, friction=mu)
    np.testing.assert_allclose(found.velocity, [0, 0, 0, 0, 0, 20.0 - mu * r / M[5, 5]], atol=1e-6)


# existence


def test_the_margin_of_existence_of_a_wedge():
    """A point between two walls: no velocity opens both once the friction cones reach each other."""
    angle = np.radians(30.0)
    frames = []
    for side in (-1.0, 1.0):
        normal = np.array([side * np.cos(angle), 0.0, np.sin(angle)])
        frames += [normal, np.cross([0.0, 1.0, 0.0], normal), [0.0, 1.0, 0.0]]
    metric = DenseMetric(np.eye(3))
    limit = np.tan(angle)
    for mu in (0.0, 0.3, 0.57, limit - 1e-6):
        expected = np.sin(angle) - mu * np.cos(angle)
        assert existence_margin(metric, np.array(frames), np.full(2, mu)) == pytest.approx(expected, rel=1e-5)
    for mu in (limit + 1e-9, 0.6):
        assert existence_margin(metric, np.array(frames), np.full(2, mu)) == 0.0


def test_what_has_no_solution_is_an_error_with_its_margin():
    """Two walls close in on a point."""
    J = np.vstack([UP, -UP])
    with pytest.raises(mbvi.ProjectionError, match="no velocity opens all contacts at once"):
        mbvi.project(np.zeros(3), np.eye(3), J, lower=1.0, friction=0.5)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"J": np.ones((4, 6))}, "a normal and two tangents"),
        ({"friction": -0.1}, "at least 0"),
        ({"friction": [0.1, 0.2]}, "one a contact"),
        ({"friction": np.nan}, "friction"),
        ({"e": 1.5}, "restitution"),
        ({"e": [0.1, 0.2]}, "one a contact"),
    ],
)
def test_wrong_arguments(arguments, message):
    given_ = {"v": np.ones(6), "M": np.eye(6), "J": contact((0, 0, -1), UP), "e": 0.0, "friction": 0.5, **arguments}
    with pytest.raises(mbvi.InputError, match=message):
        mbvi.impact(**given_)


def test_an_open_contact_without_friction_and_without_tangents_is_solved(rng):
    """As a joint limit among contacts with friction: the law of an open one has no defect."""
    J = np.zeros((6, 4))
    J[0, 0], J[3:, 1:] = 1.0, np.eye(3)
    found = project_frictional(
        np.array([0.3, -1.0, 0.2, 0.1]), as_metric(np.eye(4), 4), J, np.zeros(6), np.array([0.0, 0.5])
    )
    np.testing.assert_allclose(found.velocity, [0.3, 0.0, 0.0, 0.0], atol=1e-15)
    assert found.residual <= 1e-12
    assert coulomb_defect(np.array([0.3, 0.0, 0.0]), np.zeros(3), np.zeros(1)) == 0.0


def test_percussions_so_large_that_rounding_hides_the_velocity_are_no_solution():
    """One joint: where friction turns it more than the normal does, no percussion makes it part; nor may 1e15 N s."""
    rng = np.random.default_rng(0)
    for _ in range(2000):
        normal, along = rng.uniform(0.3, 1.0), rng.uniform(0.5, 2.0)
        mu, speed = rng.uniform(1.01, 3.0) * normal / along, rng.uniform(0.1, 1.0)
        J, lower = np.array([[normal], [along], [0.0]]), np.array([0.5 * normal * speed, 0.0, 0.0])
        with pytest.raises(mbvi.ProjectionError):
            project_frictional(np.array([-speed]), DenseMetric(np.eye(1)), J, lower, np.array([mu]), 1e-6)

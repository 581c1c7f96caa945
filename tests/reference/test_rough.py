"""Every reference with friction against Newton's and Coulomb's laws, by its own kinematics; no scheme takes part."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import nnls
from scipy.spatial.transform import Rotation

import mbvi
from mbvi import reference
from mbvi.reference import rough_ball, rough_plane

CASES = {name: make() for name, make in reference.ROUGH.items()}
every_case = pytest.mark.parametrize("name", CASES)
CORNERS = 0.5 * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
UP = np.array([0.0, 0.0, 1.0])
# gaps below the first count as closed [m], slips below the second as none [m/s]
CLOSED, STUCK = 1e-8, 1e-7


def slope(function, t, h):
    """The derivative by central differences of order six."""
    weights = (45.0, -9.0, 1.0)
    return sum(w * (function(t + k * h) - function(t - k * h)) for k, w in enumerate(weights, 1)) / (60 * h)


def friction(name):
    return float(CASES[name].name.partition("mu = ")[2].partition(",")[0] or 0.4)


def rows(case, q):
    """Rows of the closed contacts in the order n, t1, t2, shape (m, 3, nv)."""
    constraints = case.problem.constraints.constraints
    if len(q) != 7:
        closed = [c for c in constraints if c.gap(0.0, q)[0] < CLOSED]
        return np.array([np.vstack([c.gradient(0.0, q), c.tangents(0.0, q)[0]]) for c in closed])
    turn = Rotation.from_quat(q[3:]).as_matrix()
    if case.name.startswith("ball"):
        points = -rough_ball._RADIUS * turn[2:]
    else:
        points = CORNERS * (rough_plane._TALL if "tips" in case.name else rough_plane._LOW)
    found = [np.hstack([np.eye(3), np.cross(p, turn)])[[2, 0, 1]] for p in points if (q[:3] + turn @ p)[2] < CLOSED]
    return np.array(found)


def pushes(J, v, mu, belt):
    """Directions of forces on v that Coulomb's law permits, as columns; of a stuck contact, of a polygonal cone."""
    found, round_about = [], 2 * np.pi * np.arange(64) / 64
    for contact in J:
        slip = contact[1:] @ v - [belt, 0.0]
        size = np.linalg.norm(slip)
        ways = [-slip / size] if size > STUCK else np.column_stack([np.cos(round_about), np.sin(round_about)])
        found += [contact[0] + mu * way @ contact[1:] for way in ways]
    return np.array(found).T


def distance(J, v, mu, belt, push):
    """Distance of a generalised force from those that the law permits."""
    return nnls(pushes(J, v, mu, belt), push)[1] if len(J) else np.linalg.norm(push)


def belt_of(case):
    return 1.5 if "belt" in case.name else 0.0


def instants(case):
    return [a + share * (b - a) for a, b in pairwise(case.breakpoints) if b - a > 1e-4 for share in (0.2, 0.5, 0.8)]


def step_within(case, t):
    return 1e-3 * min(1.0, np.abs(case.breakpoints - t).min() / 4e-3)


def test_each_has_a_name_of_its_own():
    assert len({case.name for case in CASES.values()}) == len(CASES)


@every_case
def test_it_starts_where_its_problem_starts(name):
    case = CASES[name]
    q, v = case.at(0.0)
    np.testing.assert_array_equal(q, case.problem.q0)
    np.testing.assert_array_equal(v, case.problem.v0)
    assert case.source and ((case.breakpoints >= 0) & (case.breakpoints <= case.duration)).all()


@every_case
def test_it_stays_in_k(name):
    case = CASES[name]
    gaps = [case.problem.constraints.gap(t, case.at(t)[0]) for t in np.linspace(0, case.duration, 200)]
    assert np.min(gaps) > -1e-10


@every_case
def test_the_configuration_moves_with_the_velocity(name):
    case = CASES[name]
    for t in instants(case):
        q, v = case.at(t)
        rate = slope(lambda s, q=q: case.problem.system.difference(q, case.at(s)[0]), t, step_within(case, t))
        np.testing.assert_allclose(rate, v, atol=1e-9)


@every_case
def test_newtons_and_coulombs_laws_hold_between_impacts(name):
    """M dv/dt - g is a sum of forces that oppose the slip with mu times the normal force, or lie in the cone."""
    case = CASES[name]
    system = case.problem.system
    for t in instants(case):
        q, v = case.at(t)
        excess = system.metric(q).apply(slope(lambda s: case.at(s)[1], t, step_within(case, t)))
        excess = excess - system.force(t, q, v)
        J = rows(case, q)
        assert distance(J, v, friction(name), belt_of(case), excess) < 1e-8
        if len(J):
            np.testing.assert_allclose(J[:, 0] @ v, 0.0, atol=1e-10)


@every_case
def test_the_law_holds_at_impacts(name):
    """Newton's e on normal velocities; the percussion opposes the slip after it, or lies in the cone."""
    case = CASES[name]
    e = float(case.problem.restitution[0])
    for t in case.impacts:
        q, after = case.at(t)
        before = case.at(np.nextafter(t, -np.inf))[1]
        J = rows(case, q)
        np.testing.assert_allclose(J[:, 0] @ (after + e * before), 0.0, atol=1e-12)
        assert (J[:, 0] @ before < 0.0).all()
        assert distance(J, after, friction(name), 0.0, case.problem.system.metric(q).apply(after - before)) < 1e-12


@every_case
def test_friction_takes_energy_but_on_a_belt(name):
    case = CASES[name]
    system = case.problem.system

    def energy(t):
        q, v = case.at(t)
        return system.kinetic_energy(q, v) + system.potential_energy(t, q)

    values = np.array([energy(t) for t in np.linspace(0, case.duration, 200)])
    rises = np.diff(values).max() > 1e-11 * max(1.0, values[0])
    assert rises == (name == "block on a belt")


def test_a_block_stops_after_the_time_that_mu_g_takes():
    case = reference.block_on_incline(0.5, 0.0, 2.0)
    np.testing.assert_allclose(case.switches, [2.0 / (0.5 * 9.81)], rtol=1e-14)
    np.testing.assert_allclose(case.at(1.0)[0][0], 2.0**2 / (2 * 0.5 * 9.81), rtol=1e-14)


def test_a_ball_rolls_at_five_sevenths_of_its_speed():
    case = reference.rolling_ball(0.2, speed=2.0)
    np.testing.assert_allclose(case.switches, [2 * 2.0 / (7 * 0.2 * 9.81)], rtol=1e-14)
    v = case.at(0.9)[1]
    np.testing.assert_allclose(v[[0, 4]], [10.0 / 7.0, 10.0 / 7.0 / 0.1], rtol=1e-13)


def test_a_ball_with_enough_backspin_returns():
    """(5 v + 2 r w) / 7 is negative."""
    case = reference.rolling_ball(0.4, speed=1.0, spin=-40.0, duration=1.2)
    np.testing.assert_allclose(case.at(1.2)[1][0], (5 * 1.0 + 2 * 0.1 * -40.0) / 7, rtol=1e-13)


def test_a_tripod_stops_after_the_time_that_its_moment_takes():
    case = reference.spinning_tripod(0.4, 0.0, 10.0)
    np.testing.assert_allclose(case.switches, [10.0 * 0.1 / (2 * 0.4 * 9.81)], rtol=1e-14)


def test_slip_and_spin_of_a_tripod_end_together():
    case = reference.spinning_tripod(0.4, 0.5, 10.0)
    (stop,) = case.switches
    for before in (1e-3, 1e-5):
        v = case.at(stop - before)[1]
        assert 0.0 < np.linalg.norm(v[:2]) < 10 * before and 0.0 < v[2] < 1e3 * before


def test_a_ball_sticks_at_an_impact_only_where_the_cone_permits():
    v, w = rough_ball.bounced(np.array([1.0, 0.0, -2.0]), np.zeros(3), 0.5, 0.3)
    np.testing.assert_allclose(v, [5.0 / 7.0, 0.0, 1.0], rtol=1e-14)
    np.testing.assert_allclose(w, [0.0, 5.0 / 7.0 / 0.1, 0.0], rtol=1e-14)
    v, _ = rough_ball.bounced(np.array([1.0, 0.0, -2.0]), np.zeros(3), 0.5, 0.01)
    np.testing.assert_allclose(v, [1.0 - 0.01 * 1.5 * 2.0, 0.0, 1.0], rtol=1e-14)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: reference.block_on_incline(-0.1), "mu"),
        (lambda: reference.block_on_incline(5.0, 4.5), "tips"),
        (lambda: reference.block_on_incline(duration=0.0), "duration"),
        (lambda: reference.tipping_box(slope=0.3), "the box tips where the slope is above 0.333"),
        (lambda: reference.tipping_box(mu=0.3), "slips or lifts"),
        (lambda: reference.ball_with_spin(0.0), "restitution"),
        (lambda: reference.ball_with_spin(velocity=(1.0, 0.0, 0.0)), "velocity"),
        (lambda: reference.spinning_tripod(0.0), "mu"),
        (lambda: reference.wall_pendulum(1.5), "below 1.5"),
        (lambda: reference.wall_pendulum(0.1, 2.5), "leaves the wall"),
        (lambda: reference.painleve_rod(1.0), "needs mu > 1.37"),
        (lambda: reference.painleve_rod(duration=2.0), "slips or lifts"),
    ],
)
def test_bad_arguments_of_references(make, message):
    with pytest.raises(mbvi.InputError, match=message):
        make()


@pytest.mark.parametrize("name", [name for name, case in CASES.items() if len(case.impacts)])
def test_single_impacts_are_those_of_the_projection(name):
    case = CASES[name]
    for t in case.impacts:
        q, after = case.at(t)
        before, J = case.at(np.nextafter(t, -np.inf))[1], rows(case, q).reshape(-1, case.problem.system.nv)
        found = mbvi.impact(
            before, case.problem.system.metric(q), J, float(case.problem.restitution[0]), friction=friction(name)
        )
        np.testing.assert_allclose(found, after, atol=1e-10)


@pytest.mark.parametrize("speed", [0.5, 1.0, 3.0])
def test_a_rod_jams_without_a_collision(speed):
    """Its lower end slides in Painlevé's configuration and is pressed down: a percussion stops it."""
    case = reference.painleve_rod(speed=1.0)
    q = np.array([0.0, 0.5 * np.sin(1.0), 1.0])
    J = rows(case, q)[0]
    before, push = np.array([-speed, 0.0, 0.0]), np.array([0.0, -9.81e-6, 0.0])
    after = mbvi.project(before + push, np.diag([1.0, 1.0, 1.0 / 12.0]), J, friction=1.6).velocity
    np.testing.assert_allclose(J @ after, 0.0, atol=1e-12)
    np.testing.assert_allclose(after[2], 1.5 * speed * np.sin(1.0), atol=2e-5)

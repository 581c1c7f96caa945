"""Friction: true errors against tolerances, forces on the cone, records of impacts, and what falls back by name."""

from functools import partial

import numpy as np
import pytest

import mbvi
from mbvi import reference
from mbvi.reference.rough_ball import bounced
from mbvi_studies.published_robots import published_robot
from support.paths import ROBOTS

G = 9.81
# the problem of a moving wall is refused
KNOWN = {name: make for name, make in reference.ROUGH.items() if name != "block on a belt"}
LONG = "tripod that slides and spins"
# parameters drawn once, with stops, reversals, rolling from backspin, and sliding uphill
DRAWN = {
    "block": partial(reference.block_on_incline, 0.485048, 0.720742, -1.42336),
    "block that stops soon": partial(reference.block_on_incline, 0.607786, 0.703866, -0.0841464),
    "steep block": partial(reference.block_on_incline, 0.675297, 0.693616, -2.346087),
    "ball": partial(reference.rolling_ball, 0.398446, -0.354249, -0.279013, -36.5958),
    "bounces": partial(reference.ball_with_spin, 0.972933, 0.258034, (1.3, -0.8), (-31.0, 12.0, 25.0), 0.41),
    "tripod": partial(reference.spinning_tripod, 0.31, 0.0, -10.5623),
    "pendulum": partial(reference.wall_pendulum, 0.282941, 0.20851, 1.2),
    "rod": partial(reference.painleve_rod, 1.63674, 1.0, 0.7, 0.03, 0.00301),
}


def solve(case, tolerance):
    return mbvi.simulate(case.problem, mbvi.EventDriven(tolerance), duration=case.duration)


def keeps(case, tolerance, most_steps=90):
    """Hold the true error of a run to ten tolerances, at any time, in few steps and without a fallback."""
    run, difference = solve(case, tolerance), case.problem.system.difference
    assert run.notes == ()
    assert len(run.t) <= most_steps
    times = np.linspace(0, case.duration, 101)
    assert max(np.abs(difference(case.at(t)[0], run.at(t)[0])).max() for t in times) <= 10 * tolerance
    speed = max(1.0, np.abs(run.v).max())
    apart = [t for t in times if np.abs(case.impacts - t).min(initial=1.0) > 1e-2]
    assert max(np.abs(case.at(t)[1] - run.at(t)[1]).max() for t in apart) <= 10 * tolerance * speed
    np.testing.assert_allclose([impact.time for impact in run.impacts], case.impacts, atol=10 * tolerance)


@pytest.mark.parametrize("name", [name for name in KNOWN if name != LONG])
def test_the_true_error_keeps_to_the_tolerance(name):
    keeps(KNOWN[name](), 1e-7)


@pytest.mark.parametrize("tolerance", [1e-5, 1e-10])
@pytest.mark.parametrize("make", DRAWN.values(), ids=DRAWN)
def test_drawn_parameters_keep_to_it_too(make, tolerance):
    keeps(make(), tolerance)


@pytest.mark.slow
def test_a_slip_that_turns_until_it_stops():
    """Three feet slide in directions of their own, which turn ever faster before they stop at once."""
    keeps(KNOWN[LONG](), 1e-7)


def test_a_sliding_contact_bears_mu_times_its_load():
    """Forces lie on the cone and against the slip until the ball rolls, at 2 |slip| / (7 mu g)."""
    scene = mbvi.Scene(friction=0.2)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_sphere(0.1, 1.5, position=(0, 0, 0.1), velocity=(1.2, -0.9, 0), name="ball")
    run = mbvi.simulate(scene.build(), mbvi.EventDriven(1e-8), duration=0.5, record="contacts")
    stop = 2 * 1.5 / (7 * 0.2 * G)
    assert np.abs(run.t - stop).min() < 1e-9
    for t in run.t[1:]:
        (contact,) = run.contacts(t)
        assert contact.force == pytest.approx(1.5 * G, rel=1e-10)
        if t < stop + 1e-9:
            assert contact.regime == "slip"
            pull = -0.2 * contact.percussion * np.array([0.8, -0.6, 0])
            np.testing.assert_allclose(contact.tangential, pull, atol=1e-10 * contact.percussion)
        else:
            assert contact.regime == "stick"
            assert np.abs(contact.tangential).max() < 1e-10 * contact.percussion


def test_a_control_sees_the_friction_of_a_sliding_contact():
    """Between impacts it receives what is recorded: mu times the load against the slip, then none."""
    scene, seen = mbvi.Scene(friction=0.2), []
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_sphere(0.1, 1.5, position=(0, 0, 0.1), velocity=(1.2, -0.9, 0), name="ball")
    scene.add_control(lambda state: seen.extend((state.t, contact) for contact in state.contacts))
    run = mbvi.simulate(scene.build(), mbvi.EventDriven(1e-8), duration=2.0)
    stop = 2 * 1.5 / (7 * 0.2 * G)
    # contacts are those of the smooth step before; steps that are tried call the control too
    sliding, rolling = [contact for t, contact in seen if t < stop], [contact for _, contact in seen[-10:]]
    assert sliding and run.t[-2] > stop
    for contact in (*sliding, *rolling):
        assert contact.force == pytest.approx(1.5 * G, rel=1e-9)
    for contact in sliding:
        np.testing.assert_allclose(contact.tangential, -0.2 * contact.percussion * np.array([0.8, -0.6, 0]), rtol=1e-9)
    assert max(np.abs(contact.tangential).max() / contact.percussion for contact in rolling) < 1e-9


def test_the_load_reaches_the_cone_when_it_should():
    """A pull that grows with time breaks a point away at mu times its weight, and it slides on from there."""
    mu, rate = 0.4, 8.0
    system = mbvi.LagrangianSystem(lambda q: np.eye(2), lambda t, q, v: np.array([rate * t, -G]), 2)
    floor = mbvi.GapFunction(
        lambda q: q[1], lambda q: np.array([0.0, 1.0]), name="floor", tangents=lambda q: np.array([[1.0, 0.0]])
    )
    problem = mbvi.Problem(system, [floor], [0.0, 0.0], [0.0, 0.0], friction=mu)
    run = mbvi.simulate(problem, mbvi.EventDriven(1e-9), duration=1.0)
    away = mu * G / rate
    assert run.notes == ()
    assert np.abs(run.t - away).min() < 1e-6
    for t in np.linspace(0.0, 1.0, 41):
        assert run.at(t)[0][0] == pytest.approx(rate * max(t - away, 0.0) ** 3 / 6, abs=1e-9)


def test_a_contact_that_slides_is_released():
    """A bead with friction slides off a circle and leaves it: two tolerances agree, and nothing pulls."""
    circle = mbvi.GapFunction(
        lambda q: float(np.hypot(*q)) - 1.0,
        lambda q: q / np.hypot(*q),
        name="circle",
        tangents=lambda q: np.array([[q[1], -q[0]]]) / np.hypot(*q),
    )
    system = mbvi.LagrangianSystem(lambda q: np.eye(2), lambda t, q, v: np.array([0.0, -G]), 2)
    problem = mbvi.Problem(system, [circle], [0.0, 1.0], [1.5, 0.0], friction=0.3)
    coarse, fine = (mbvi.simulate(problem, mbvi.EventDriven(tol), duration=0.7) for tol in (1e-6, 1e-10))
    gaps = np.linalg.norm(fine.q, axis=1) - 1
    assert gaps[-1] > 1e-3
    last = np.flatnonzero(gaps < 1e-10)[-1]
    q, v = fine.q[last], fine.v[last]
    assert v @ v == pytest.approx(G * q[1], abs=1e-6)
    assert np.abs(coarse.q[-1] - fine.q[-1]).max() < 1e-5


def test_impacts_are_recorded_with_their_friction():
    case = reference.ball_with_spin()
    run = solve(case, 1e-8)
    first = run.impacts[0]
    v, w = np.append(run.at(first.time - 1e-9)[1][:3], 0)[:3], np.array([5.0, -20.0, 12.0])
    after, _ = bounced(v, w, 0.7, 0.12)
    np.testing.assert_allclose(first.tangential[0], 1.5 * (after - v) * [1, 1, 0], atol=1e-6)
    assert first.regime == ("slip",)
    assert first.energy_change < 0
    assert first.e_used == pytest.approx(0.7)


def test_a_contact_at_rest_below_an_impact_sticks():
    """A ball falls on one that rests on the floor; both percussions lie within their cones."""
    scene = mbvi.Scene(friction=0.3, restitution=0.0)
    scene.add_halfspace((0, 0, 1))
    scene.add_sphere(0.1, 0.7, position=(0, 0, 0.1))
    scene.add_sphere(0.05, 0.5, position=(0.03, -0.02, 0.5), velocity=(0.2, 0.1, 0))
    impact = mbvi.simulate(scene.build(), mbvi.EventDriven(1e-7), duration=0.3).impacts[0]
    share = np.linalg.norm(impact.tangential, axis=1) / impact.percussion
    np.testing.assert_allclose(np.sort(share), [0.23380, 0.26236], atol=1e-5)
    assert impact.regime == ("stick", "stick")


def test_bounces_end_and_the_ball_rolls():
    scene = mbvi.Scene(restitution=0.5, friction=0.3)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_sphere(0.1, 1.0, position=(0, 0, 0.4), velocity=(2, 0.5, 0), name="ball")
    problem = scene.build()
    coarse, fine = (mbvi.simulate(problem, mbvi.EventDriven(tol), duration=1.5) for tol in (1e-6, 1e-9))
    assert fine.notes == ()
    # the angular momentum about a point of the floor is kept
    np.testing.assert_allclose(fine.v[-1, :2], [2 * 5 / 7, 0.5 * 5 / 7], atol=1e-9)
    assert np.abs(problem.system.difference(coarse.q[-1], fine.q[-1])).max() < 1e-5


def test_a_robot_lands_on_feet_that_stick_and_slip():
    scene = mbvi.Scene(restitution=0.5, friction=0.4)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(ROBOTS / "quadruped/quadruped.urdf", position=(0, 0, 0.6), rotation=(0.1, 0.15, 0))
    problem = scene.build()
    coarse, fine = (mbvi.simulate(problem, mbvi.EventDriven(tol), duration=0.3) for tol in (1e-6, 1e-8))
    assert len(coarse.impacts) == len(fine.impacts) >= 3
    assert fine.notes == ()
    assert np.abs(problem.system.difference(coarse.q[-1], fine.q[-1])).max() < 1e-5


def test_the_error_estimate_is_that_of_two_tolerances():
    run = solve(reference.rolling_ball(), 1e-6)
    assert run.error_estimate().largest < 1e-5


def on_floor(**turning):
    scene = mbvi.Scene(friction=0.5)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_box((0.4, 0.3, 0.1), 2.0, position=(0, 0, 0.05), velocity=(1.0, 0, 0), **turning)
    return scene


def on_four_points():
    """A body on four points of its own, at different distances from its middle."""
    corners = [(0.2, 0.2, -0.05), (-0.2, 0.1, -0.05), (-0.15, -0.2, -0.05), (0.25, -0.1, -0.05)]
    scene = mbvi.Scene(friction=0.3)
    scene.add_halfspace((0, 0, 1), name="floor")
    points = np.array([*corners, (0.1, 0.05, 0.08), (-0.1, -0.05, 0.06)])
    scene.add_convex(points, [(0, 0, 1)], mass=[1.0], velocities=[(1, 0.1, 0)], angular_velocities=[(0, 0, 3)])
    problem = scene.build()
    q = problem.q0.copy()
    q[2] -= problem.constraints.active(0.0, q, 2.0).gap.min()
    return problem.at(q, problem.v0)


@pytest.mark.parametrize("make", [lambda: on_floor(angular_velocity=(0, 0, 3.0)).build(), on_four_points])
def test_corners_that_slide_in_different_directions_share_the_load_as_compliant_ones_do(make, duration=0.1):
    """How they share it decides on the motion; the law of `Paoli` has the same limit, here that of its order one."""
    problem = make()
    run = mbvi.simulate(problem, mbvi.EventDriven(1e-8), duration=duration)
    assert run.notes == () and len(run.t) < 50
    coarse, fine = (mbvi.simulate(problem, mbvi.Paoli(), step=h, duration=duration) for h in (1e-4, 5e-5))
    np.testing.assert_allclose(run.q[-1], 2.0 * fine.q[-1] - coarse.q[-1], atol=2e-8)
    np.testing.assert_allclose(run.v[-1], 2.0 * fine.v[-1] - coarse.v[-1], atol=2e-7)
    with pytest.raises(mbvi.SensitivityError, match="share their load at will"):
        mbvi.sensitivity(problem, mbvi.EventDriven(1e-6), duration=duration)


@pytest.mark.slow
def test_a_robot_whose_leg_jams_goes_on_by_steps_of_paoli():
    """A calf slides over the floor until its forces grow without bound, and steps shrink to nothing."""
    problem = published_robot("go2", 0.02, friction=0.6)
    run = mbvi.simulate(problem, mbvi.EventDriven(1e-6), duration=0.11)
    assert "steps of 1e-4 s were taken" in run.notes[0]
    assert run.t[-1] == 0.11 and len(run.t) < 1000


def test_what_is_not_known_is_refused_by_name():
    with pytest.raises(mbvi.UnsuitableError, match="walls that move"):
        solve(reference.block_on_belt(), 1e-6)
    scene = mbvi.Scene(friction=(0.5, 0.01, 0.0))
    scene.add_halfspace((0, 0, 1))
    scene.add_sphere(0.1, 1.0, position=(0, 0, 0.1))
    with pytest.raises(mbvi.UnsuitableError, match="torsional"):
        mbvi.simulate(scene.build(), mbvi.EventDriven(), duration=0.1)


def test_impacts_where_gradients_jump_have_friction():
    """A cylinder falls onto a box while it moves sideways: its rim has no smooth gradient there."""
    scene = mbvi.Scene(friction=0.4, restitution=0.2)
    scene.add_box((0.4, 0.4, 0.2), mass=2, position=(0, 0, 0.2), name="box")
    scene.add_cylinder(radius=0.1, length=0.2, mass=1, position=(0, 0, 0.41), velocity=(0.3, 0, -1), name="can")
    run = mbvi.simulate(scene.build(), mbvi.EventDriven(1e-6), duration=0.015)
    first = run.impacts[0]
    pull = np.linalg.norm(first.tangential, axis=1)
    assert set(first.regime) <= {"stick", "slip"} and pull.max() > 0.01
    assert (pull <= 0.4 * first.percussion * (1 + 1e-6)).all()
    # it takes from the sideways motion
    assert run.v[-1, 6] < 0.29


@pytest.mark.parametrize("velocity", [(0.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0)])
@pytest.mark.parametrize("kind", ["ball", "box"])
def test_a_contact_on_which_nothing_acts_stays(kind, velocity):
    """Without gravity a body that touches rests or slides on, in a few steps."""
    scene = mbvi.Scene(gravity=(0, 0, 0), friction=0.3, restitution=0.0)
    scene.add_halfspace((0, 0, 1))
    if kind == "ball":
        scene.add_sphere(0.1, position=(0, 0, 0.1), velocity=velocity)
    else:
        scene.add_box((0.2, 0.2, 0.2), position=(0, 0, 0.1), velocity=velocity)
    run = mbvi.simulate(scene.build(), mbvi.EventDriven(1e-6), duration=0.5)
    assert run.notes == () and len(run.t) < 20
    np.testing.assert_allclose(run.q[-1, :3], [0.0, 0.5 * velocity[1], 0.1], atol=1e-12)

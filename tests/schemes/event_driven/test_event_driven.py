"""Error control: true errors against tolerances, located impacts, rest, releases, and scenes that could stall it."""

from functools import cache

import numpy as np
import pytest

import mbvi
from mbvi import reference
from mbvi.schemes.event_driven.rows.contact_rows import SmoothRows
from mbvi.schemes.event_driven.runge_kutta import Flow
from mbvi_studies.chart.errors import fitted_order
from support.paths import ROBOTS, real_robot
from support.programs import kill_writing
from support.references import every_case
from support.scenes import swinging

G = 9.81


def solve(case, tolerance):
    return mbvi.simulate(case.problem, mbvi.EventDriven(tolerance), duration=case.duration)


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6, 1e-8, 1e-10])
@every_case
def test_the_true_error_keeps_to_the_tolerance(case, tolerance):
    """Configurations at any time, from the dense output, and the times of impacts."""
    run, difference = solve(case, tolerance), case.problem.system.difference
    times = np.linspace(0, case.duration, 301)
    assert max(np.abs(difference(case.at(t)[0], run.at(t)[0])).max() for t in times) <= 10 * tolerance
    # velocities away from their jumps
    times = [t for t in times if np.abs(case.impacts - t).min(initial=1.0) > 1e-2]
    speed = max(1.0, np.abs(run.v).max())
    assert max(np.abs(case.at(t)[1] - run.at(t)[1]).max() for t in times) <= 20 * tolerance * speed
    found = np.array([impact.time for impact in run.impacts])
    # of an accumulation the first, which are still apart
    close = np.flatnonzero(np.diff(case.impacts) < 1e-3)
    exact = case.impacts[: close[0] if close.size else None]
    assert len(found) >= len(exact)
    np.testing.assert_allclose(found[: len(exact)], exact, atol=10 * tolerance)


def test_the_ball_comes_to_rest():
    run = mbvi.simulate(reference.bouncing_ball(0.5).problem, mbvi.EventDriven(1e-6), duration=2.0)
    at_rest = run.t[np.abs(run.v[:, 0]) > 0].max()
    assert at_rest == pytest.approx(3 * np.sqrt(2 / G), abs=1e-5)
    assert np.abs(run.q[-1]).max() < 1e-12
    assert run.notes == ()


def robot():
    scene = mbvi.Scene()
    scene.add_urdf(ROBOTS / "quadruped/quadruped.urdf", position=(0, 0, 5), joints={"FL_hip_joint": 0.2})
    return scene.build()


@pytest.mark.parametrize(
    ("make", "v"),
    [
        (lambda: reference.double_pendulum(1.0).problem, [1.0, -2.0]),
        (lambda: reference.tumbling_body(1.0).problem, [0.1, 0.2, 0.3, 2.0, 3.0, -1.0]),
        (robot, np.linspace(-2, 2, 18)),
    ],
    ids=["double pendulum", "free body", "quadruped"],
)
def test_the_smooth_flow_is_of_order_seven_at_least(make, v):
    problem = make()
    flow, nothing = Flow(problem, SmoothRows(problem.constraints, 0.0, problem.q0)), np.zeros(0, np.int64)

    def end(steps):
        q, v_, h = problem.q0, np.array(v), 1.0 / steps
        for k in range(steps):
            a = flow.acceleration(k * h, q, v_, nothing)
            stride = flow.step(k * h, q, v_, a, h, nothing)
            q, v_ = stride.q, stride.v
        return q, v_

    q, v_ = end(200)
    counts = np.array([3, 4, 6, 9, 13])
    errors = [
        max(np.abs(problem.system.difference(q, a)).max(), np.abs(v_ - b).max()) for a, b in map(end, counts.tolist())
    ]
    assert fitted_order(1.0 / counts, errors) >= 7.0


def test_elastic_energy_over_twenty_seconds():
    ball = reference.bouncing_ball(1.0).problem
    pendulum = reference.double_pendulum(1.0).problem
    for problem in (ball, pendulum):
        run = mbvi.simulate(problem, mbvi.EventDriven(1e-11), duration=20.0)
        assert len(run.impacts) > 5
        assert np.ptp(run.energy()) < 1e-9 * max(1.0, np.abs(run.energy()).max())


@pytest.mark.slow
def test_elastic_energy_of_a_tumbling_box():
    scene = mbvi.Scene(restitution=1.0)
    scene.add_halfspace((0, 0, 1))
    scene.add_box((0.3, 0.5, 0.7), mass=2.0, position=(0, 0, 1), angular_velocity=(1.2, 3.0, 2.4))
    run = mbvi.simulate(scene.build(), mbvi.EventDriven(1e-11), duration=20.0)
    assert len(run.impacts) > 20
    assert np.ptp(run.energy()) < 1e-9 * run.energy()[0]


def test_a_chaotic_oscillator_is_followed_for_forty_seconds():
    case = reference.chaotic_oscillator(0.5, stop=-0.1, duration=40.0)
    run = mbvi.simulate(case.problem, mbvi.EventDriven(1e-9), duration=40.0)
    assert len(run.impacts) == len(case.impacts)
    np.testing.assert_allclose([i.time for i in run.impacts], case.impacts, atol=1e-6)
    assert max(np.abs(case.at(t)[0] - run.at(t)[0]).max() for t in np.linspace(0, 40, 400)) < 1e-6


def test_a_slot_keeps_the_speed():
    """A hundred impacts within what would be one step."""
    system = mbvi.LagrangianSystem(lambda q: np.eye(1), lambda t, q, v: np.zeros(1), 1, lambda q: 0.0)
    walls = [
        mbvi.GapFunction(lambda q: q[0], lambda q: np.ones(1)),
        mbvi.GapFunction(lambda q: 0.01 - q[0], lambda q: -np.ones(1)),
    ]
    problem = mbvi.Problem(system, walls, [0.005], [10.0], restitution=1.0)
    run = mbvi.simulate(problem, mbvi.EventDriven(1e-8), duration=0.1)
    assert len(run.impacts) == 100
    np.testing.assert_allclose(np.abs(run.v), 10.0, rtol=1e-12)


def test_sliding_inside_a_disc_keeps_the_radius():
    case = reference.sliding_in_disc(0.5, duration=50.0)
    run = mbvi.simulate(case.problem, mbvi.EventDriven(1e-9), duration=50.0)
    assert np.abs(np.linalg.norm(run.q, axis=1) - 1).max() < 1e-12
    assert max(np.abs(case.at(t)[0] - run.at(t)[0]).max() for t in np.linspace(0, 50, 101)) < 1e-7


def test_touching_balls_take_the_simultaneous_law():
    case = reference.chain(1.0, (1.0,) * 5, (0.5, 0, 0, 0))
    run = mbvi.simulate(case.problem, mbvi.EventDriven(1e-8), duration=1.0)
    np.testing.assert_allclose(run.v[-1], [-0.6, 0.4, 0.4, 0.4, 0.4], atol=1e-12)


@pytest.mark.parametrize("e", [0.0, 0.5])
def test_a_box_lands_flat_and_rests(e):
    scene = mbvi.Scene(restitution=e)
    scene.add_halfspace((0, 0, 1))
    scene.add_box((0.4, 0.3, 0.2), mass=2.0, position=(0, 0, 0.6))
    run = mbvi.simulate(scene.build(), mbvi.EventDriven(1e-8), duration=2.0)
    assert len(run.impacts[0].constraints) == 4
    assert run.impacts[0].time == pytest.approx(np.sqrt(2 * 0.5 / G), abs=1e-9)
    assert run.q[-1, 2] == pytest.approx(0.1, abs=1e-9)
    assert np.abs(run.v[-1]).max() < 1e-9


@pytest.mark.parametrize("e", [0.0, 0.3, 0.8])
def test_a_rod_clatters_to_rest(e):
    run = mbvi.simulate(reference.rod(e).problem, mbvi.EventDriven(1e-8), duration=3.0)
    np.testing.assert_allclose(run.q[-1], 0, atol=1e-8)
    np.testing.assert_allclose(run.v[-1], 0, atol=1e-8)
    assert run.notes == ()


def test_accumulating_impacts_on_two_walls_end_as_they_should():
    """Single impacts in a sharp corner at e = 1/2 are followed to their limit, which is no simultaneous impact."""
    angle = 0.3
    walls = [np.array([0.0, 1.0]), np.array([np.sin(angle), -np.cos(angle)])]
    gaps = [mbvi.GapFunction(lambda q, n=n: n @ q, lambda q, n=n: n) for n in walls]
    system = mbvi.LagrangianSystem(lambda q: np.eye(2), lambda t, q, v: np.zeros(2), 2, lambda q: 0.0)
    problem = mbvi.Problem(system, gaps, [1.0, 0.1], [-1.0, -0.2], restitution=0.5)
    ends = [mbvi.simulate(problem, mbvi.EventDriven(tol), duration=20.0).v[-1] for tol in (1e-6, 1e-9)]
    for v in ends:
        np.testing.assert_allclose(v, 0, atol=1e-8)


def test_a_contact_releases_where_its_force_vanishes():
    """A bead slides off the top of a unit circle and leaves it where cos = 2/3 + v^2 / (3 g)."""
    circle = mbvi.GapFunction(lambda q: float(np.hypot(*q)) - 1.0, lambda q: q / np.hypot(*q), name="circle")
    system = mbvi.LagrangianSystem(
        lambda q: np.eye(2), lambda t, q, v: np.array([0.0, -G]), 2, potential=lambda q: G * q[1]
    )
    problem = mbvi.Problem(system, [circle], [0.0, 1.0], [1.0, 0.0], restitution=0.5)
    run = mbvi.simulate(problem, mbvi.EventDriven(1e-9), duration=0.6)
    gaps = np.linalg.norm(run.q, axis=1) - 1
    release = np.flatnonzero(gaps < 1e-12)[-1]
    assert run.q[release, 1] == pytest.approx(2 / 3 + 1 / (3 * G), abs=1e-8)
    assert gaps[-1] > 1e-3
    assert gaps.min() > -1e-12
    assert run.impacts == ()


def test_cylinders_that_rest_on_each_other_fall_back_and_the_run_says_so():
    scene = mbvi.Scene(restitution=0.2)
    scene.add_halfspace((0, 0, 1))
    scene.add_cylinder(0.2, 0.2, position=(0, 0, 0.1))
    scene.add_cylinder(0.1, 0.2, position=(0.02, 0, 0.305))
    run = mbvi.simulate(scene.build(), mbvi.EventDriven(1e-6), duration=0.08)
    assert "taken by the paper's scheme" in run.notes[0]
    np.testing.assert_allclose(run.q[-1, [2, 9]], [0.1, 0.3], atol=1e-4)
    assert run.penetration().max() < 1e-4


def test_polyhedra_that_bounce_do_so_when_they_should():
    """A box falls flat onto another, e = 0.5: heights as of a ball, until the bounces get short."""
    scene = mbvi.Scene(restitution=0.5)
    scene.add_box((1.0, 1.0, 0.2), position=(0, 0, -0.1), fixed=True)
    scene.add_box((0.2, 0.2, 0.2), position=(0, 0, 0.6))
    run = mbvi.simulate(scene.build(), mbvi.EventDriven(1e-7), duration=0.7)
    exact = reference.bouncing_ball(0.5, height=0.5)
    assert run.notes == ()
    for t in np.linspace(0.0, 0.7, 101):
        assert run.at(t)[0][2] - 0.1 == pytest.approx(exact.at(t)[0][0], abs=1e-6)


def test_nothing_passes_through_a_plate_at_any_speed():
    scene = mbvi.Scene(gravity=(0, 0, 0), restitution=0.5)
    scene.add_box((2.0, 2.0, 0.01), fixed=True)
    scene.add_sphere(radius=0.002, position=(0.3, 0.2, 0.5437), velocity=(0, 0, -400.0))
    run = mbvi.simulate(scene.build(), mbvi.EventDriven(1e-6), duration=1.0)
    assert run.q[:, 2].min() > 0.005
    assert run.v[-1][2] == pytest.approx(200.0, rel=1e-6)


def test_a_robot_falls_on_its_feet():
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(ROBOTS / "quadruped/quadruped.urdf", position=(0, 0, 0.6))
    problem = scene.build()
    coarse, fine = (mbvi.simulate(problem, mbvi.EventDriven(tol), duration=0.35) for tol in (1e-7, 1e-10))
    assert len(coarse.impacts) == len(fine.impacts) >= 3
    assert np.abs(problem.system.difference(coarse.q[-1], fine.q[-1])).max() < 1e-6
    paoli = mbvi.simulate(problem, mbvi.Paoli(), step=2e-5, duration=0.35)
    assert np.abs(problem.system.difference(paoli.q[-1], fine.q[-1])).max() < 2e-3


def test_a_hopper_comes_to_lie_on_the_floor():
    """Its foot touches while its shin rests: it rests too by the acceleration that the shin's reaction leaves it."""
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(ROBOTS / "hopper/hopper.urdf", position=(0, 0, 1), joints={"knee": 0.4})
    problem = scene.build()
    coarse, fine = (mbvi.simulate(problem, mbvi.EventDriven(tol), duration=1.0) for tol in (1e-5, 1e-6))
    for run in (coarse, fine):
        assert 20 < len(run.impacts) < 500
        assert np.diff(run.energy()).max() < 1e-6 * run.energy()[0]
    assert coarse.energy()[-1] == pytest.approx(fine.energy()[-1], rel=1e-5)


def test_a_run_is_saved_replayed_and_diagnosed(tmp_path):
    case = reference.tumbling_body(0.5)
    run = mbvi.simulate(case.problem, mbvi.EventDriven(1e-8), duration=0.45, out=tmp_path / "run.h5")
    again = mbvi.load(tmp_path / "run.h5")
    for t in (0.0, 0.1, 0.2, 0.45):
        np.testing.assert_array_equal(run.at(t)[0], again.at(t)[0])
    assert str(again.diagnosis()) == str(run.diagnosis())
    assert run.diagnosis().horizon == np.inf
    assert run.impacts[0].energy_change < 0
    run.replay_html(tmp_path / "run.html")
    assert (tmp_path / "run.html").stat().st_size > 500_000


def test_a_corner_struck_at_once_has_its_horizon():
    case = reference.corner(1.0, angle=2.0, aim=True)
    run = mbvi.simulate(case.problem, mbvi.EventDriven(1e-8), duration=2.0)
    assert run.diagnosis().horizon == pytest.approx(case.impacts[0], abs=1e-8)


def test_bad_arguments_of_event_driven():
    problem = reference.bouncing_ball(0.5).problem
    for tolerance in (0.0, 1.0, np.nan, "fine"):
        with pytest.raises(mbvi.InputError, match="tolerance"):
            mbvi.EventDriven(tolerance)
    with pytest.raises(mbvi.InputError, match="chooses its own steps"):
        mbvi.simulate(problem, mbvi.EventDriven(1e-6), duration=1.0, step=1e-3)
    with pytest.raises(mbvi.InputError, match="chooses its own steps"):
        mbvi.steps(problem, mbvi.EventDriven(1e-6), step=1e-3)


def panda(mimic=False):
    """Impacts of a finger between its limit and the plane accumulate."""
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1), offset=-0.3, name="floor")
    scene.add_urdf(real_robot("panda_description/urdf/panda.urdf"), base="fixed", mimic=mimic)
    return scene.build(), 0.5


def coupled_panda():
    """The fingers stay at their limits, which are one row on ker J_e, and no force acts there until the arm turns."""
    return panda(mimic=True)


def ur5():
    """Upper arm and wrist on the plane, wrist joints at their limits."""
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1), offset=-0.1, name="floor")
    scene.add_urdf(
        real_robot("ur_description/urdf/ur5_joint_limited_robot.urdf"),
        base="fixed",
        joints={"shoulder_lift_joint": -2.5, "elbow_joint": 0.3},
        velocity={"wrist_1_joint": 3.0, "wrist_3_joint": 4.0, "shoulder_pan_joint": 2.0},
        srdf=real_robot("ur_description/srdf/ur5_joint_limited_robot.srdf"),
    )
    return scene.build(), 1.0


@cache
def nearly_exact(make):
    problem, duration = make()
    return mbvi.simulate(problem, mbvi.EventDriven(1e-12), duration=duration)


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6, 1e-8, 1e-10])
@pytest.mark.parametrize(("make", "impacts"), [(ur5, 30), (panda, 30), (coupled_panda, 2)])
def test_a_robot_falls_into_its_limits_and_onto_a_plane(make, impacts, tolerance):
    exact = nearly_exact(make)
    problem, duration = make()
    run = mbvi.simulate(problem, mbvi.EventDriven(tolerance), duration=duration)
    struck = {name for impact in run.impacts for name in impact.constraints}
    assert any("limit" in name for name in struck)
    assert any("floor" in name for name in struck)
    assert len(exact.impacts) > impacts
    assert run.notes == exact.notes == ()
    apart = [problem.system.difference(exact.at(t)[0], run.at(t)[0]) for t in np.linspace(0, duration, 201)]
    assert np.abs(apart).max() <= 10 * tolerance
    assert run.loop_gap().max() <= 1e-12


@pytest.mark.parametrize("joined", [False, True])
def test_coupled_fingers_rest_at_their_limits_beside_other_bodies(joined):
    """No force presses them there: their limits open and close at no instant, whatever holds them."""
    scene = mbvi.Scene(restitution=0.5)
    scene.add_urdf(real_robot("panda_description/urdf/panda.urdf"), base="fixed")
    ball = scene.add_sphere(0.1, position=(2.0, 0.0, 1.0))
    scene.add_force(ball, lambda t, q, v: np.array([0.0, 0.0, 3.0 * np.sin(20.0 * t)]))
    if joined:
        scene.add_urdf(ROBOTS / "double_pendulum/double_pendulum.urdf", base="fixed", position=(3.0, 0.0, 2.0))
        scene.couple("double_pendulum/elbow", "panda/panda_joint7", ratio=-2.0)
    run = mbvi.simulate(scene.build(), mbvi.EventDriven(1e-8), duration=0.1)
    assert len(run.t) < 30 and not run.notes
    assert run.loop_gap().max() <= 1e-12


def test_forces_that_vary_behind_a_closed_contact_let_it_go_in_time():
    """A bead on a table is pulled up for a twentieth of each period: it leaves when the pull passes its weight."""
    system = mbvi.LagrangianSystem(
        mass=lambda q: np.eye(1), force=lambda t, q, v: np.array([-9.81 + 10.0 * np.sin(20.0 * t)]), dim=1
    )
    floor = mbvi.GapFunction(lambda q: q[0], lambda q: np.ones(1))
    run = mbvi.simulate(mbvi.Problem(system, [floor], np.zeros(1), np.zeros(1)), mbvi.EventDriven(1e-9), duration=0.4)
    first = float(np.arcsin(0.981) / 20.0)

    def height(t):
        s = t - first
        speed = 0.5 * np.cos(20.0 * first)
        return -9.81 * s**2 / 2 + speed * s + 0.025 * (np.sin(20.0 * first) - np.sin(20.0 * t))

    # it lands soon after, and leaves again one period later
    for t in (first + 1e-3, first + 5e-3, first + 1e-2):
        assert run.at(t)[0][0] == pytest.approx(height(t), abs=1e-9)
    assert run.at(first - 1e-4)[0][0] == 0.0
    again = first + 2 * np.pi / 20.0
    assert run.at(again - 1e-4)[0][0] == pytest.approx(0.0, abs=1e-12)
    assert run.at(again + 1e-2)[0][0] == pytest.approx(height(first + 1e-2), abs=1e-9)


def bouncing():
    """A box that tumbles and bounces."""
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1))
    scene.add_box((0.4, 0.3, 0.2), position=(0, 0, 0.4), velocity=(0.5, 0, 0), angular_velocity=(1, 2, 1))
    return scene.build()


@pytest.fixture(scope="module")
def bounced():
    return mbvi.simulate(bouncing(), mbvi.EventDriven(1e-8), duration=0.45)


@pytest.mark.parametrize("every", [2, 5, 1000])
def test_a_thinned_run_keeps_impacts_and_their_states(every, bounced):
    whole, thin = bounced, mbvi.simulate(bouncing(), mbvi.EventDriven(1e-8), duration=0.45, every=every)
    assert len(thin.impacts) > 2
    assert [i.time for i in thin.impacts] == [i.time for i in whole.impacts]
    # what is kept is what the whole run has there, the states before and after each jump among them
    rows = {(t, v.tobytes()) for t, v in zip(whole.t.tolist(), whole.v, strict=True)}
    assert rows >= {(t, v.tobytes()) for t, v in zip(thin.t.tolist(), thin.v, strict=True)}
    for impact in thin.impacts:
        assert np.sum(thin.t == impact.time) >= 2
    assert len(thin.t) < len(whole.t)
    assert thin.t[-1] == 0.45
    np.testing.assert_array_equal(thin.q[-1], whole.q[-1])
    assert thin.residual.max() == whole.residual.max()


def test_between_what_was_kept_a_cubic_leads():
    """Of third order in v and fourth in q between kept states, and right to the tolerance at these."""
    case = reference.double_pendulum(1.0)
    errors = {}
    for every in (1, 2, 4):
        run = mbvi.simulate(case.problem, mbvi.EventDriven(1e-8), duration=case.duration, every=every)
        errors[every] = max(np.abs(case.at(t)[0] - run.at(t)[0]).max() for t in np.linspace(0, case.duration, 301))
        assert max(np.abs(case.at(t)[0] - q).max() for t, q in zip(run.t, run.q, strict=True)) < 1e-7
        for i in range(1, len(run.t) - 1):
            before, at = run.at(np.nextafter(run.t[i], 0.0))[0], run.q[i]
            np.testing.assert_allclose(before, at, atol=1e-12)
    assert errors[1] < 1e-7 < errors[2] < errors[4] < 1e-2


@pytest.mark.parametrize("every", [1, 3])
def test_streaming_writes_what_the_run_holds(every, tmp_path, monkeypatch):
    monkeypatch.setattr("mbvi.results.files.hdf5._INTERVAL", 0.0)
    run = mbvi.simulate(bouncing(), mbvi.EventDriven(1e-8), duration=0.45, every=every, out=tmp_path / "run.h5")
    run.save(tmp_path / "saved.h5")
    for again in (mbvi.load(tmp_path / "run.h5"), mbvi.load(tmp_path / "saved.h5")):
        for name in ("t", "q", "v", "residual"):
            np.testing.assert_array_equal(getattr(again, name), getattr(run, name))
        np.testing.assert_array_equal(again.record.dense, run.record.dense)
        np.testing.assert_array_equal(again.penetration(), run.penetration())
        np.testing.assert_allclose(again.energy(), run.energy(), rtol=1e-12)
        assert [i.time for i in again.impacts] == [i.time for i in run.impacts]
        assert again.complete


KILLED = """
import sys
from support.scenes import swinging
import mbvi
mbvi.simulate(swinging(), mbvi.EventDriven(1e-9), duration=1e5, every=4, out=sys.argv[1])
"""


def test_a_killed_run_leaves_its_states_and_what_is_between(tmp_path):
    path = tmp_path / "killed.h5"
    kill_writing(KILLED, path, states=500, impacts=6)
    cut = mbvi.load(path)
    assert not cut.complete
    assert len(cut.t) >= 500 and len(cut.impacts) > 5
    assert cut.record.dense.shape[0] == len(cut.t) - 1
    end = float(cut.t[-1])
    whole = mbvi.simulate(swinging(), mbvi.EventDriven(1e-9), duration=end, every=4)
    # its last steps are shorter
    n = np.searchsorted(whole.t, 0.9 * end)
    assert n > 100
    np.testing.assert_array_equal(cut.t[:n], whole.t[:n])
    np.testing.assert_array_equal(cut.v[:n], whole.v[:n])
    np.testing.assert_array_equal(cut.record.dense[: n - 1], whole.record.dense[: n - 1])


def test_a_crowd_is_refused_and_many_spheres_keep_their_own_restitution():
    def balls(count, e):
        scene = mbvi.Scene(restitution=0.9)
        scene.add_halfspace((0, 0, 1), name="floor")
        positions = np.column_stack([np.arange(count), np.zeros(count), np.full(count, 0.2)])
        scene.add_spheres(positions=positions, radius=0.1, mass=1.0, name="balls")
        scene.set_restitution("balls", "floor", e)
        return scene.build()

    run = mbvi.simulate(balls(40, 0.5), mbvi.EventDriven(1e-6), duration=0.2)
    np.testing.assert_allclose(run.impacts[0].after, -0.5 * run.impacts[0].before, rtol=1e-9)
    with pytest.raises(mbvi.UnsuitableError, match="too many bodies"):
        mbvi.simulate(balls(600, 0.5), mbvi.EventDriven(1e-6), duration=0.2)


def test_a_step_that_shrinks_to_nothing_names_the_time_and_what_is_closed():
    """A force that grows beyond bounds at t = 0.5 pushes a bead along a wall."""
    system = mbvi.LagrangianSystem(
        mass=lambda q: np.eye(2), force=lambda t, q, v: np.array([1.0 / abs(0.5 - t) ** 1.5, -1.0]), dim=2
    )
    wall = mbvi.GapFunction(lambda q: q[1], lambda q: np.array([0.0, 1.0]))
    problem = mbvi.Problem(system, [wall], np.zeros(2), np.zeros(2))
    with pytest.raises(mbvi.DivergedError, match=r"at t = 0\.5 s, where .* is closed"):
        mbvi.simulate(problem, mbvi.EventDriven(1e-8), duration=1.0)


def test_steps_of_paoli_name_the_contacts_at_which_gradients_jump():
    scene = mbvi.Scene()
    scene.add_heightfield(np.zeros((5, 5)), size=(1.0, 1.0), name="field")
    scene.add_box((0.2, 0.2, 0.2), 1.0, position=(0.03, 0.02, 0.1), velocity=(0.5, 0, 0), name="box")
    run = mbvi.simulate(scene.build(), mbvi.EventDriven(1e-6), duration=0.01)
    assert "steps of 1e-4 s were taken" in run.notes[0] and run.notes[0].endswith("; contacts: box | field")

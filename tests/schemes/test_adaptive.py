"""Error control on any scene: true errors against tolerances, steps, friction, moving walls, robots, records."""

from functools import cache, partial
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import mbvi
from mbvi import reference
from mbvi.system.parts import velocity_units
from support.four_bar import four_bar
from support.paths import ROBOTS
from support.repeated_runs import bytes_of

G = 9.81
SMOOTH = ("bouncing ball", "chaotic oscillator", "corner of 57.3 degrees", "chain of 4, apart, unequal masses")
CASES = {
    **{f"{name}, e = {e:g}": partial(reference.MAKERS[name], e) for name in SMOOTH for e in (0.5, 1.0)},
    **{
        f"{name}, e = {e:g}": partial(reference.MAKERS[name], e)
        for name in ("double pendulum", "rod", "rocking block", "tumbling body")
        for e in (0.0, 0.5)
    },
    "sliding in a disc, e = 0.5": partial(reference.MAKERS["sliding in a disc"], 0.5),
    "sliding in a disc, e = 1": partial(reference.MAKERS["sliding in a disc"], 1.0),
    **{
        name: reference.ROUGH[name]
        for name in (
            "block launched on a floor", "block launched up, that comes back", "block on a belt", "ball with backspin",
            "ball with spin, six bounces", "tripod that spins",
        )
    },
}  # fmt: skip


@cache
def solved(name, tolerance):
    """The exact problem of a name, and its run."""
    case = CASES[name]()
    return case, mbvi.simulate(case.problem, mbvi.Adaptive(tolerance), duration=case.duration)


def errors(case, run, times):
    """Largest errors of q, and of v away from the times at which that jumps, in the units of the tolerance."""
    system, units = case.problem.system, velocity_units(case.problem.system, case.problem.length)
    speed = max(1.0, float(np.abs(run.v / units).max()))
    of_q = of_v = 0.0
    for t in times:
        (q, v), (exact, rate) = run.at(t), case.at(t)
        of_q = max(of_q, float(np.abs(system.difference(exact, q) / units).max()))
        if np.abs(case.breakpoints - t).min() > 0.02:
            of_v = max(of_v, float(np.abs((v - rate) / units).max()) / speed)
    return of_q, of_v


def steps_of(run):
    """The numbers of steps accepted, of steps rejected and of impacts located, from the run's notes."""
    (note,) = [one for one in run.notes if "were accepted and" in one]
    return [int(word) for word in note.replace(",", "").replace(";", "").split() if word.isdigit()]


@pytest.mark.parametrize("name", CASES)
def test_the_true_error_keeps_to_the_tolerance(name):
    """Measured at most 0.15 tolerances in q and 0.55 in v; no step is accepted with a larger error than it may have."""
    case, run = solved(name, 1e-3)
    of_q, of_v = errors(case, run, np.linspace(run.t[0], run.t[-1], 201))
    assert of_q <= 0.3e-3
    assert of_v <= 1e-3
    assert len(run.notes) == 1


def test_few_steps_are_taken_where_the_motion_is_smooth():
    """Tiny steps would keep to any tolerance. The longest step is 0.05 s: two seconds take at least forty."""
    for name, most in (("bouncing ball, e = 1", 60), ("tumbling body, e = 0.5", 30), ("block on a belt", 45)):
        _, run = solved(name, 1e-3)
        accepted, rejected, located = steps_of(run)
        assert accepted + rejected <= most
        assert len(run.t) == 1 + accepted + located
        assert run.step == 0.0


@pytest.mark.parametrize(
    ("name", "tolerances"),
    [("double pendulum, e = 0", (1e-2, 1e-3, 1e-4)), ("sliding in a disc, e = 0.5", (1e-2, 1e-3))],
)
def test_a_tenth_of_the_tolerance_reduces_the_error_at_more_steps(name, tolerances):
    found = []
    for tolerance in tolerances:
        case, run = solved(name, tolerance)
        found.append((max(errors(case, run, run.t[:-1])), sum(steps_of(run)[:2])))
    for (error, steps), (less, more) in pairwise(found):
        assert less <= 0.4 * error
        # of order two in contact as in flight
        assert steps < more <= 4 * steps


def test_the_impacts_of_a_ball_are_located_and_end_at_rest():
    case, run = solved("bouncing ball, e = 0.5", 1e-3)
    times = np.array([impact.time for impact in run.impacts])
    np.testing.assert_allclose(times[:8], case.impacts[:8], atol=1e-4)
    np.testing.assert_allclose(run.impacts[0].after, -0.5 * run.impacts[0].before, rtol=1e-12)
    assert abs(run.q[-1, 0]) < 1e-9
    assert abs(run.v[-1, 0]) < 1e-12


def test_a_block_stops_where_friction_stops_it():
    case, run = solved("block launched on a floor", 1e-3)
    stopped = np.flatnonzero(np.linalg.norm(run.v, axis=1) < 1e-9)[0]
    assert run.t[stopped] == pytest.approx(case.switches[0], abs=1e-4)
    np.testing.assert_allclose(run.q[stopped:, 0], case.at(case.duration)[0][0], atol=1e-4)


@pytest.mark.parametrize(
    ("case", "start", "tolerance"),
    [
        # a step and its halves agree where slip reverses soon after their start: both have the friction of their ends
        (partial(reference.ROUGH["block launched up, that comes back"]), 0.09, 1e-4),
        # and where a contact opens soon after it: both take it to be open from the start on
        (partial(reference.chaotic_oscillator, 0.0), 0.0, 1e-5),
        # a slip that stops within a step would stay until its end in both, and slips back
        (partial(reference.wall_pendulum, 0.150729, 0.332222, 1.763752, 1.5), 0.7, 1e-5),
        # a step ends beside the circle on which a tip sticks, and its second half would begin there
        (partial(reference.painleve_rod, 1.450392, 1.0, 0.7, 0.016937, 0.005396), 0.0, 1e-5),
    ],
    ids=["slip reverses", "contact opens", "slip stops and returns", "tip sticks"],
)
def test_what_a_step_and_its_halves_hide_is_bounded(case, start, tolerance):
    case = case()
    problem = case.started(start * case.duration)
    run = mbvi.simulate(problem, mbvi.Adaptive(tolerance), duration=(1.0 - start) * case.duration)
    assert errors(case, run, np.minimum(run.t, case.duration)[:-1])[0] <= tolerance


def ball(e, **wall):
    scene = mbvi.Scene(restitution=e)
    scene.add_halfspace((0, 0, 1), name="floor", **wall)
    scene.add_sphere(0.1, mass=2.0, position=(0, 0, 0.3))
    return scene.build()


def test_no_impact_between_the_ends_of_a_step_is_missed():
    """Balls rise to just beyond a ceiling: at both ends of a step they are below it, and their flight has no error."""
    z, up, e = 0.5, 1.0, 0.5
    for beyond in (1e-4, 1e-3, 4e-3):
        scene = mbvi.Scene(restitution=e)
        ceiling = z + up**2 / (2.0 * G) - beyond
        scene.add_halfspace((0, 0, -1), -ceiling - 0.1, name="ceiling")
        scene.add_sphere(0.1, position=(0, 0, z), velocity=(0, 0, up), name="ball")
        run = mbvi.simulate(scene.build(), mbvi.Adaptive(1e-4), duration=0.2)
        speed = np.sqrt(2.0 * G * beyond)
        left = 0.2 - (up - speed) / G
        assert [impact.constraints for impact in run.impacts] == [("ball | ceiling",)]
        assert abs(run.q[-1, 2] - (ceiling - e * speed * left - 0.5 * G * left**2)) < 1e-5


@pytest.mark.parametrize(("frequency", "height"), [(10.0, 0.12), (10.0, 0.15), (25.0, 0.11), (25.0, 0.13), (60.0, 0.1)])
def test_no_stroke_of_a_fast_floor_is_missed(frequency, height):
    """A floor that swings several times in the longest step: the times of impacts by roots of the exact gap."""
    amplitude, e, turn, t, z, v, hits, h = 0.2 / frequency, 0.7, 2.0 * np.pi * frequency, 0.0, height, 0.0, [], 1e-5
    grid = np.arange(0.0, 0.35, h)

    def above(t, z, v, x):
        return z + v * x - 0.5 * G * x * x - 0.05 - amplitude * np.sin(turn * (t + x))

    while True:
        rest = grid[grid > t + 1e-4] - t
        gap = partial(above, t, z, v)
        below = gap(rest) < 0.0
        if not below.any():
            break
        first = below.argmax()
        time = brentq(gap, rest[max(first - 1, 0)] - h, rest[first], xtol=1e-14)
        t, z, v = t + time, z + v * time - 0.5 * G * time**2, v - G * time
        # Newton's law relative to the floor
        v = (1.0 + e) * amplitude * turn * np.cos(turn * t) - e * v
        hits.append(t)
    scene = mbvi.Scene(restitution=e)
    scene.add_halfspace((0, 0, 1), motion=mbvi.motion.Oscillation((0, 0, amplitude), frequency))
    scene.add_sphere(0.05, position=(0, 0, height))
    run = mbvi.simulate(scene.build(), mbvi.Adaptive(1e-4), duration=0.35)
    np.testing.assert_allclose([impact.time for impact in run.impacts], hits, atol=1e-3)


def test_a_ball_rides_on_a_floor_that_moves():
    motion = mbvi.motion.Oscillation((0, 0, 0.05), 1.0)
    problem = ball(0.0, motion=motion)
    run = mbvi.simulate(problem, mbvi.Adaptive(1e-3), duration=1.5)
    late = run.t > 1.0
    gaps = [problem.constraints.gap(t, q)[0] for t, q in zip(run.t[late], run.q[late], strict=True)]
    assert np.abs(gaps).max() < 1e-6
    assert np.ptp(run.q[late, 2]) > 0.049
    assert steps_of(run)[2] == 1


@pytest.mark.parametrize("e", [0.0, 0.6])
def test_percussions_balance_the_weight(e):
    """Impacts, and the contacts of the intervals between them."""
    run = mbvi.simulate(ball(e), mbvi.Adaptive(1e-3), duration=1.5, record="contacts")
    table = run.record.contacts
    total = table.percussion.sum() + sum(impact.percussion.sum() for impact in run.impacts)
    assert total == pytest.approx(2.0 * G * 1.5 + 2.0 * run.v[-1, 2], rel=1e-6)
    assert run.contacts(1.45)[0].force == pytest.approx(2.0 * G, rel=1e-6)


def robots():
    scene = mbvi.Scene(restitution=0.3, friction=0.5)
    scene.add_halfspace((0, 0, 1), name="floor")
    for k in range(2):
        scene.add_urdf(ROBOTS / "hopper/hopper.urdf", position=(2.0 * k, 0, 0.9 + 0.1 * k), name=f"hopper {k}")
    return scene.build()


def test_two_robots_with_friction_land_as_at_a_tighter_tolerance():
    problem = robots()
    run, fine = (mbvi.simulate(problem, mbvi.Adaptive(tolerance), duration=0.3) for tolerance in (1e-3, 1e-5))
    assert len(fine.impacts) > 0
    assert np.abs(problem.system.difference(run.q[-1], fine.q[-1])).max() <= 1e-3
    assert sum(steps_of(run)[:2]) < 120


# friction over weight, damping, and the start
PENDULA = [
    (0.1, 0.0, 2.0, 0.0),
    (0.3, 0.02, -2.2, 1.0),
    (0.05, 0.02, 0.4, -3.0),
    (0.55, 0.0, 1.3, 2.0),
    (0.2, 0.3, 2.4, 0.0),
]


@pytest.mark.parametrize("case", PENDULA, ids=str)
def test_a_pendulum_whose_joint_has_dry_friction_reverses_and_stops_in_time(case, tmp_path):
    """Against pieces of Runge-Kutta between zeros of the speed: the true error keeps to the tolerance."""
    share, d, q0, v0 = case
    mass, length = 1.2, 0.3
    weight, inertia = 9.81 * mass * length, mass * length**2 * (1.0 + 1.0 / 12.0)
    own = mass * length**2 / 12.0
    (tmp_path / "arm.urdf").write_text(
        f'<robot name="arm"><link name="base"/><link name="l"><inertial><origin xyz="0 0 {-length}"/>'
        f'<mass value="{mass}"/><inertia ixx="{own}" iyy="{own}" izz="{own}" ixy="0" ixz="0" iyz="0"/></inertial>'
        "</link>"
        '<joint name="j" type="revolute"><limit lower="-9" upper="9" effort="1" velocity="1"/><parent link="base"/>'
        f'<child link="l"/><axis xyz="0 1 0"/><dynamics damping="{d}" friction="{share * weight}"/></joint></robot>'
    )
    scene = mbvi.Scene()
    scene.add_urdf(tmp_path / "arm.urdf", "fixed", joints={"j": q0}, velocity={"j": v0}, joint_friction=True)
    problem, times = scene.build(), np.linspace(0.0, 2.0, 81)
    exact, t, state = np.zeros((81, 2)), 0.0, np.array([q0, v0])
    way = np.sign(v0) or -np.sign(q0)
    while t < 2.0 and way:

        def rate(_, y, way=way):
            return [y[1], (-weight * np.sin(y[0]) - share * weight * way - d * y[1]) / inertia]

        def speed(_, y):
            return y[1]

        speed.terminal, speed.direction = True, -way
        part = solve_ivp(rate, (t, 2.0), state, "DOP853", rtol=1e-12, atol=1e-13, events=speed, dense_output=True)
        here = (times >= t) & (times <= part.t[-1])
        exact[here], t, state = part.sol(times[here]).T, part.t[-1], np.array([part.y[0, -1], 0.0])
        pull = -weight * np.sin(state[0])
        way = np.sign(pull) if abs(pull) > share * weight else 0.0
        # beyond the zero at which it begins
        state[1] = 1e-13 * way
    if not way:
        exact[times > t] = state[0], 0.0
    for tolerance in (1e-2, 1e-3, 1e-4, 1e-5):
        q, v = mbvi.simulate(problem, mbvi.Adaptive(tolerance), duration=2.0, progress=False).at(times)[:2]
        assert np.abs(q[:, 0] - exact[:, 0]).max() < 3.0 * tolerance
        assert np.abs(v[:, 0] - exact[:, 1]).max() < 3.0 * tolerance * max(1.0, np.abs(exact[:, 1]).max())


def test_a_four_bar_linkage_strikes_as_located_at_order_eight():
    problem = four_bar(0.5, floor=-0.3).build()
    exact = mbvi.simulate(problem, mbvi.EventDriven(1e-8), duration=0.8)
    run = mbvi.simulate(problem, mbvi.Adaptive(1e-2), duration=0.8)
    assert len(run.impacts) == len(exact.impacts) > 0
    assert np.abs(problem.system.difference(exact.q[-1], run.q[-1])).max() <= 1e-3
    assert run.loop_gap().max() < 1e-12


def test_a_run_is_repeated_to_the_byte_and_thinned():
    problem = robots()
    runs = [mbvi.simulate(problem, mbvi.Adaptive(1e-2), duration=0.2, every=every) for every in (1, 1, 4)]
    assert bytes_of(runs[0]) == bytes_of(runs[1])
    thin = runs[2]
    assert len(thin.t) < len(runs[0].t)
    assert set(thin.t) <= set(runs[0].t)
    np.testing.assert_array_equal(thin.q[-1], runs[0].q[-1])


def test_a_file_brings_the_run_back(tmp_path):
    run = mbvi.simulate(ball(0.5), mbvi.Adaptive(1e-2), duration=0.5, out=tmp_path / "run.h5", record="contacts")
    again = mbvi.load(tmp_path / "run.h5")
    assert again.record.scheme == mbvi.Adaptive(1e-2)
    assert bytes_of(again) == bytes_of(run)
    for t in np.linspace(0, 0.5, 23):
        np.testing.assert_array_equal(again.at(t)[0], run.at(t)[0])


def test_controls_receive_the_contacts_of_the_last_step():
    seen = []
    scene = mbvi.Scene(restitution=0.0)
    scene.add_halfspace((0, 0, 1))
    scene.add_sphere(0.1, mass=2.0, position=(0, 0, 0.1))
    scene.add_control(lambda state: seen.append([contact.force for contact in state.contacts]))
    run = mbvi.simulate(scene.build(), mbvi.Adaptive(1e-2), duration=0.1)
    assert seen[0] == []
    assert seen[-1] == [pytest.approx(2.0 * G, rel=1e-6)]
    assert len(run.t) > 3


def test_a_fast_ball_does_not_pass_a_thin_wall():
    scene = mbvi.Scene(gravity=(0, 0, 0), restitution=1.0)
    scene.add_box((0.01, 1, 1), position=(1, 0, 0), fixed=True, name="wall")
    scene.add_sphere(0.02, mass=1.0, position=(0, 0, 0), velocity=(30, 0, 0))
    run = mbvi.simulate(scene.build(), mbvi.Adaptive(1e-2), duration=0.1)
    assert len(run.impacts) == 1
    assert run.v[-1, 0] == pytest.approx(-30.0)


def test_a_run_ends_and_says_so_where_no_step_is_short_enough():
    """A force that no step resolves: the difference of the halves never falls below the tolerance."""
    system = mbvi.LagrangianSystem(
        lambda q: np.eye(1), lambda t, q, v: 1e4 * np.sign(np.sin(1e9 * t + 1.0)) * np.ones(1), 1
    )
    problem = mbvi.Problem(system, [], [0.0], [0.0])
    run = mbvi.simulate(problem, mbvi.Adaptive(1e-3), duration=0.1)
    assert run.t[-1] == 0.1
    assert len(run.t) < 1000
    (note,) = [one for one in run.notes if "shortest length" in one]
    assert "the tolerance is not kept from t = " in note


def test_what_cannot_be_run_is_refused():
    problem = ball(0.5)
    for tolerance in (1e-7, 0.2, 0.0, np.nan):
        with pytest.raises(mbvi.InputError, match="tolerance"):
            mbvi.Adaptive(tolerance)
    with pytest.raises(mbvi.InputError, match="Adaptive chooses its own steps: leave out step"):
        mbvi.simulate(problem, mbvi.Adaptive(), duration=0.1, step=1e-3)
    with pytest.raises(mbvi.InputError, match="Adaptive chooses its own steps"):
        next(mbvi.steps(problem, mbvi.Adaptive(), step=1e-3))
    assert repr(mbvi.Adaptive()) == "Adaptive(tolerance=0.001)"

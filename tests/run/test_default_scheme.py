"""What runs where no scheme is named, at which step, and that the run says why."""

from itertools import islice

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mbvi
from mbvi.run.default_scheme import default_scheme, time_step
from support.paths import ROBOTS, real_robot
from support.references import CASES

G = 9.81


def grains(count, e=0.5, pair=None, friction=0.0, **more):
    scene = mbvi.Scene(restitution=e, friction=friction)
    scene.add_halfspace((0, 0, 1))
    side = int(np.ceil(count ** (1 / 3) - 1e-9))
    centres = 0.25 * np.indices((side, side, side)).reshape(3, -1).T[:count]
    name = scene.add_spheres(centres + np.array([0, 0, 0.3]), radius=0.1, mass=1.0, **more)
    if pair is not None:
        scene.set_restitution(name, name, pair)
    return scene.build()


def boxes(count, e=0.0):
    scene = mbvi.Scene(restitution=e)
    scene.add_halfspace((0, 0, 1))
    for k in range(count):
        scene.add_box((0.2, 0.2, 0.2), position=(k, 0, 0.5))
    return scene.build()


def robot(path, base="fixed", **more):
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1), -2.0)
    scene.add_urdf(path, base=base, **more)
    return scene.build()


def oscillator(stiffness, damping=0.0):
    """One mass on a spring: modes of sqrt(k) or, overdamped, up to about the damping [1/s]."""
    system = mbvi.LagrangianSystem(lambda q: np.eye(1), lambda t, q, v: -stiffness * q - damping * v, 1)
    return mbvi.Problem(system, [], [1e-9], [0.0])


HAND = """<robot name="swing"><link name="base"/><link name="bob"><inertial><origin xyz="0 0 -0.5"/><mass value="1"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="0 0 -0.5"/><geometry><sphere radius="0.1"/></geometry></collision></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="bob"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


@pytest.fixture
def swing(tmp_path):
    path = tmp_path / "swing.urdf"
    path.write_text(HAND)
    return path


@pytest.mark.parametrize("count", [1, 5, 12])
def test_few_smooth_constraints_are_for_error_control(count):
    scheme, step, reason = default_scheme(grains(count), 1.0)
    assert isinstance(scheme, mbvi.EventDriven) and step is None
    rows = count + count * (count - 1) // 2
    assert f"{rows} smooth constraint" in reason and "EventDriven(tolerance=1e-06)" in reason


def test_one_box_is_smooth_and_two_are_not():
    assert isinstance(default_scheme(boxes(1), 1.0)[0], mbvi.EventDriven)
    scheme, step, reason = default_scheme(boxes(2), 1.0)
    assert isinstance(scheme, mbvi.Centered) and scheme.project_positions
    assert "the contact normal of box | box_2 can jump" in reason and f"h = {step:g} s" in reason


def test_many_are_stepped_without_listing_their_pairs():
    scheme, step, reason = default_scheme(grains(1000), 1.0)
    assert isinstance(scheme, mbvi.StewartTrinkle)
    assert f"{1000 + 1000 * 999 // 2} constraints are many" in reason
    # the highest falls 24 times its size, and no more than a tenth of it in a step
    speed = np.sqrt(2 * 9.81 * (0.3 + 9 * 0.25))
    assert 0.4 * 0.01 <= speed * step <= 0.01


def test_a_robot_is_judged_by_its_links(swing):
    assert isinstance(default_scheme(robot(swing), 1.0)[0], mbvi.EventDriven)
    for problem in (
        robot(ROBOTS / "quadruped/quadruped.urdf", "free"),
        robot(real_robot("ur_description/urdf/ur5_robot.urdf")),
    ):
        scheme, step, reason = default_scheme(problem, 2.0)
        assert isinstance(scheme, mbvi.Centered) and "can jump" in reason
        assert 1e-4 <= step <= 5e-3


def test_a_small_link_asks_for_no_shorter_step_than_its_robot():
    """The fingers of a Panda are 17 mm in size: by them alone the step would be less than half of this."""
    step, _ = time_step(robot(real_robot("panda_description/urdf/panda.urdf")), 1.0)
    assert step == 5e-4


def test_a_control_may_switch_and_is_stepped(swing):
    scheme, step, reason = default_scheme(robot(swing, control=lambda t, q, v: -np.sign(v)), 1.0)
    assert isinstance(scheme, mbvi.Centered) and "the control of swing may switch" in reason
    assert step >= 1e-3
    assert time_step(robot(swing, control=lambda t, q, v: -1e5 * q), 1.0)[0] < step


def test_damping_of_joints_is_implicit_and_asks_for_no_step(tmp_path):
    steps = []
    for damping in (0, 1e4):
        path = tmp_path / f"{damping}.urdf"
        path.write_text(HAND.replace("<limit", f'<dynamics damping="{damping}"/><limit'))
        problem = robot(path)
        assert problem.system.damping[0] == damping
        steps.append(time_step(problem, 1.0))
    assert steps[0] == steps[1]


def test_no_constraints_are_for_error_control():
    scheme, _, reason = default_scheme(oscillator(1.0), 1.0)
    assert isinstance(scheme, mbvi.EventDriven) and "no constraints" in reason


@pytest.mark.parametrize("stiffness", [1e2, 1e4, 1e6])
def test_the_step_resolves_the_fastest_mode(stiffness):
    """Thirty steps or more to a period, and no ten times as many."""
    step, scale = time_step(oscillator(stiffness), 100.0)
    assert 30 <= 2 * np.pi / np.sqrt(stiffness) / step <= 300
    assert "the fastest mode" in scale


def test_the_step_is_stable_where_damping_is_strong():
    problem = oscillator(1.0, damping=1e4)
    step, _ = time_step(problem, 100.0)
    assert step * 1e4 < 1
    assert abs(mbvi.simulate(problem, step=step, duration=100 * step).v).max() < 1e-8


@given(st.floats(-2, 8), st.floats(0, 4))
def test_the_step_is_stable_at_any_stiffness_and_damping(stiffness, damping):
    """`Centered` is stable as long as h d + h^2 k / 2 < 2; no step takes more than a fifth of that."""
    k, d = 10.0**stiffness, 10.0**damping
    h, _ = time_step(oscillator(k, d), 1e6)
    assert h * d + 0.5 * h**2 * k <= 0.4 * (1 + 1e-9)


# of the swing about its joint [kg m^2]
INERTIA = 0.26


def held(swing, stiffness, damping):
    """The swing under a PD control of such squared frequency and rate, which leaves its rest slowly."""
    control = lambda t, q, v: -INERTIA * (stiffness * q + damping * v)  # noqa: E731
    problem = robot(swing, position=(0, 0, -0.5), control=control)
    return problem.at(problem.q0, [1e-9])


@pytest.mark.parametrize("part", [0.0, 0.5, 1.0])
def test_a_control_is_stable_as_far_as_the_step_presumes(swing, part):
    """Here h d + h^2 k / 2 is a twentieth below and above 2; damping has such a part of it."""
    h, speeds = 1e-3, []
    for limit in (1.9, 2.1):
        problem = held(swing, 2.0 * (1.0 - part) * limit / h**2, part * limit / h)
        scheme = mbvi.Centered(project_positions=True)
        speeds.append(max(abs(step.v[0]) for step in islice(mbvi.steps(problem, scheme, step=h), 60)))
    assert speeds[0] < 2e-8 and speeds[1] > 1e-7


def test_a_mode_that_decays_at_once_need_only_be_stable(swing):
    """It is resolved up to a tenth of what the fall of the swing asks for, 2.3e-4 s; other modes always are."""
    assert 2e-3 <= time_step(held(swing, 0.0, 1.0), 1e3)[0] < 5e-3
    for damping in (300.0, 800.0):
        assert 0.08 <= damping * time_step(held(swing, 0.0, damping), 1e3)[0] <= 0.2
    steps = {damping: time_step(held(swing, 0.0, damping), 1e3)[0] for damping in (1.6e3, 7.9e3, 7.9e4)}
    assert steps == {1.6e3: 2e-4, 7.9e3: 5e-5, 7.9e4: 5e-6}
    for frequency in (1e2, 1e4):
        assert 0.08 < frequency * time_step(held(swing, frequency**2, 0.5 * frequency), 1e3)[0] <= 0.2


@pytest.mark.parametrize(("factor", "expected"), [(1.0, 2e-4), (4.0, 1e-4)])
def test_a_robot_stands_under_a_stiff_control_at_the_step_that_is_chosen(factor, expected):
    """Go2 lands on its feet: no speed but that of its fall, and springs with dampers give it no energy."""
    angles = {"hip": 0.0, "thigh": 0.8, "calf": -1.6}
    stance = {f"{leg}_{part}_joint": angle for leg in ("FL", "FR", "RL", "RR") for part, angle in angles.items()}
    rest = np.array(list(stance.values()))
    stiffness, damping = 100.0 * factor, 3.0 * factor

    def control(t, q, v):
        return np.concatenate([np.zeros(6), -stiffness * (q[7:] - rest) - damping * v[6:]])

    scene = mbvi.Scene(restitution=0.0)
    scene.add_halfspace((0, 0, 1))
    scene.add_urdf(real_robot("go2_description/urdf/go2.urdf"), position=(0, 0, 0.34), joints=stance, control=control)
    problem = scene.build()
    np.testing.assert_array_equal(problem.q0[7:], rest)
    assert time_step(problem, 1.0)[0] == expected
    run = mbvi.simulate(problem, duration=0.15)
    assert run.step == expected and run.impacts and run.penetration().max() < 1e-3
    assert abs(run.v).max() < 10.0
    energy = run.energy() + 0.5 * stiffness * ((run.q[:, 7:] - rest) ** 2).sum(axis=1)
    assert np.maximum(np.diff(energy), 0.0).sum() < 1e-3 * np.ptp(energy)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_the_step_goes_by_the_size_of_bodies(scale):
    """Lengths times s in the same gravity are times by sqrt(s); by speed, times s."""
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1))
    scene.add_sphere(radius=0.1 * scale, position=(0, 0, 0.2 * scale))
    fall = np.sqrt(2 * 0.1 * scale / G)
    step, why = time_step(scene.build(), 1e4)
    assert 0.004 * fall <= step <= 0.02 * fall and "sphere" in why
    scene.add_sphere(radius=0.1 * scale, position=(scale, 0, 0.2 * scale), velocity=(1e3 * scale, 0, 0))
    step, why = time_step(scene.build(), 1e4)
    assert 2e-6 <= step <= 1e-5 and "speed" in why


def test_what_is_flat_is_not_passed_through():
    """Thrown at a plate on the other side of which nothing would stop it."""
    scene = mbvi.Scene(gravity=(0, 0, 0), restitution=0.5)
    scene.add_box((1, 1, 0.01), mass=1.0, name="plate")
    scene.add_box((0.02, 0.3, 0.3), mass=1.0, position=(0, 0, 1), velocity=(0, 0, -10))
    problem = scene.build()
    run = mbvi.simulate(problem, duration=0.3)
    assert 10 * run.step <= 0.005
    assert run.v[-1, 2] < 0 < run.v[-1, 8] - run.v[-1, 2]


def test_a_step_is_a_round_number():
    for duration in np.geomspace(1e-3, 1e3, 40):
        step, _ = time_step(oscillator(0.0), float(duration))
        digit = float(f"{step:.12e}".split("e")[0])
        assert digit in (1.0, 2.0, 5.0)
        assert 0.4 * 0.01 * duration <= step <= 0.01 * duration * (1 + 1e-9)


def test_the_run_says_what_was_chosen_and_its_file_too(tmp_path):
    run = mbvi.simulate(grains(2), duration=0.3, out=tmp_path / "run.h5")
    assert (run.scheme, run.step) == ("EventDriven", 0.0)
    assert run.notes == (default_scheme(grains(2), 0.3)[2],)
    assert mbvi.load(tmp_path / "run.h5").notes == run.notes
    run = mbvi.simulate(boxes(2), duration=0.1, every=3, out=tmp_path / "run.h5")
    _, step, reason = default_scheme(boxes(2), 0.1)
    assert (run.scheme, run.step, run.notes) == ("Centered", step, (reason,))
    again = mbvi.load(tmp_path / "run.h5")
    assert again.notes == run.notes and again.record.scheme.project_positions
    assert mbvi.simulate(grains(2), mbvi.Paoli(), duration=0.01).notes == ()


def test_a_step_alone_is_for_the_default_time_stepping_scheme():
    problem = grains(2)
    run = mbvi.simulate(problem, step=2e-3, duration=0.5)
    named = mbvi.simulate(problem, mbvi.Centered(project_positions=True), step=2e-3, duration=0.5)
    assert (run.scheme, run.step) == ("Centered", 2e-3)
    np.testing.assert_array_equal(run.q, named.q)
    assert "default at a given step" in run.notes[0] and named.notes == ()
    for state, q in zip(mbvi.steps(problem, step=2e-3), named.q[1:], strict=False):
        np.testing.assert_array_equal(state.q, q)


@pytest.mark.parametrize("e", [0.0, 0.6])
def test_many_bodies_land_on_each_other_instead_of_in_each_other(e):
    scheme, step, reason = default_scheme(grains(27, e=e), 1.0)
    assert isinstance(scheme, mbvi.StewartTrinkle) and reason.startswith(f"StewartTrinkle() at h = {step:g} s")
    run = mbvi.simulate(grains(27, e=e), duration=1.0, every=10)
    assert run.scheme == "StewartTrinkle" and run.penetration().max() < 1e-6
    run = mbvi.simulate(grains(27, e=e), duration=0.01, step=1e-3)
    assert (run.scheme, run.step) == ("StewartTrinkle", 1e-3)


@pytest.mark.parametrize("many", [lambda: grains(27, e=1.0), lambda: boxes(30, e=1.0)])
def test_many_elastic_bodies_keep_their_energy(many):
    problem = many()
    scheme, step, reason = default_scheme(problem, 1.0)
    assert isinstance(scheme, mbvi.Centered) and not scheme.project_positions
    assert reason.startswith(f"Centered(), for elastic impacts, at h = {step:g} s was chosen: ")
    assert type(mbvi.simulate(problem, duration=1e-3, step=1e-3).record.scheme) is mbvi.Centered
    # whatever takes energy from them lets them come to rest on each other
    for less in (grains(27, e=0.999), grains(27, e=1.0, pair=0.9), grains(27, e=1.0, friction=0.3)):
        assert isinstance(default_scheme(less, 1.0)[0], mbvi.StewartTrinkle)


@pytest.mark.parametrize("side", [3, 4])
def test_elastic_balls_by_default_have_a_constant_energy_in_every_state(side):
    """Not only at the consistent time of `run.energy()`: kinetic and potential energy of each state (q, v)."""
    problem = grains(side**3, e=1.0)
    run = mbvi.simulate(problem, step=5e-3, duration=1.0, progress=False)
    energy = 0.5 * (run.v**2).sum(axis=1) + G * run.q.reshape(len(run.q), -1, 3)[:, :, 2].sum(axis=1)
    assert len(run.impacts) > side**2
    np.testing.assert_allclose(energy, energy[0], rtol=1e-12)


def test_a_robot_among_many_grains_moves_as_they_do():
    assert isinstance(default_scheme(boxes(101), 1.0)[0], mbvi.StewartTrinkle)
    assert isinstance(default_scheme(grains(27, e=0.0, pair=0.1), 1.0)[0], mbvi.StewartTrinkle)
    assert isinstance(default_scheme(boxes(10), 1.0)[0], mbvi.Centered)
    for count, scheme in ((5, mbvi.Centered), (27, mbvi.StewartTrinkle)):
        scene = mbvi.Scene()
        scene.add_halfspace((0, 0, 1))
        scene.add_spheres([(0.3 * k, 0, 0.1) for k in range(count)], 0.1, 1.0)
        scene.add_urdf(ROBOTS / "quadruped/quadruped.urdf", position=(0, 0, 1))
        assert isinstance(default_scheme(scene.build(), 1.0)[0], scheme)


@pytest.mark.parametrize("case", [case for (e, _), case in CASES.items() if e == 0.5], ids=lambda case: case.name)
def test_the_default_is_right_to_its_tolerance(case):
    run = mbvi.simulate(case.problem, duration=case.duration)
    difference = case.problem.system.difference
    times = np.linspace(0, case.duration, 101)
    assert max(np.abs(difference(case.at(t)[0], run.at(t)[0])).max() for t in times) < 1e-5


def test_a_force_that_jumps_has_no_mode():
    """Dry friction where it sticks: its slope is infinite, and says nothing of a step."""
    system = mbvi.LagrangianSystem(lambda q: np.eye(2), lambda t, q, v: -np.sign(v) - [0.0, 1e4 * q[1]], 2)
    problem = mbvi.Problem(system, [], [0.0, 0.0], [0.0, 0.0])
    step, scale = time_step(problem, 100.0)
    assert step == 2e-3 and "100 1/s" in scale

"""Each example runs, and its number is the one it gave when it was checked by other means or by hand."""

import importlib.util

import numpy as np
import pytest

import mbvi
from support.paths import EXAMPLES

G = 9.81
# dropped from 1 m: fall, then two flights at 0.8 and 0.64 of the first speed
THIRD_BOUNCE = np.sqrt(2 / G) * (1 + 2 * 0.8 + 2 * 0.64)
NUMBERS = {
    # the mark is 3 m to the wall and 1.2 m back at 0.8 of the speed, in 1.8 s
    "bank_shot": ((3.0 + 1.2 / 0.8) / 1.8, 1e-8),
    # the stiffness of the recording, to its noise: other noise finds 59.97 to 60.07
    "find_gains": (60.0, 0.1),
    # the restitution of the recording, to the noise of its pictures
    "find_restitution": (0.83, 3e-4),
    # nearly all of 60 grains; how many pass before the arch forms depends on rounding
    "arch": (58, 3),
    # the limit of finer steps
    "arm_joint_limit": (9.7355, 2.5e-2),
    # g sin(angle) T^2 / 2, which the scheme meets to h T g sin(angle) / 2
    "avalanche": (0.5 * G * np.sin(np.radians(25)) * 0.8**2, 2e-3),
    # a quarter of the period of a pendulum with 7/5 of the inertia, by an elliptic integral
    "bowl": (0.571875, 5e-4),
    # an energy balance, whose error halves with the step
    "box_drum": (1.0, 1e-2),
    # without friction no box stays on a slope
    "box_hopper": (1.0, 0),
    # the flight of a bed that leaves the floor where that falls with g
    "box_shaker": (0.206329, 1e-3),
    # the kinetic energy that boxes have left; asleep it is zero
    "boxes_at_rest": (0.0, 1e-12),
    # the ball against the box that it hits square: (1 + e) 6 / (1 / 1 + 1 / 2)
    "boxes_hit_by_ball": (4.8, 1e-2),
    # the foot's clearance at the start, fallen through
    "drop_robot": (np.sqrt(2 * G * 0.52937537), 1e-2),
    # the balance of momentum, within 1.3e-6 at this step and half of it
    "cassie_landing": (1.0, 4e-6),
    # the limit of finer steps
    "dominoes": (0.845, 1e-2),
    # the balance of energies, an identity of the scheme
    "drum": (1.0, 1e-9),
    # the same at tolerances 1e-9 to 1e-11
    "error_control": (0.189962172, 1e-8),
    # straight lines reflected by hand: one wall, and one wall after the other
    "figure_1": (0.7071421356417671, 5e-4),
    # the equation of motion in the angle of the crank, integrated at 1e-12 (tests/schemes/test_loops.py)
    "four_bar": (0.4921825755902, 1e-8),
    # the limit of finer steps
    "foot_in_gravel": (1.8774, 3e-3),
    # DOP853 at 1e-12 with its event
    "given_functions": (0.8010761557844351, 2e-4),
    # without friction no arch is stable
    "funnel": (1000, 0),
    # the mean of three heaps, which differ by as much
    "heap": (11, 5),
    # EventDriven at 1e-6 to 1e-10
    "hop_on_touchdown": (0.64354, 3e-3),
    # the states of the environment and those of `rollout`
    "hopper_environment": (0.0, 0),
    "hourglass": (120, 0),
    # the launch of which the mark was made
    "hopper_launch": (0.46, 1e-8),
    # the same at tolerance 1e-9, and that of the linear model for small blows (below)
    "keep_hopping": (9.404e-5, 1e-7),
    # the balance of momentum, of first order in the step of the robot
    "mixed_heap": (1.0, 1e-3),
    # the angular momentum about the end that jams
    "painleve_rod": (1.5 * np.sin(1.0), 2e-3),
    # statics: the contact forces of both pads are equal, half of the motor's force
    "parallel_gripper": (8.0, 1e-9),
    # the parabola from where the hand lets go
    "panda_throws_ball": (0.0, 2e-3),
    # the balance of momentum, of first order in the step
    "quadruped_on_rubble": (1.0, 1e-4),
    "robot_on_stairs": (1.0, 2e-3),
    # it stands, but for the last of its swaying
    "quadruped_on_slope": (0.0, 1e-6),
    # more samples and iterations, and other seeds, find 0.31 m too
    "sampled_jump": (0.31, 0.01),
    # Housner's energies, which know no step
    "rocking_block": (1.0, 0.0),
    # the flight of a bed that leaves the floor where that falls with g
    "shaker": (0.206329, 1e-3),
    "step_by_hand": (THIRD_BOUNCE, 2e-3),
    # a fair die: the largest of six distances in standard deviations
    "thrown_die": (1.5, 1.5),
    # the viewer has Pinocchio's own kinematics
    "viser_viewer": (0.0, 1e-12),
}
# arguments for which the numbers above hold as well
FULL_SIZE = {
    "box_drum": {"count": 60},
    "box_hopper": {"count": 200, "duration": 2.5},
    "box_shaker": {"layers": 10},
    "mixed_heap": {"boxes": 500},
}


def load(name):
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.usefixtures("sweeps_in_a_thread")
@pytest.mark.parametrize("name", [p.stem for p in sorted(EXAMPLES.glob("*.py"))])
def test_example(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    number, tolerance = NUMBERS[name]
    assert load(name).main() == pytest.approx(number, abs=tolerance)


@pytest.mark.slow(seconds=13)
@pytest.mark.parametrize("name", FULL_SIZE)
def test_example_of_many_bodies(name):
    number, tolerance = NUMBERS[name]
    assert load(name).main(**FULL_SIZE[name]) == pytest.approx(number, abs=tolerance)


@pytest.mark.slow(seconds=20)
def test_the_wave_of_fifty_dominoes_is_that_of_finer_steps():
    assert load("dominoes").main(count=50, duration=1.5) == pytest.approx(0.869, abs=4e-3)


@pytest.mark.slow(seconds=30)
def test_five_hundred_boxes_come_to_rest(tmp_path):
    page = tmp_path / "rest.html"
    assert load("boxes_at_rest").main(page, count=500, duration=3.0) < 1e-8
    assert page.stat().st_size > 500_000


@pytest.mark.parametrize(("part", "least", "most"), [(0.99, 1e-5, 1e-3), (1.01, 0.0, 1e-12)])
def test_a_box_creeps_in_a_grip_below_the_force_of_coulombs_law(part, least, most):
    """mu F = m (g + a) at the largest acceleration of the lift: below it slides there, above it sticks exactly."""
    example = load("parallel_gripper")
    assert least <= example.creep(example.lift(part * example.LEAST)) < most


def test_the_deviations_of_fitted_restitution_and_friction_are_those_of_many_recordings():
    example = load("find_restitution")
    fits = [example.fit(example.recording(seed), 0.81, 0.51) for seed in range(8)]
    off = np.array([(x - (example.E, example.DROP, example.MU)) / sigma for x, sigma in fits])
    # their mean square is 1, up to what two dozen numbers tell
    assert 0.4 < np.mean(off**2) < 2.0 and np.abs(off).max() < 4


def test_a_throw_is_aimed_in_a_third_of_the_runs_with_derivatives():
    example = load("bank_shot")
    (exact, runs), (other, more) = example.aim(), example.aim(derivatives=False)
    assert exact == pytest.approx(other, abs=1e-5) and 3 * runs < more


def test_a_hopper_is_launched_in_a_third_of_the_runs_with_derivatives():
    """Through three impacts; its place, its angle and all three speeds of the launch are those of which the mark is."""
    example = load("hopper_launch")
    problem = example.make()
    run = mbvi.simulate(problem.at(problem.q0, example.LAUNCH), example.SCHEME, duration=example.END)
    assert [impact.constraints[0] for impact in run.impacts] == [
        "hopper/foot | floor", "hopper/trunk_0 | floor", "hopper/trunk_0 | floor",
    ]  # fmt: skip
    (found, runs), (other, more) = (example.aim(problem, run.q[-1], derivatives) for derivatives in (True, False))
    np.testing.assert_allclose(found, example.LAUNCH, rtol=0, atol=1e-7)
    np.testing.assert_allclose(other, example.LAUNCH, rtol=0, atol=1e-5)
    assert 3 * runs < more


@pytest.mark.slow(seconds=6)
def test_a_hopper_hops_on_as_the_linear_model_of_its_regulator_says():
    example = load("keep_hopping")
    hopper = example.Hopper()
    states, targets, A, B = example.periodic(hopper)
    gains = example.regulator(A, B)[: example.INTERVALS]
    for feedback, least, most in ((1.0, 0.0, 0.05), (0.0, 5.0, 20.0)):
        closed = np.eye(10)
        for a, b, K in zip(A, B, gains, strict=True):
            closed = (a - feedback * b @ K) @ closed
        for size in (0.1, 0.01):
            run = example.hop_on(hopper, states, targets, feedback * np.array(gains), size * example.BLOW)
            before, after = np.abs(run).max(axis=1)
            assert least < after / before < most
            # what is left is of second order in the blow
            assert np.abs(run[1] - closed @ run[0]).max() < 0.5 * size * after


@pytest.mark.slow(seconds=6)
def test_cassie_stands_with_closed_loops():
    run = load("cassie_landing").land(duration=3.0)
    assert run.loop_gap().max() < 1e-12
    late = run.t > 2.5
    # the pelvis neither sinks nor drifts, but for the last of its swaying
    assert np.ptp(run.q[late, :3], axis=0).max() < 5e-3 and run.q[-1, 2] > 0.75


def test_in_a_right_corner_what_starts_near_stays_near():
    """The other half of figure 1: condition (12) holds there, and both runs and the one between say so."""
    example = load("figure_1")
    runs = [example.fly_into_corner(90.0, side) for side in (-example.OFFSET, 0.0, example.OFFSET)]
    apart = np.linalg.norm(runs[0].q[-1] - runs[-1].q[-1])
    assert apart == pytest.approx(2 * example.OFFSET, abs=4e-4)
    assert all(run.diagnosis().horizon == np.inf for run in runs)
    assert example.fly_into_corner(130.0, 0.0).diagnosis().horizon == pytest.approx(0.5, abs=2e-4)

"""Rollouts give the bytes of `simulate`, on any number of threads, and an error ends its own rollout only."""

import copy
import threading

import numpy as np
import pytest

import mbvi
from mbvi.run.loop.mechanism_run import OwnProblem
from mbvi.run.rollouts.rollout_job import Job, RolloutStatus
from support.loop_arguments import among_boxes, carried, one_box, small_heap, two_hoppers
from support.paths import ROBOTS
from support.robot_problems import problem_of

STEP, STEPS, COUNT = 1e-3, 40, 7
SCHEMES = [mbvi.Paoli(), mbvi.MoreauJean(), mbvi.Centered(), mbvi.Centered(project_positions=True)]


def states_about(problem, rng, count=COUNT):
    """Half of them at the configuration of the problem, others beside it and above."""
    nv = problem.system.nv
    q0 = np.tile(problem.q0, (count, 1))
    for i in range(count // 2, count):
        change = 0.01 * rng.normal(size=nv)
        if problem.system.nq > nv:
            change[2] = 0.03
        q0[i] = problem.system.integrate(problem.q0, change)
    v0 = problem.v0 + 0.3 * rng.normal(size=(count, nv))
    return q0, np.array([problem.system.tangent(q, v) for q, v in zip(q0, v0, strict=True)])


def expected_of(problem, q0, v0, scheme, steps=STEPS):
    run = mbvi.simulate(problem.at(q0, v0, problem.t0), scheme, step=STEP, duration=steps * STEP, progress=False)
    return run.q.tobytes(), run.v.tobytes()


def bytes_of(found, i):
    return found.q[i].tobytes(), found.v[i].tobytes()


@pytest.mark.filterwarnings("ignore::mbvi.MbviWarning")
@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
@pytest.mark.parametrize("name", ["hopper", "quadruped", "arm", "double_pendulum"])
def test_a_rollout_has_the_bytes_of_simulate_on_any_number_of_threads(name, scheme, rng):
    problem = problem_of(name, "limits", 0.3)
    q0, v0 = states_about(problem, rng)
    found = [
        mbvi.rollout(problem, q0, v0, steps=STEPS, step=STEP, scheme=scheme, threads=threads) for threads in (1, 2, 3)
    ]
    assert not found[0].status.any()
    for i in range(COUNT):
        # runs before it have changed what the problem's caches hold
        assert bytes_of(found[0], i) == expected_of(problem, q0[i], v0[i], scheme)
    for other in found[1:]:
        assert (other.q.tobytes(), other.v.tobytes()) == (found[0].q.tobytes(), found[0].v.tobytes())


def pushed(e, mu):
    """A function of time acts on one of two boxes."""
    scene = mbvi.Scene(restitution=e, friction=mu)
    scene.add_halfspace((0, 0, 1), name="floor")
    for k in range(2):
        scene.add_box((0.2, 0.2, 0.2), position=(0.4 * k, 0, 0.13), name=f"box {k}")
    scene.add_force("box 0", lambda t, q, v: [20.0 * np.cos(40.0 * t), 0.0, 0.0, 0.0, 0.0, 0.3])
    return scene.build()


@pytest.mark.parametrize("mu", [0.0, 0.6])
@pytest.mark.parametrize("scheme", [mbvi.Paoli(), mbvi.Centered(project_positions=True)], ids=repr)
@pytest.mark.parametrize("scene", [one_box, small_heap, two_hoppers, among_boxes, carried, pushed])
def test_so_it_does_with_bodies_and_several_robots(scene, scheme, mu, rng, monkeypatch):
    problem = scene(0.3, mu)
    q0, v0 = states_about(problem, rng)
    v0[:, 2] -= 3.0
    monkeypatch.setattr(Job, "run_by_simulate", None)
    found = mbvi.rollout(problem, q0, v0, steps=100, step=STEP, scheme=scheme, threads=2)
    assert not found.status.any()
    for i in range(COUNT):
        assert bytes_of(found, i) == expected_of(problem, q0[i], v0[i], scheme, 100)


@pytest.mark.parametrize("scene", [one_box, two_hoppers, carried, pushed])
def test_the_constraints_of_a_copy_belong_to_its_own_system(scene):
    problem = scene(0.0, 0.6)
    own = OwnProblem(problem).problem
    shared = [problem.system, getattr(problem.system, "inner", problem.system)]
    for constraint in own.constraints.constraints:
        assert not any(argument is system for argument in constraint._arguments[0] for system in shared)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::mbvi.MbviWarning")
@pytest.mark.parametrize("scheme", [mbvi.Paoli(), None], ids=repr)
@pytest.mark.parametrize("name", ["solo12", "panda", "talos"])
def test_so_it_does_on_published_robots(name, scheme, rng):
    problem = problem_of(name, "fall", 0.0)
    q0, v0 = states_about(problem, rng)
    found = mbvi.rollout(problem, q0, v0, steps=200, step=STEP, scheme=scheme, threads=2)
    assert not found.status.any()
    for i in range(COUNT):
        assert bytes_of(found, i) == expected_of(problem, q0[i], v0[i], scheme, 200)


def test_what_ran_before_changes_no_byte(rng):
    problem = problem_of("quadruped", "fall", 0.5)
    q0, v0 = states_about(problem, rng, 3)
    first = mbvi.rollout(problem, q0, v0, steps=STEPS, step=STEP)
    mbvi.simulate(problem, mbvi.Paoli(), step=STEP, duration=0.3, progress=False)
    mbvi.rollout(problem, q0[::-1], v0, steps=STEPS, step=2e-3, scheme=mbvi.Paoli())
    again = mbvi.rollout(problem, q0, v0, steps=STEPS, step=STEP, threads=2)
    turned = mbvi.rollout(problem, q0[::-1], v0[::-1], steps=STEPS, step=STEP)
    of_a_copy = mbvi.rollout(copy.deepcopy(problem), q0, v0, steps=STEPS, step=STEP)
    for other in (again, of_a_copy):
        assert other.q.tobytes() == first.q.tobytes()
    assert turned.q[::-1].tobytes() == first.q.tobytes()


def floor_and_robot(control=None, friction=0.0, e=0.3):
    scene = mbvi.Scene(restitution=e, friction=friction)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(
        ROBOTS / "hopper/hopper.urdf", position=(0, 0, 0.56), joints={"knee": 0.4}, control=control, name="hopper"
    )
    return scene.build()


def test_friction_and_a_first_impact_at_the_start(rng):
    problem = floor_and_robot(friction=0.6)
    landed = mbvi.simulate(problem, step=STEP, duration=0.2, progress=False)
    # at the end a foot touches: some of these velocities drive it into the floor
    q0, v0 = np.tile(landed.q[-1], (5, 1)), landed.v[-1] + rng.normal(size=(5, 8))
    found = mbvi.rollout(problem, q0, v0, steps=STEPS, step=STEP, threads=2)
    assert not found.status.any()
    for i in range(5):
        assert bytes_of(found, i) == expected_of(problem, q0[i], v0[i], None)


def test_a_rollout_starts_at_the_time_of_the_problem():
    def torque(t, q, v, tau):
        tau[6] = 10.0 * np.sin(20.0 * t)

    problem = floor_and_robot(mbvi.CompiledControl(torque, 9, 8))
    later = problem.at(problem.q0, problem.v0, 0.3)
    for one in (problem, later):
        found = mbvi.rollout(one, one.q0[None], one.v0[None], steps=STEPS, step=STEP)
        assert bytes_of(found, 0) == expected_of(one, one.q0, one.v0, None)


# problems that the loop does not take


def grains():
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1))
    scene.add_sphere(0.1, position=(0, 0, 0.15))
    scene.add_box((0.2, 0.2, 0.2), position=(0.4, 0, 0.11))
    return scene.build()


def given_functions():
    system = mbvi.LagrangianSystem(lambda q: np.eye(2), lambda t, q, v: np.array([0.0, -9.81]), 2)
    gap = mbvi.GapFunction(lambda q: q[1], lambda q: np.array([0.0, 1.0]))
    return mbvi.Problem(system, [gap], [0.0, 0.02], [0.5, 0.0], restitution=0.5)


def two_robots():
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1))
    for k in range(2):
        scene.add_urdf(ROBOTS / "hopper/hopper.urdf", position=(2 * k, 0, 0.56), joints={"knee": 0.4}, name=f"h{k}")
    return scene.build()


@pytest.mark.parametrize("build", [grains, given_functions, two_robots], ids=lambda f: f.__name__)
@pytest.mark.parametrize("scheme", [None, mbvi.Paoli(), mbvi.SchatzmanPaoli(), mbvi.StewartTrinkle()], ids=repr)
def test_other_problems_give_the_same_arrays(build, scheme, rng):
    problem = build()
    n, (nq, nv) = 3, (problem.system.nq, problem.system.nv)
    q0, v0 = np.tile(problem.q0, (n, 1)), problem.v0 + 0.1 * rng.normal(size=(n, nv))
    found = mbvi.rollout(problem, q0, v0, steps=20, step=STEP, scheme=scheme, threads=2)
    assert found.q.shape == (n, 21, nq)
    assert found.v.shape == (n, 21, nv)
    assert not found.status.any()
    for i in range(n):
        assert bytes_of(found, i) == expected_of(problem, q0[i], v0[i], scheme, 20)


# controls


def held_by_python(torque, scheme):
    """The same torques by a function; the scheme says when in a step it is called."""
    late = 1.0 if scheme.timing.jump == 1.0 else 0.0

    def control(t, q, v):
        return torque[int(np.clip(np.ceil(t / STEP - 1e-6) - 1 if late else np.floor(t / STEP + 1e-6), 0, STEPS - 1))]

    return control


@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
def test_torques_of_each_step_act_as_those_of_a_function(scheme, rng):
    problem, n = floor_and_robot(), 4
    torque = np.zeros((n, STEPS, 8))
    torque[:, :, 6:] = 5.0 * rng.normal(size=(n, STEPS, 2))
    q0, v0 = np.tile(problem.q0, (n, 1)), np.tile(problem.v0, (n, 1))
    options = {"steps": STEPS, "step": STEP, "scheme": scheme}
    found = mbvi.rollout(problem, q0, v0, control=torque, threads=2, **options)
    assert not found.status.any()
    assert np.abs(found.q[0, -1] - found.q[1, -1]).max() > 1e-3
    for i in range(n):
        one = mbvi.rollout(problem, q0[:1], v0[:1], control=torque[i], **options)
        assert one.q[0].tobytes() == found.q[i].tobytes()
        other = mbvi.rollout(problem, q0[:1], v0[:1], control=held_by_python(torque[i], scheme), **options)
        np.testing.assert_allclose(other.q[0], found.q[i], rtol=0, atol=1e-12)
        np.testing.assert_allclose(other.v[0], found.v[i], rtol=0, atol=1e-10)
    # the problem keeps its own control
    assert problem.system.control is None


def test_a_control_replaces_that_of_the_robot(rng):
    own, other = mbvi.ConstantTorque([2.0, -1.0]), mbvi.PDControl([0.3, 0.4], 20.0, 1.0, limit=4.0)
    problem = floor_and_robot(own)
    q0, v0 = states_about(problem, rng, 3)
    options = {"steps": STEPS, "step": STEP}
    replaced = mbvi.rollout(problem, q0, v0, control=other, **options)
    built = mbvi.rollout(floor_and_robot(other), q0, v0, **options)
    kept = mbvi.rollout(problem, q0, v0, **options)
    assert replaced.q.tobytes() == built.q.tobytes() != kept.q.tobytes()
    assert kept.q.tobytes() == mbvi.rollout(floor_and_robot(own), q0, v0, **options).q.tobytes()


# errors


def test_an_invalid_state_fails_only_its_own_rollout(rng):
    problem = problem_of("hopper", "fall", 0.5)
    q0, v0 = states_about(problem, rng, 9)
    before = mbvi.rollout(problem, q0, v0, steps=STEPS, step=STEP)
    q0[1, 0], v0[2, 3], q0[4, 3:7], q0[5, 2], v0[7, 0] = np.nan, np.inf, [0.0, 0.0, 0.0, 1.1], -3.0, 2e8
    for threads in (1, 3):
        found = mbvi.rollout(problem, q0, v0, steps=STEPS, step=STEP, threads=threads)
        bad = [1, 2, 4, 5, 7]
        assert found.status[bad].tolist() == [RolloutStatus.INVALID] * 4 + [RolloutStatus.DIVERGED]
        for i in range(9):
            if i in bad:
                assert np.isnan(found.q[i, -1]).all()
                assert isinstance(found.errors[i], mbvi.MbviError)
            else:
                assert found.errors[i] is None
                assert bytes_of(found, i) == bytes_of(before, i)
    assert "finite" in str(found.errors[1])
    assert "quaternion" in str(found.errors[4])
    assert isinstance(found.errors[5], mbvi.InadmissibleStartError)
    # it is known up to where it diverged
    assert np.isfinite(found.q[7, 0]).all()


def test_an_error_of_a_control_fails_its_rollout():
    def control(t, q, v):
        if q[0] > 0.5:
            raise ZeroDivisionError("on purpose")
        return np.zeros(8)

    problem = floor_and_robot(control)
    q0, v0 = np.tile(problem.q0, (2, 1)), np.zeros((2, 8))
    q0[1, 0] = 1.0
    found = mbvi.rollout(problem, q0, v0, steps=5, step=STEP)
    assert found.status.tolist() == [RolloutStatus.COMPLETE, RolloutStatus.FAILED]
    assert str(found.errors[1]) == "on purpose"


def test_no_rollouts():
    problem = grains()
    for one in (problem, floor_and_robot()):
        found = mbvi.rollout(one, np.zeros((0, one.system.nq)), np.zeros((0, one.system.nv)), steps=3)
        assert found.q.shape == (0, 4, one.system.nq)
        assert found.errors == ()


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"q0": np.zeros(9)}, r"q0 has shape \(9,\); it must have \(n, 9\)"),
        ({"q0": np.zeros((3, 9))}, "q0 has 3 states and v0 has 2"),
        ({"v0": "abc"}, "v0 must be an array of numbers"),
        ({"control": np.zeros((3, 8))}, r"control has shape \(3, 8\); torques have \(5, 8\) or \(2, 5, 8\)"),
        ({"control": np.full((5, 8), np.nan)}, "control"),
        ({"control": "abc"}, "control"),
        ({"steps": 0}, "steps"),
        ({"threads": 0}, "threads"),
        ({"step": -1.0}, "step"),
        ({"scheme": mbvi.EventDriven()}, "EventDriven chooses its own steps"),
        ({"control": mbvi.ConstantTorque(np.zeros(9))}, "acts on 9 velocities; it has 8"),
        (
            {"problem": grains(), "q0": np.zeros((2, 10)), "v0": np.zeros((2, 9)), "control": np.zeros((5, 9))},
            "one robot",
        ),
    ],
)
def test_arguments_are_checked(changed, words):
    problem = floor_and_robot()
    right = {"problem": problem, "q0": np.tile(problem.q0, (2, 1)), "v0": np.zeros((2, 8)), "steps": 5, "step": STEP}
    with pytest.raises(mbvi.InputError, match=words):
        mbvi.rollout(**{**right, **changed})


def test_threads_of_the_caller_may_roll_out_one_problem(rng):
    problem = floor_and_robot()
    q0, v0 = states_about(problem, rng, 4)
    expected = mbvi.rollout(problem, q0, v0, steps=STEPS, step=STEP)
    found = []

    def work():
        for _ in range(3):
            found.append(mbvi.rollout(problem, q0, v0, steps=STEPS, step=STEP, threads=2))

    threads = [threading.Thread(target=work) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 6
    assert all(one.q.tobytes() == expected.q.tobytes() for one in found)

"""Functions of the user in the compiled loop: states are those of the Python step, errors reach the caller."""

import os
import signal
import sys
import threading

import numpy as np
import pytest

import mbvi
from mbvi.run.fixed_steps import taking
from mbvi.run.loop import compiled_loop
from support.paths import ROBOTS

STEP = 1e-3
SCHEMES = [mbvi.Paoli(), mbvi.MoreauJean(), mbvi.Centered(), mbvi.Centered(project_positions=True)]
each_scheme = pytest.mark.parametrize("scheme", SCHEMES, ids=repr)


def scene_of(own=None, **options):
    scene = mbvi.Scene(restitution=0.3, **options)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(
        ROBOTS / "hopper/hopper.urdf", position=(0, 0, 0.5), joints={"knee": 0.4}, control=own, name="hopper"
    )  # fmt: skip
    return scene


def one_control(own=None):
    return scene_of(own or (lambda t, q, v: np.concatenate([np.zeros(6), 5.0 * np.sin(9.0 * t) - 2.0 * v[6:]])))


def scene_control(friction=0.0):
    scene, total = scene_of(friction=friction), np.zeros(8)

    def control(state):
        total[6:] = -3.0 * state.v["hopper"][6:]
        total[6] += 0.5 * sum(contact.percussion for contact in state.contacts)
        return {"hopper": total}

    scene.add_control(control)
    return scene


def beside_a_box():
    scene = scene_of()
    # three different moments of inertia, spinning
    scene.add_box((0.3, 0.2, 0.1), 1.0, position=(1, 0, 0.3), angular_velocity=(2, 1, -3), name="box")
    scene.add_force("box", lambda t, q, v: np.concatenate([[np.cos(t), 0, 1 - v[2]], 0.05 * q[:3] - 0.02 * v[3:]]))
    return scene


def with_both():
    scene = beside_a_box()
    scene.add_control(lambda state: {"hopper": -3.0 * state.v["hopper"] * (np.arange(8) > 5)})
    return scene


SCENES = {
    "a control of a robot": one_control,
    "a control of the scene": scene_control,
    "that with friction": lambda: scene_control(0.5),
    "a force": beside_a_box,
    "a force and a control": with_both,
}


@each_scheme
@pytest.mark.parametrize("name", SCENES)
def test_runs_are_those_of_the_python_step(name, scheme, loops, monkeypatch):
    problem, options = SCENES[name]().build(), {"step": STEP, "duration": 0.25, "progress": False}
    run = mbvi.simulate(problem, scheme, **options)
    assert loops[0].codes.any()
    monkeypatch.setattr(taking, "compiled_loop", lambda *_: None)
    other = mbvi.simulate(SCENES[name]().build(), scheme, **options)
    assert run.impacts
    assert len(run.impacts) == len(other.impacts)
    np.testing.assert_allclose(run.q, other.q, rtol=0, atol=1e-9)
    np.testing.assert_allclose(run.v, other.v, rtol=0, atol=1e-8)


def test_a_control_sees_the_contacts_of_the_step_before(loops):
    seen = []

    def control(state):
        seen.append((state.t, sum(contact.percussion for contact in state.contacts)))

    scene = scene_of()
    scene.add_control(control)
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=STEP, duration=0.2, record="contacts", progress=False)
    assert loops[0].codes.tolist() == [1, 0, 0, 0, 0, 0, 0, 0]
    # when the problem was built, then at the end of each step of `Paoli`
    np.testing.assert_allclose([t for t, _ in seen[1:]], run.t[1:], atol=1e-12)
    forces = [sum(contact.percussion for contact in run.contacts(t)) for t in run.t[:-1]]
    np.testing.assert_allclose([p for _, p in seen[2:]], forces[1:], atol=1e-15)
    assert max(forces) > 0.1


@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_a_control_may_look_at_contacts_after_the_run(friction, loops, monkeypatch):
    """Its state keeps those of its own step, also where the log of the loop is written again."""
    kept, at_once = [], []

    def control(state):
        kept.append(state)
        if len(kept) % 2:
            at_once.append((len(kept) - 1, [contact.percussion for contact in state.contacts]))

    monkeypatch.setattr(compiled_loop, "CHUNK", 20)
    scene = scene_of(friction=friction)
    scene.add_control(control)
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=STEP, duration=0.25, record="contacts", progress=False)
    assert loops[0].codes[0] > 10
    later = [[contact.percussion for contact in state.contacts] for state in kept]
    assert [later[k] for k, _ in at_once] == [found for _, found in at_once]
    forces = [sum(contact.percussion for contact in run.contacts(t)) for t in run.t]
    # the control is called at the end of a step, and sees the contacts of the one before; again where that is retaken
    before = [max(round(state.t / STEP) - 1, 0) for state in kept]
    np.testing.assert_allclose([sum(one) for one in later], [forces[k] for k in before], atol=1e-14)
    assert max(forces) > 0.1


def test_a_control_is_called_once_a_step_with_arrays_that_it_may_keep(loops):
    kept = []

    def control(t, q, v):
        kept.append((t, q, v))
        return np.zeros(8)

    problem = scene_of(control).build()
    run = mbvi.simulate(problem, mbvi.Paoli(), step=STEP, duration=0.08, progress=False)
    assert loops[0].codes.tolist() == [1, 0, 0, 0, 0, 0, 0, 0]
    np.testing.assert_array_equal([q for _, q, _ in kept[1:]], run.q[1:])
    np.testing.assert_array_equal([v for _, _, v in kept[1:]], run.v[:-1])


class Stop(Exception):
    """Of a user."""


WRONG = {
    "an error": (lambda: (_ for _ in ()).throw(Stop("enough")), Stop, "enough"),
    "an interrupt": (lambda: signal.raise_signal(signal.SIGINT), KeyboardInterrupt, None),
    "an exit": (lambda: sys.exit(3), SystemExit, "3"),
    "a shape": (lambda: np.zeros(3), mbvi.InputError, r"the control returned shape \(3,\) at t = 0.101 s"),
    "no number": (lambda: np.full(8, np.nan), mbvi.DivergedError, "the control of hopper is not finite at t = 0.101 s"),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_goes_wrong_in_a_function_reaches_the_caller_with_the_run_so_far(case, loops):
    act, error, words = WRONG[case]
    control = lambda t, q, v: act() if t > 0.1005 else np.zeros(8)  # noqa: E731
    with pytest.raises(error, match=words) as caught:
        mbvi.simulate(scene_of(control).build(), mbvi.Paoli(), step=STEP, duration=1.0, progress=False)
    run = caught.value.run
    assert not run.complete
    assert run.t[-1] == pytest.approx(0.1)
    whole = mbvi.simulate(
        scene_of(lambda t, q, v: np.zeros(8)).build(), mbvi.Paoli(), step=STEP, duration=0.1, progress=False
    )
    np.testing.assert_array_equal(run.q, whole.q)
    assert len(loops) == 2


@pytest.mark.parametrize("seed", range(6))
def test_an_interrupt_at_any_time_ends_the_run(seed):
    """In a function of the user or in a kernel: it is neither lost nor printed."""
    after = 0.2 + 0.05 * np.random.default_rng(seed).random()
    problem = one_control().build()
    mbvi.simulate(problem, mbvi.Paoli(), step=STEP, duration=0.01, progress=False)
    timer = threading.Timer(after, os.kill, (os.getpid(), signal.SIGINT))
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        timer.start()
        with pytest.raises(KeyboardInterrupt) as caught:
            mbvi.simulate(problem, mbvi.Paoli(), step=1e-6, duration=100.0, every=10_000, progress=False)
    finally:
        timer.join()
        signal.signal(signal.SIGINT, before)
    assert not caught.value.run.complete


def test_simulators_and_rollouts_take_them_too():
    problem = one_control().build()
    run = mbvi.simulate(problem, mbvi.Paoli(), step=STEP, duration=0.12, progress=False)
    simulator = mbvi.Simulator(problem, mbvi.Paoli(), step=STEP)
    simulator.step(120)
    np.testing.assert_array_equal(simulator.q, run.q[-1])
    starts = {"q0": np.tile(problem.q0, (3, 1)), "v0": np.tile(problem.v0, (3, 1))}
    found = mbvi.rollout(problem, **starts, steps=120, step=STEP, scheme=mbvi.Paoli(), threads=2)
    np.testing.assert_array_equal(found.q, np.broadcast_to(run.q, found.q.shape))
    for stop in (Stop, KeyboardInterrupt):

        def control(t, q, v, stop=stop):
            if t > 0.0505:
                raise stop
            return np.zeros(8)

        simulator = mbvi.Simulator(scene_of(control).build(), mbvi.Paoli(), step=STEP)
        with pytest.raises(stop):
            simulator.step(100)
        assert simulator.t == pytest.approx(0.05)


ASKS = {
    "rollouts": lambda problem, q, v: mbvi.rollout(
        problem, q[None], v[None], steps=30, step=STEP, scheme=mbvi.Paoli(), control=mbvi.ConstantTorque([0.0, 0.0])
    ),
    "a run": lambda problem, q, v: mbvi.simulate(
        problem.at(q, v), mbvi.Paoli(), step=STEP, duration=0.03, progress=False
    ),
    "gaps": lambda problem, q, v: problem.constraints.active(0.0, q - 0.3 * (np.arange(9) == 2), 1e-6),
}


@pytest.mark.parametrize("what", ASKS)
def test_a_control_may_ask_the_problem_that_runs(what):
    """As a predictive control does: what it asks and the run that goes on are right."""
    asked, runs, calls = [], [], []

    def control(t, q, v):
        calls.append(t)
        if asked and len(asked) < 20 and len(calls) % 9 == 0:
            problem = asked[0]
            # functions of the user within it ask nothing
            asked.clear()
            asked.extend([problem, ASKS[what](problem, q, v)])
        return np.concatenate([np.zeros(6), -2.0 * v[6:]])

    for asks in (True, False):
        calls.clear()
        problem = scene_of(control).build()
        asked[:] = [problem] if asks else []
        runs.append(mbvi.simulate(problem, mbvi.Paoli(), step=STEP, duration=0.25, progress=False))
        assert not asks or len(asked) == 2
    assert runs[0].impacts
    np.testing.assert_array_equal(runs[0].q, runs[1].q)

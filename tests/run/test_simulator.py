"""A simulator goes through the states of `simulate`, however many steps are taken at once."""

import numpy as np
import pytest

import mbvi
from support.loop_arguments import among_boxes, carried, small_heap
from support.paths import ROBOTS
from support.robot_problems import problem_of

STEP, STEPS = 1e-3, 60


def expected_of(problem, scheme, steps=STEPS):
    return mbvi.simulate(problem, scheme, step=STEP, duration=steps * STEP, progress=False)


def grains():
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_sphere(0.1, position=(0, 0, 0.12), name="ball")
    scene.add_box((0.2, 0.2, 0.2), position=(0.4, 0, 0.11))
    return scene.build()


@pytest.mark.parametrize(
    "scheme", [mbvi.Paoli(), mbvi.Centered(project_positions=True), mbvi.SchatzmanPaoli()], ids=repr
)
@pytest.mark.parametrize("name", ["hopper", "double_pendulum", "grains", "robot among boxes"])
def test_a_simulator_has_the_bytes_of_simulate(name, scheme):
    bodies = {"grains": grains, "robot among boxes": lambda: among_boxes(0.3, 0.0)}
    problem = bodies[name]() if name in bodies else problem_of(name, "limits", 0.3)
    run = expected_of(problem, scheme)
    simulator = mbvi.Simulator(problem, scheme, step=STEP)
    for chunk in (1, 7, STEPS):
        q, v = simulator.reset()
        assert (q.tobytes(), v.tobytes()) == (run.q[0].tobytes(), run.v[0].tobytes())
        for k in range(0, STEPS, chunk):
            n = min(chunk, STEPS - k)
            q, v = simulator.step(n)
            assert q is simulator.q
            assert (q.tobytes(), v.tobytes()) == (run.q[k + n].tobytes(), run.v[k + n].tobytes())
            assert simulator.t == pytest.approx(run.t[k + n], rel=1e-12)


def test_a_reset_goes_to_any_state(rng):
    problem = problem_of("quadruped", "fall", 0.0)
    simulator = mbvi.Simulator(problem, step=STEP)
    for _ in range(3):
        simulator.step(50)
        q = problem.system.integrate(problem.q0, 0.005 * rng.normal(size=18)).copy()
        q[2] += 0.02
        v, t = 0.3 * rng.normal(size=18), float(rng.random())
        simulator.reset(q, v, t)
        assert simulator.t == t
        run = expected_of(problem.at(q, v, t), None, 30)
        simulator.step(30)
        assert simulator.q.tobytes() == run.q[-1].tobytes()


def standing(e, mu):
    """A hopper that bends its leg by a PD control."""
    scene = mbvi.Scene(restitution=e, friction=mu)
    scene.add_halfspace((0, 0, 1), name="floor")
    hold = mbvi.PDControl([-0.45, 0.9], 40.0, 1.0)
    joints = {"hip": -0.45, "knee": 0.9}
    scene.add_urdf(ROBOTS / "hopper/hopper.urdf", position=(0, 0, 0.5), joints=joints, control=hold, name="hopper")
    return scene.build()


@pytest.mark.parametrize("mu", [0.0, 0.5])
@pytest.mark.parametrize("scene", [standing, small_heap, among_boxes, carried])
def test_contacts_are_those_of_the_run(scene, mu):
    problem = scene(0.0, mu)
    run = mbvi.simulate(problem, step=STEP, duration=0.2, progress=False, record="contacts")
    simulator, seen = mbvi.Simulator(problem, step=STEP), 0
    assert simulator.contacts == ()
    for k in range(200):
        simulator.step()
        expected = run.contacts(run.t[k + 1])
        found = simulator.contacts
        assert [c.name for c in found] == [c.name for c in expected]
        for a, b in zip(found, expected, strict=True):
            assert a.percussion == b.percussion
            np.testing.assert_array_equal(a.point, b.point)
            np.testing.assert_array_equal(a.normal, b.normal)
            if mu:
                np.testing.assert_array_equal(a.tangential, b.tangential)
                assert a.regime == b.regime
        seen += len(found)
    assert seen > 20


def test_actions_are_written_to_a_control_between_steps():
    def build(control):
        scene = mbvi.Scene()
        scene.add_halfspace((0, 0, 1))
        scene.add_urdf(ROBOTS / "hopper/hopper.urdf", position=(0, 0, 0.56), joints={"knee": 0.4}, control=control)
        return scene.build()

    motors = mbvi.ConstantTorque(np.zeros(2))
    simulator = mbvi.Simulator(build(motors), step=STEP)
    torque = np.zeros((40, 8))
    torque[:, 6:] = 4.0 * np.sin(np.arange(80)).reshape(40, 2)
    for row in torque:
        motors.torque[:] = row[6:]
        simulator.step()
    problem = build(None)
    found = mbvi.rollout(problem, problem.q0[None], problem.v0[None], steps=40, step=STEP, control=torque)
    assert found.q[0, -1].tobytes() == simulator.q.tobytes()


def test_states_are_read_only_and_arguments_are_checked():
    simulator = mbvi.Simulator(grains(), step=STEP)
    with pytest.raises(ValueError, match="read-only"):
        simulator.q[0] = 1.0
    with pytest.raises(mbvi.InputError, match="n must be"):
        simulator.step(0)
    with pytest.raises(mbvi.InputError, match="finite"):
        simulator.reset(np.full(10, np.nan))
    with pytest.raises(mbvi.InputError, match=r"scene\.build"):
        mbvi.Simulator(mbvi.Scene(), step=STEP)


def test_an_error_leaves_the_state_before_it():
    motors, scene = mbvi.ConstantTorque(np.zeros(2)), mbvi.Scene()
    scene.add_urdf(ROBOTS / "hopper/hopper.urdf", position=(0, 0, 1.0), control=motors)
    simulator = mbvi.Simulator(scene.build(), step=STEP)
    simulator.step(5)
    before, t = simulator.q.copy(), simulator.t
    motors.torque[:] = 1e12
    for _ in range(2):
        with pytest.raises(mbvi.DivergedError, match="runs away"):
            simulator.step(10)
        assert simulator.q.tobytes() == before.tobytes()
        assert simulator.t == t
    motors.torque[:] = 0.0
    simulator.step(5)
    expected = mbvi.Simulator(scene.build(), step=STEP)
    expected.step(10)
    np.testing.assert_allclose(simulator.q, expected.q, rtol=0, atol=1e-12)


@pytest.mark.parametrize("scheme", [mbvi.Paoli(), mbvi.Centered(project_positions=True)], ids=repr)
def test_a_control_of_the_scene_sees_the_contacts_of_its_own_run(scheme):
    felt = []

    def push(state):
        felt.append(sum(contact.percussion for contact in state.contacts))
        return {"hopper": [0.0] * 6 + [-20.0 * felt[-1], 3.0 * felt[-1]]}

    scene = mbvi.Scene(friction=0.4)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(ROBOTS / "hopper/hopper.urdf", position=(0, 0, 0.475), joints={"knee": 0.4}, name="hopper")
    scene.add_control(push)
    problem = scene.build()
    simulator = mbvi.Simulator(problem, scheme, step=STEP)
    for _ in range(150):
        simulator.step()
    own = [one for one in felt if one]
    assert own
    felt.clear()
    run = mbvi.simulate(problem, scheme, step=STEP, duration=0.15, progress=False)
    np.testing.assert_array_equal(simulator.q, run.q[-1])
    assert own == [one for one in felt if one]

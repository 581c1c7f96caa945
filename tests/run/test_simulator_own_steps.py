"""A simulator of a scheme that chooses its own steps: as exact as the scheme, at the end of each step."""

import numpy as np
import pytest

import mbvi
from mbvi import reference
from support.paths import ROBOTS
from support.robot_problems import problem_of

STEP = 1e-2
# schemes and the errors that they promise
SCHEMES = [(mbvi.EventDriven(1e-8), 1e-7), (mbvi.Adaptive(1e-4), 1e-3)]
both = pytest.mark.parametrize(("scheme", "promised"), SCHEMES, ids=("EventDriven", "Adaptive"))


@both
@pytest.mark.parametrize("step", [3e-3, 0.07])
@pytest.mark.parametrize("case", [reference.bouncing_ball(0.5), reference.impact_oscillator(0.5)], ids=lambda c: c.name)
def test_states_are_those_of_the_exact_solution(case, step, scheme, promised):
    """Each step ends at its time, and the last at rest where bounces accumulate."""
    simulator = mbvi.Simulator(case.problem, scheme, step=step)
    for k in range(1, int(case.duration / step)):
        q, _ = simulator.step()
        assert simulator.t == pytest.approx(k * step, rel=1e-14)
        np.testing.assert_allclose(q, case.at(simulator.t)[0], rtol=0, atol=promised)


def hopper(control=None, mu=0.0, height=0.56):
    scene = mbvi.Scene(friction=mu)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(
        ROBOTS / "hopper/hopper.urdf", position=(0, 0, height), joints={"knee": 0.4}, control=control, name="hopper"
    )
    return scene.build()


@both
@pytest.mark.parametrize("mu", [0.0, pytest.param(0.3, marks=pytest.mark.slow)])
def test_what_is_written_to_a_control_acts_from_then_on(rng, scheme, promised, mu):
    """As by runs from each state to the next, under torques that hold, lift off and press down."""
    motors = mbvi.ConstantTorque(np.zeros(2))
    problem = hopper(motors, mu)
    simulator = mbvi.Simulator(problem, scheme, step=0.02)
    q, v, open_, closed = problem.q0, problem.v0, 0, 0
    for torque in np.repeat([[0.0, 0.0], [0.0, -60.0], [0.0, -5.0], [0.5, 1.0]], 4, axis=0):
        motors.torque[:] = torque
        simulator.step()
        run = mbvi.simulate(problem.at(q, v, simulator.t - 0.02), scheme, duration=0.02)
        q, v = run.q[-1], run.v[-1]
        np.testing.assert_allclose(simulator.q, q, rtol=0, atol=promised)
        np.testing.assert_allclose(simulator.v, v, rtol=0, atol=promised * max(1.0, np.abs(v).max()))
        closed, open_ = closed + bool(simulator.contacts), open_ + (not simulator.contacts)
    assert closed > 3
    assert open_ > 3


@both
@pytest.mark.parametrize("mu", [0.0, 0.5])
def test_percussions_of_contacts_add_up_to_the_change_of_momentum(scheme, promised, mu):
    """Of all impacts and reactions within a step, in any direction."""
    scene = mbvi.Scene(restitution=0.6, friction=mu)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_sphere(0.1, position=(0, 0, 0.15), velocity=(1.0, 0, 0), mass=2.0, name="ball")
    problem = scene.build()
    simulator, before = mbvi.Simulator(problem, scheme, step=0.05), problem.v0[:3].copy()
    for _ in range(20):
        _, v = simulator.step()
        given = np.zeros(3)
        for contact in simulator.contacts:
            assert contact.name == "ball | floor"
            assert contact.force == pytest.approx(contact.percussion / 0.05)
            # the normal points out of the floor
            given += contact.percussion * contact.normal + (0.0 if contact.tangential is None else contact.tangential)
        expected = 2.0 * (v[:3] - before) + 2.0 * 9.81 * 0.05 * np.array([0, 0, 1])
        # bounces that rise less than 1e-14 of the scene's length end without a percussion
        lost = 2.0 * np.sqrt(2.0 * 9.81 * 1e-14 * problem.length)
        np.testing.assert_allclose(given, expected, rtol=0, atol=promised + lost)
        before = v[:3].copy()
    assert simulator.contacts


@both
def test_a_reset_goes_to_any_state_and_begins_again(rng, scheme, promised):
    problem = problem_of("hopper", "fall", 0.0)
    simulator = mbvi.Simulator(problem, scheme, step=STEP)
    simulator.step(8)
    first = simulator.q.copy()
    v = 0.3 * rng.normal(size=len(problem.v0))
    simulator.reset(problem.q0, v, 2.0)
    simulator.step(3)
    run = mbvi.simulate(problem.at(problem.q0, v, 2.0), scheme, duration=3 * STEP)
    assert simulator.t == pytest.approx(2.0 + 3 * STEP)
    np.testing.assert_allclose(simulator.q, run.q[-1], rtol=0, atol=promised)
    simulator.reset()
    simulator.step(8)
    assert simulator.q.tobytes() == first.tobytes()


@both
def test_the_law_acts_at_the_start(scheme, promised):
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1))
    scene.add_sphere(0.1, position=(0, 0, 0.1), velocity=(0, 0, -2.0), mass=1.0, name="ball")
    simulator = mbvi.Simulator(scene.build(), scheme, step=STEP)
    assert simulator.v[2] == pytest.approx(1.0)
    (contact,) = simulator.contacts
    assert contact.percussion == pytest.approx(3.0)
    assert contact.force == np.inf
    simulator.step()
    assert simulator.contacts == ()


@both
def test_an_error_leaves_the_state_before_it(scheme, promised):
    """What is asked for after it begins there, with what acts then; a reset that fails changes nothing either."""
    fails, push = np.inf, -5.0

    def control(t, q, v):
        if t > fails:
            raise ValueError("the motor is off")
        return np.r_[np.zeros(7), push]

    simulator = mbvi.Simulator(hopper(control, height=1.0), scheme, step=STEP)
    simulator.step(5)
    push = 2.0
    expected = simulator.step(5)[0].copy()
    simulator.reset()
    push = -5.0
    simulator.step(5)
    before = simulator.q.copy()
    # within the step, and from its start on
    for time in (0.055, 0.0, 0.055):
        fails = time
        with pytest.raises(ValueError, match="the motor is off"):
            simulator.step(10)
        assert simulator.q.tobytes() == before.tobytes()
        assert simulator.t == pytest.approx(0.05)
    if isinstance(scheme, mbvi.EventDriven):
        # evaluates forces at the start
        with pytest.raises(ValueError, match="the motor is off"):
            simulator.reset(simulator.q, simulator.v, 7.0)
        assert simulator.t == pytest.approx(0.05)
    fails, push = np.inf, 2.0
    simulator.step(5)
    np.testing.assert_allclose(simulator.q, expected, rtol=0, atol=promised)


@both
def test_connections_are_switched_between_steps(scheme, promised):
    """A box that is attached to another shares its momentum; released, both go on alike."""
    scene = mbvi.Scene(gravity=(0, 0, 0))
    scene.add_box((0.1, 0.1, 0.1), position=(0, 0, 0), velocity=(1.0, 0, 0), mass=1.0, name="a")
    scene.add_box((0.1, 0.1, 0.1), position=(0.5, 0, 0), mass=3.0, name="b")
    simulator = mbvi.Simulator(scene.build(), scheme, step=STEP)
    simulator.step(10)
    name = simulator.attach("a", "b")
    _, v = simulator.step(10)
    assert simulator.t == pytest.approx(0.2)
    np.testing.assert_allclose(v.reshape(-1, 6)[:, 0], 0.25, rtol=0, atol=1e-12)
    np.testing.assert_allclose(simulator.q.reshape(-1, 7)[:, 0], [0.1 + 0.025, 0.5 + 0.025], rtol=0, atol=1e-12)
    simulator.detach(name)
    q, _ = simulator.step(10)
    np.testing.assert_allclose(q.reshape(-1, 7)[:, 0], [0.15, 0.55], rtol=0, atol=1e-12)

"""Forces that act for a short time within a long smooth motion: their impulse is not lost."""

from pathlib import Path

import numpy as np
import pytest

import mbvi

ROBOTS = Path(__file__).parents[3] / "robots"
TOLERANCE = 1e-6


def drawn(seed):
    """Return size, begin and length of a pulse of 10 to 60 ms."""
    random = np.random.default_rng(seed)
    return random.uniform(1.0, 30.0), random.uniform(0.2, 1.5), random.uniform(0.01, 0.06)


def pulse(size, begin, length):
    return lambda t: size if begin <= t < begin + length else 0.0


def assert_pushed(run, k, size, begin, length, mass=1.0):
    """Assert the velocity and the way along a coordinate that a pulse has given to a mass at rest."""
    speed, way = size * length / mass, size * length / mass * (run.t[-1] - begin - 0.5 * length)
    bound = 10 * TOLERANCE * max(1.0, np.abs(run.v).max())
    np.testing.assert_allclose(run.v[-1][k], speed, rtol=0, atol=bound)
    np.testing.assert_allclose(run.q[-1][k] - run.q[0][k], way, rtol=0, atol=2 * bound)


@pytest.mark.parametrize("seed", range(8))
def test_a_ball_in_flight_is_pushed(seed):
    size, begin, length = drawn(seed)
    force, scene = pulse(size, begin, length), mbvi.Scene()
    scene.add_sphere(0.1, position=(0, 0, 50.0), name="ball")
    scene.add_force("ball", lambda t, q, v: [force(t), 0, 0, 0, 0, 0])
    run = mbvi.simulate(scene.build(), mbvi.EventDriven(TOLERANCE), duration=2.0)
    assert_pushed(run, 0, size, begin, length)
    assert len(run.t) < 60


@pytest.mark.parametrize("seed", range(4))
def test_a_box_that_stands_is_pushed(seed):
    size, begin, length = drawn(seed)
    force, scene = pulse(size, begin, length), mbvi.Scene(friction=0.0)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_box((1.0, 1.0, 0.2), mass=2.0, position=(0, 0, 0.1), name="box")
    # at the height of the centre: the box does not tip
    scene.add_force("box", lambda t, q, v: [0, force(t), 0, 0, 0, 0])
    run = mbvi.simulate(scene.build(), mbvi.EventDriven(TOLERANCE), duration=2.0)
    assert_pushed(run, 1, size, begin, length, 2.0)


@pytest.mark.parametrize("seed", range(4))
def test_a_system_of_the_user_is_pushed(seed):
    size, begin, length = drawn(seed)
    force = pulse(size, begin, length)
    system = mbvi.LagrangianSystem(lambda q: np.eye(2), lambda t, q, v: np.array([force(t), -9.81]), 2)
    problem = mbvi.Problem(system, [], [0.0, 50.0], [0.0, 0.0])
    assert_pushed(mbvi.simulate(problem, mbvi.EventDriven(TOLERANCE), duration=2.0), 0, size, begin, length)


@pytest.mark.parametrize("joint", [7, 13])
def test_a_control_of_a_robot_is_felt_in_flight(joint):
    """The same torque for 20 ms as in steps of 0.1 ms."""
    force, scene = pulse(2.0, 0.31, 0.02), mbvi.Scene()
    scene.add_urdf(
        ROBOTS / "quadruped/quadruped.urdf", position=(0, 0, 50.0), control=lambda t, q, v: force(t) * np.eye(18)[joint]
    )
    problem = scene.build()
    run = mbvi.simulate(problem, mbvi.EventDriven(TOLERANCE), duration=0.5)
    steps = mbvi.simulate(problem, mbvi.Centered(), step=1e-4, duration=0.5)
    assert run.v[-1][joint] > 3.0
    np.testing.assert_allclose(steps.v[-1], run.v[-1], rtol=0, atol=1e-3)


@pytest.mark.parametrize("size", [5.0, 30.0])
def test_a_box_with_friction_is_pushed(size):
    """It stays where friction holds it; else it slides until friction has taken its velocity."""
    force, scene, length = pulse(size, 0.7, 0.02), mbvi.Scene(friction=0.5), 0.02
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_box((1.0, 1.0, 0.2), mass=2.0, position=(0, 0, 0.1), name="box")
    # at the floor: the push turns the box no more than its friction
    scene.add_force("box", lambda t, q, v: [force(t), 0, 0, 0, -0.1 * force(t), 0])
    run = mbvi.simulate(scene.build(), mbvi.EventDriven(TOLERANCE), duration=2.0)
    most = 0.5 * 9.81
    speed = max(size / 2.0 - most, 0.0) * length
    np.testing.assert_allclose(run.q[-1][0], 0.5 * speed * length + 0.5 * speed**2 / most, rtol=0, atol=10 * TOLERANCE)
    assert run.notes == ()


def test_a_box_is_lifted():
    """It jumps, and lands after the time of its flight."""
    size, begin, length = 60.0, 0.7, 0.02
    force, scene = pulse(size, begin, length), mbvi.Scene()
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_box((1.0, 1.0, 0.2), mass=2.0, position=(0, 0, 0.1), name="box")
    scene.add_force("box", lambda t, q, v: [0, 0, force(t), 0, 0, 0])
    run = mbvi.simulate(scene.build(), mbvi.EventDriven(TOLERANCE), duration=2.0)
    speed = (size / 2.0 - 9.81) * length
    flight = (speed + np.sqrt(speed**2 + 9.81 * speed * length)) / 9.81
    assert len(run.impacts) == 1 and run.notes == ()
    np.testing.assert_allclose(run.impacts[0].time, begin + length + flight, rtol=0, atol=10 * TOLERANCE)


@pytest.mark.parametrize("begin", [0.2, 0.35, 0.5])
@pytest.mark.parametrize("gap", [0.0, 0.05])
def test_a_ball_that_a_pulse_sends_back_lands(gap, begin):
    """What was measured at the end of a step that is then not taken says nothing of the motion."""
    force, scene = pulse(-100.0, begin, 0.02), mbvi.Scene(gravity=(0, 0, 0), restitution=1.0)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_sphere(0.1, mass=1.0, position=(0, 0, 0.1 + gap), velocity=(0, 0, 1.0), name="ball")
    scene.add_force("ball", lambda t, q, v: [0, 0, force(t), 0, 0, 0])
    run = mbvi.simulate(scene.build(), mbvi.EventDriven(TOLERANCE), duration=1.5)
    assert len(run.impacts) == 1
    np.testing.assert_allclose(run.impacts[0].time, 2.0 * (begin + 0.01) + gap, rtol=0, atol=10 * TOLERANCE)

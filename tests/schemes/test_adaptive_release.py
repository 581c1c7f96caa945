"""Contacts that open under `Adaptive`: where their force vanishes, and not later."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import mbvi
from support.paths import ROBOTS

GRAVITY = 9.81


def dome(speed, angle=0.2):
    """A ball that slides down a fixed one; the centres are 1 m apart."""
    scene = mbvi.Scene(restitution=0.0)
    scene.add_sphere(0.6, position=(0, 0, 0), name="dome", fixed=True)
    at, along = (np.sin(angle), 0, np.cos(angle)), np.array([np.cos(angle), 0, -np.sin(angle)])
    scene.add_sphere(0.4, position=at, velocity=speed * along, name="ball")
    return scene


def slid(speed, duration, angle=0.2):
    """Return the exact position and velocity: along the circle until the force vanishes, then a parabola."""

    def pressed(t, y):
        return GRAVITY * np.cos(y[0]) - y[1] ** 2

    pressed.terminal = True
    found = solve_ivp(
        lambda t, y: [y[1], GRAVITY * np.sin(y[0])], (0, duration), [angle, speed], rtol=1e-12, atol=1e-13,
        events=pressed,
    )  # fmt: skip
    a, w = found.y[:, -1]
    left = duration - found.t[-1]
    fall = np.array([0, 0, -GRAVITY])
    q, v = np.array([np.sin(a), 0, np.cos(a)]), w * np.array([np.cos(a), 0, -np.sin(a)])
    return q + left * v + 0.5 * left**2 * fall, v + left * fall, found.status == 1


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3, 1e-4, 1e-5])
@pytest.mark.parametrize("speed", [0.5, 1.5])
def test_a_ball_leaves_a_dome_where_nothing_presses_it(speed, tolerance):
    problem = dome(speed).build()
    q, v, leaves = slid(speed, 0.7)
    assert leaves
    run = mbvi.simulate(problem, mbvi.Adaptive(tolerance), duration=0.7)
    size = problem.length
    assert np.abs(run.q[-1] - q).max() <= 10.0 * tolerance * size
    assert np.abs(run.v[-1] - v).max() <= 10.0 * tolerance * np.abs(v).max()


def test_what_happens_elsewhere_holds_no_contact_closed():
    """Short steps of another body, which a stiff spring shakes, do not hold back a contact that opens slowly."""
    scene = dome(0.5)
    scene.add_sphere(0.4, position=(5.0, 0, 0), velocity=(1.0, 0, 0), name="other")
    scene.add_force("other", lambda t, q, v: np.array([-4e4 * (q[0] - 5.0), 0.0, GRAVITY]))
    problem = scene.build()
    run = mbvi.simulate(problem, mbvi.Adaptive(1e-3), duration=0.7)
    q, _, _ = slid(0.5, 0.7)
    assert len(run.t) > 500
    assert np.abs(run.q[-1][:3] - q).max() <= 1e-3 * problem.length


@pytest.mark.parametrize("tolerance", [1e-4, 1e-5])
def test_a_foot_that_slides_lifts_off_where_its_force_vanishes(tolerance):
    """Against `EventDriven` at 1e-8. The foot moves along a curve, on which its rate within a step is negative."""
    motors, scene = mbvi.ConstantTorque(np.zeros(2)), mbvi.Scene(friction=0.3)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(ROBOTS / "hopper/hopper.urdf", position=(0, 0, 0.56), joints={"knee": 0.4}, control=motors)
    problem = scene.build()
    exact = mbvi.EventDriven(1e-8)
    before = mbvi.Simulator(problem, exact, step=0.08)
    for torque in ([0.0, 0.0], [0.0, -60.0], [0.0, -5.0]):
        motors.torque[:] = torque
        before.step()
    start = problem.at(before.q, before.v)
    motors.torque[:] = 0.5, 1.0
    expected = mbvi.simulate(start, exact, duration=0.02)
    assert expected.notes == ()
    run = mbvi.simulate(start, mbvi.Adaptive(tolerance), duration=0.02)
    assert np.abs(run.q[-1] - expected.q[-1]).max() <= 10.0 * tolerance
    assert np.abs(run.v[-1] - expected.v[-1]).max() <= 10.0 * tolerance * np.abs(expected.v[-1]).max()

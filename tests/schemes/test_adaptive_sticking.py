"""Adaptive where a body turns about a contact that sticks: Coulomb's law sees all the force that bends its path."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import mbvi

# half sides of a box [m], its friction, its first angle and rate, and gravity in its plane, which the floor is not
# at right angles to
HALF, MU, ANGLE, RATE = np.array([0.245, 0.2]), 0.586, 1.1, 1.668
GRAVITY = np.array([-3.92, -8.99])
INERTIA = (4.0 * HALF @ HALF) / 12.0 + HALF @ HALF


def _turned(angle, x):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * x[0] - s * x[1], s * x[0] + c * x[1]])


CORNER = min((HALF * [x, z] for x in (1, -1) for z in (1, -1)), key=lambda r: _turned(ANGLE, r)[1])


def _forces(angle, rate):
    """Angular acceleration about the edge, normal force and friction of a box of mass 1."""
    arm = -_turned(angle, CORNER)
    change = (arm[0] * GRAVITY[1] - arm[1] * GRAVITY[0]) / INERTIA
    force = change * np.array([-arm[1], arm[0]]) - rate**2 * arm - GRAVITY
    return change, force[1], force[0]


def _exact(end):
    def limit(t, y):
        _, normal, friction = _forces(*y)
        return MU * normal - abs(friction)

    limit.terminal = True
    return solve_ivp(
        lambda t, y: [y[1], _forces(*y)[0]], (0.0, end), [ANGLE, RATE], method="DOP853", rtol=1e-12, atol=1e-13,
        events=limit, dense_output=True,
    )  # fmt: skip


def _box():
    arm = -_turned(ANGLE, CORNER)
    speed = RATE * np.array([-arm[1], arm[0]])
    scene = mbvi.Scene(gravity=(GRAVITY[0], 0, GRAVITY[1]), friction=MU)
    scene.add_halfspace((0, 0, 1))
    scene.add_box(
        (2 * HALF[0], 0.3, 2 * HALF[1]), 1.0, position=(arm[0], 0, arm[1]), rotation=(0, -ANGLE, 0),
        velocity=(speed[0], 0, speed[1]), angular_velocity=(0, -RATE, 0),
    )  # fmt: skip
    return scene.build()


def _slip(q, v):
    r = _turned(2 * np.arctan2(-q[4], q[6]), CORNER)
    return v[0] + v[4] * r[1]


@pytest.mark.parametrize("tolerance", [1e-3, 1e-4, 1e-5])
def test_it_begins_to_slip_where_the_force_reaches_the_cone(tolerance):
    exact = _exact(0.2)
    begins = exact.t[-1]
    run = mbvi.simulate(_box(), mbvi.Adaptive(tolerance), duration=begins + 0.025, record="contacts")
    slips = np.array([abs(_slip(q, v)) for q, v in zip(run.q, run.v, strict=True)]) > 1e-9
    first = int(np.argmax(slips))
    # within the step that ends with a slip, or the next
    assert run.t[first - 1] <= begins + 2.0 * tolerance**0.5 * 0.1
    assert run.t[first] >= begins - 2.0 * tolerance**0.5 * 0.1
    assert len(run.t) < 300
    # the state where it still sticks, and the forces of the steps
    for k in range(1, first):
        angle, _ = exact.sol(run.t[k])
        np.testing.assert_allclose(run.q[k, [0, 2]], -_turned(angle, CORNER), atol=3 * tolerance)
        h = run.t[k] - run.t[k - 1]
        middle = exact.sol(0.5 * (run.t[k] + run.t[k - 1]))
        _, normal, friction = _forces(*middle)
        contacts = run.contacts(run.t[k])
        along = sum(c.tangential[0] for c in contacts) / h
        assert sum(c.percussion for c in contacts) / h == pytest.approx(normal, abs=12.0 * h + 0.02)
        assert along == pytest.approx(friction, abs=12.0 * h + 0.02)


def test_errors_after_it_slips_stay_within_tolerances():
    duration = _exact(0.2).t[-1] + 0.025
    finest = mbvi.simulate(_box(), mbvi.EventDriven(1e-9), duration=duration)
    for tolerance in (1e-2, 1e-3, 1e-4, 1e-5):
        run = mbvi.simulate(_box(), mbvi.Adaptive(tolerance), duration=duration)
        assert np.abs(run.q[-1] - finest.q[-1]).max() < 3.0 * tolerance
        assert np.abs(run.v[-1] - finest.v[-1]).max() < 10.0 * tolerance

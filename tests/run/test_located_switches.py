"""Connections that are switched within the steps of schemes that choose their lengths."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mbvi
from mbvi.results.run_data import arriving, states_at_switches

TOLERANCE = 1e-8
MASSES, SIZES = (2.0, 1.0), ((0.2, 0.3, 0.4), (0.3, 0.1, 0.2))
INERTIAS = [
    m / 12 * np.diag([b * b + c * c, a * a + c * c, a * a + b * b]) for m, (a, b, c) in zip(MASSES, SIZES, strict=True)
]
FLYING = np.array([1.0, 0, 0.5, 0.3, -1.0, 2.0, -1.0, 0.2, 0, 3.0, 0.5, -0.7])


def two_boxes(v=FLYING, gravity=(0, 0, 0)):
    """Two boxes that fly and spin, and a weld of both that is off."""
    scene = mbvi.Scene(gravity=gravity)
    scene.add_box(SIZES[0], MASSES[0], position=(0, 0, 0), name="a")
    scene.add_box(SIZES[1], MASSES[1], position=(0.5, 0.2, 0.1), name="b")
    scene.weld("a", "b", name="grasp", active=False)
    problem = scene.build()
    return problem.at(problem.q0, v)


def run_of(problem, switch, duration, scheme=None, **options):
    return mbvi.simulate(
        problem, scheme or mbvi.EventDriven(TOLERANCE), duration=duration, switch=switch, progress=False, **options
    )


def between(start, end, name="grasp"):
    return lambda state: {name: start <= state.t < end}


def relative(q):
    a, b = (pin.XYZQUATToSE3(place) for place in q.reshape(2, 7))
    return (a.inverse() * b).homogeneous


def projected(problem, name, q, v):
    """Return the nearest velocity in the kinetic metric that keeps the pose of two free boxes, in plain numbers."""
    M = np.zeros((12, 12))
    for k in range(2):
        M[6 * k : 6 * k + 3, 6 * k : 6 * k + 3] = MASSES[k] * np.eye(3)
        M[6 * k + 3 : 6 * k + 6, 6 * k + 3 : 6 * k + 6] = INERTIAS[k]
    x, turns = q.reshape(2, 7)[:, :3], [pin.Quaternion(place[3:]).toRotationMatrix() for place in q.reshape(2, 7)]
    arm = x[1] - x[0]
    cross = np.array([[0, -arm[2], arm[1]], [arm[2], 0, -arm[0]], [-arm[1], arm[0], 0]])
    J = np.zeros((6, 12))
    # v_b = v_a + w x arm, with angular velocities of the bodies in the world
    J[:3, :3], J[:3, 3:6], J[:3, 6:9] = -np.eye(3), cross @ turns[0], np.eye(3)
    J[3:, 3:6], J[3:, 9:] = -turns[0], turns[1]
    W = np.linalg.solve(M, J.T)
    return v - W @ np.linalg.solve(J @ W, J @ v)


@settings(max_examples=6, deadline=None, derandomize=True)
@given(st.lists(st.floats(-3.0, 3.0), min_size=12, max_size=12))
def test_welding_in_flight_is_the_projection_at_exactly_its_time(v):
    """The jump is the nearest velocity, energy and momenta are those of one body; the record says so."""
    run = run_of(two_boxes(np.array(v)), between(0.0173, 1.0), 0.05)
    (made,) = run.record.switches
    assert made.time == 0.0173
    k = states_at_switches(run)[0]
    assert run.t[k] == 0.0173
    np.testing.assert_array_equal(run.v[k], made.after)
    np.testing.assert_allclose(made.after, projected(run.problem, "grasp", made.q, made.before), atol=1e-12)
    held = relative(made.q)
    for t in (0.0173, 0.03, 0.05):
        np.testing.assert_allclose(relative(run.at(t)[0]), held, atol=1e-12)
    if run.impacts:
        (impact,) = run.impacts
        assert impact.time == 0.0173 and set(impact.constraints) == {"grasp"}
        change = run.energy()[k] - run.energy()[k - 1]
        assert impact.energy_change == pytest.approx(change, abs=1e-12)


def test_states_on_both_sides_of_a_switch_are_those_of_the_motion_before_and_after():
    run = run_of(two_boxes(), between(0.02, 0.04), 0.06)
    on, off = run.record.switches
    assert (on.time, off.time) == (0.02, 0.04)
    np.testing.assert_array_equal(off.before, off.after)
    for one, velocity in zip((on, off), (on.before, off.before), strict=True):
        q, v = run.at(one.time - 1e-12)
        np.testing.assert_allclose(v, velocity, atol=1e-9)
        np.testing.assert_allclose(q, one.q, atol=1e-10)
        np.testing.assert_array_equal(run.at(one.time)[1], one.after)
    np.testing.assert_allclose(arriving(run)[states_at_switches(run)], [on.before, off.before], atol=0.0)
    # both centres fly straight before and after
    places, rates = off.q.reshape(2, 7)[:, :3], off.after.reshape(2, 6)[:, :3]
    np.testing.assert_allclose(run.at(0.055)[0].reshape(2, 7)[:, :3], places + 0.015 * rates, atol=1e-13)
    np.testing.assert_allclose(run.at(0.015)[0].reshape(2, 7)[1, :3], [0.485, 0.203, 0.1], atol=1e-13)
    assert run.notes[-2:] == tuple(f"connections were switched at {one}" for one in (on, off))

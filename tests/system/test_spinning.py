"""The rule of gyroscopic torques: it keeps the energy of rotation and the norm of the angular momentum at any step."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from mbvi.system import ArticulatedSystem, FreeBodies
from mbvi.system.free.spinning import PART, free_links, principal, spin
from mbvi_studies.chart.errors import fitted_order
from support.spin_arguments import model_of_free_links, random_inertias

STILL = np.zeros(3)
seeds = st.integers(0, 2**32 - 1)


def body(seed, mass=2.0):
    rng = np.random.default_rng(seed)
    return rng, FreeBodies(np.array([mass]), random_inertias(rng, 1), STILL, ("a",))


def spun(system, w, h):
    """The angular velocity of a body after a step without forces."""
    return system.free_velocity(0.0, np.array([0, 0, 0, 0, 0, 0, 1.0]), np.array([*STILL, *w]), h)[3:]


@given(seed=seeds, speed=st.floats(1e-6, 1e6), h=st.sampled_from([1e-4, 1e-3, 1e-2, 2e-2]))
def test_it_keeps_energy_and_momentum_at_any_speed(seed, speed, h):
    rng, system = body(seed)
    w, inertia = speed * rng.normal(size=3), system.inertias[0]
    before = w @ inertia @ w, np.linalg.norm(inertia @ w)
    for _ in range(20):
        w = spun(system, w, h)
        np.testing.assert_allclose((w @ inertia @ w, np.linalg.norm(inertia @ w)), before, rtol=1e-12)


@given(seed=seeds, angle=st.floats(1e-6, 0.8), h=st.sampled_from([1e-3, 2e-2]))
def test_it_is_the_implicit_midpoint_rule(seed, angle, h):
    rng, system = body(seed)
    w, inertia = rng.normal(size=3), system.inertias[0]
    w *= angle / (h * np.linalg.norm(w))
    new = spun(system, w, h)
    mean = 0.5 * (w + new)
    most = np.linalg.norm(inertia, 2) * np.linalg.norm(w)
    np.testing.assert_allclose(inertia @ (new - w), -h * np.cross(mean, inertia @ mean), rtol=0, atol=1e-14 * most)


@pytest.mark.parametrize("seed", range(6))
def test_it_has_order_two(seed):
    rng, system = body(seed)
    w, inertia, duration = 10.0 * rng.normal(size=3), system.inertias[0], 0.5
    exact = solve_ivp(
        lambda t, x: np.linalg.solve(inertia, np.cross(inertia @ x, x)), (0, duration), w, "DOP853", rtol=1e-13,
        atol=1e-13,
    ).y[:, -1]  # fmt: skip
    counts, errors = np.array([100, 200, 400]), []
    for count in counts.tolist():
        x = w
        for _ in range(count):
            x = spun(system, x, duration / count)
        errors.append(np.linalg.norm(x - exact))
    assert 1.8 < fitted_order(duration / counts, np.array(errors)) < 2.2


def test_a_ball_keeps_its_angular_velocity_to_the_bit(rng):
    system = FreeBodies(np.ones(1), 0.4 * np.eye(3)[None], STILL, ("a",))
    w = 100.0 * rng.normal(size=3)
    assert spun(system, w, 1e-2).tobytes() == w.tobytes()


@given(seed=seeds, angle=st.floats(1e-3, 200.0))
def test_a_vector_that_is_fixed_in_the_world_turns_back_with_the_body(seed, angle):
    """Exactly about a principal axis; its length always."""
    rng = np.random.default_rng(seed)
    factors, vector, k = principal(random_inertias(rng, 1))[2][0], rng.normal(size=3), int(rng.integers(3))
    state = np.array([angle * np.eye(3)[k], vector])
    spin(factors, 1.0, state)
    np.testing.assert_allclose(state[0], angle * np.eye(3)[k])
    np.testing.assert_allclose(state[1], Rotation.from_rotvec(-angle * np.eye(3)[k]).apply(vector), atol=1e-12)
    state = np.array([angle * rng.normal(size=3), vector])
    spin(factors, 1.0, state)
    assert np.linalg.norm(state[1]) == pytest.approx(np.linalg.norm(vector), rel=1e-12)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_what_is_not_finite_stays_so(bad):
    _, system = body(1)
    assert not np.isfinite(spun(system, [bad, 1.0, 2.0], 1e-2)).all()


def test_factors_that_are_those_of_no_body_leave_it_at_its_energy(rng):
    """Newton's method need not converge then; the angular velocity stays where it is."""
    for factors in ([30.0, 20.0, -900.0], [np.nan, 0.0, 1.0]):
        state = np.array([[0.4, 0.3, 0.2], STILL])
        spin(np.array(factors), 1.0, state)
        assert np.isfinite(state).all()


@given(seed=seeds, h=st.sampled_from([1e-3, 1e-2]))
def test_a_link_that_is_a_free_body_obeys_the_same_equation_with_forces(seed, h):
    """I (w+ - w) = h n - h x x I x about the centre of mass, with the torque of the control and gravity."""
    rng = np.random.default_rng(seed)
    inertia = pin.Inertia(rng.uniform(0.1, 5.0), 0.3 * rng.normal(size=3), random_inertias(rng, 1)[0])
    model = pin.Model()
    place = pin.SE3(Rotation.random(rng=rng).as_matrix(), rng.normal(size=3))
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), place, "body")
    model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
    model.gravity.linear = rng.normal(size=3)
    torque, q, v = rng.normal(size=6), np.concatenate([rng.normal(size=3), Rotation.random(rng=rng).as_quat()]), None
    v = rng.normal(size=6) * [1, 1, 1, 20, 20, 20]
    system = ArticulatedSystem(model, control=lambda t, q, v: torque)
    free = system.free_motion(0.0, q, v, h).free
    late = system.centered_motion(0.0, q, v, h, system.force_velocity(0.0, q, v, 0.5 * h)).free
    down = model.jointPlacements[joint].rotation @ Rotation.from_quat(q[3:]).as_matrix()
    force = torque[:3] + inertia.mass * down.T @ model.gravity.linear
    moment = torque[3:] - np.cross(inertia.lever, torque[:3])
    J, w, new = inertia.inertia, v[3:], free[3:]
    # a body that turns farther in a step takes it in parts, each of which obeys the equation
    assume(h * np.linalg.norm(w + 0.5 * h * np.linalg.solve(J, moment)) < 0.99 * PART)
    mean = 0.5 * (w + new)
    size = np.abs(J).max() * np.abs(w).max() + h * np.abs(moment).max()
    np.testing.assert_allclose(J @ (new - w), h * (moment - np.cross(mean, J @ mean)), rtol=0, atol=1e-12 * size)
    # the velocity of the centre turns back with the body; half of the force acts before that and half after it
    centre, moved = (x[:3] + np.cross(x[3:], inertia.lever) for x in (v, free))
    half = 0.5 * h * force / inertia.mass
    turned = Rotation.from_rotvec(-h * mean).apply(centre + half) + half
    np.testing.assert_allclose(moved, turned, rtol=0, atol=1e-12 * (1.0 + np.abs(centre).max()))
    # `Centered` has the gyroscopic torques while bodies move
    np.testing.assert_allclose(J @ (late[3:] - w), h * moment, rtol=0, atol=1e-12 * size)
    late_centre = late[:3] + np.cross(late[3:], inertia.lever)
    np.testing.assert_allclose(late_centre - centre, 2.0 * half, rtol=0, atol=1e-12 * (1.0 + np.abs(centre).max()))


def test_links_of_robots_and_joints_with_losses_are_no_free_bodies(rng):
    model = model_of_free_links(rng)
    found = free_links(model)
    assert found.first.tolist() == [model.idx_vs[model.getJointId(f"body {k}")] for k in (1, 2)]
    assert found.turning.tolist() == [False, True]
    model.damping[found.first[0]], model.armature[found.first[1] + 5] = 0.1, 0.1
    assert not len(free_links(model).first)


@given(seed=seeds, h=st.sampled_from([1e-3, 1e-2, 0.3]))
def test_a_step_back_undoes_a_step(seed, h):
    rng, system = body(seed)
    w = 10.0 * rng.normal(size=3)
    if h * np.linalg.norm(w) > 0.2:
        w *= 0.2 / (h * np.linalg.norm(w))
    np.testing.assert_allclose(spun(system, spun(system, w, h), -h), w, rtol=0, atol=1e-13 * np.linalg.norm(w))

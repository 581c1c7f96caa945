"""Free bodies on which nothing acts: energy, both momenta and the path of the centre are exact at any step."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from mbvi.system import ArticulatedSystem, FreeBodies
from mbvi_studies.chart.errors import fitted_order
from support.spin_arguments import random_inertias

STILL = np.zeros(3)
seeds = st.integers(0, 2**32 - 1)


def body(rng):
    """A body, its inertia, and an angular velocity of length 1."""
    w = rng.normal(size=3)
    system = FreeBodies(rng.uniform(0.5, 3.0, 1), random_inertias(rng, 1), STILL, ("a",))
    return system, system.inertias[0], w / np.linalg.norm(w)


def start(rng):
    return np.concatenate([rng.normal(size=3), Rotation.random(rng=rng).as_quat()])


def moved(system, q, v, h):
    """State after a time h, the rotation as a matrix."""
    displacement, after = system.coast(v, h)
    q = system.integrate(q, displacement)
    return q, after, Rotation.from_quat(q[3:].copy()).as_matrix()


@given(seed=seeds, angle=st.floats(1e-6, 30.0), h=st.sampled_from([-1e-2, 1e-4, 1e-3, 1e-2, 0.1]))
def test_it_keeps_energy_and_angular_momentum_in_the_world(seed, angle, h):
    rng = np.random.default_rng(seed)
    system, inertia, w = body(rng)
    q, v = start(rng), np.concatenate([rng.normal(size=3), angle / abs(h) * w])
    energy, spin = v[3:] @ inertia @ v[3:], Rotation.from_quat(q[3:].copy()).apply(inertia @ v[3:])
    for _ in range(10):
        before = q[:3] + h * v[:3]
        q, v, R = moved(system, q, v, h)
        np.testing.assert_allclose(q[:3], before, rtol=0, atol=1e-14 * (1.0 + np.abs(before).max()))
        assert v[3:] @ inertia @ v[3:] == pytest.approx(energy, rel=1e-12)
        np.testing.assert_allclose(R @ inertia @ v[3:], spin, rtol=0, atol=3e-12 * np.linalg.norm(spin))


@given(seed=seeds, angle=st.floats(1e-3, 3.0), axis=st.integers(0, 2))
def test_it_is_exact_about_a_principal_axis(seed, angle, axis):
    rng = np.random.default_rng(seed)
    system, inertia, _ = body(rng)
    w, q = angle * np.linalg.eigh(inertia)[1][:, axis], start(rng)
    displacement, after = system.coast(np.concatenate([STILL, w]), 1.0)
    np.testing.assert_allclose(after[3:], w, rtol=0, atol=1e-12)
    expected = Rotation.from_quat(q[3:].copy()) * Rotation.from_rotvec(w)
    turned = Rotation.from_quat(system.integrate(q, displacement)[3:].copy())
    assert (expected.inv() * turned).magnitude() < 1e-11


@pytest.mark.parametrize("seed", range(4))
def test_it_has_order_two(seed):
    rng = np.random.default_rng(seed)
    system, inertia, w = body(rng)

    def rate(t, y):
        R, x = y[:9].reshape(3, 3), y[9:]
        skew = np.array([[0, -x[2], x[1]], [x[2], 0, -x[0]], [-x[1], x[0], 0]])
        return np.concatenate([(R @ skew).ravel(), np.linalg.solve(inertia, np.cross(inertia @ x, x))])

    w *= 12.0
    y = solve_ivp(rate, (0, 0.5), np.concatenate([np.eye(3).ravel(), w]), "DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
    counts, errors = np.array([100, 200, 400]), []
    for count in counts.tolist():
        q, v = np.array([0, 0, 0, 0, 0, 0, 1.0]), np.concatenate([STILL, w])
        for _ in range(count):
            q, v, R = moved(system, q, v, 0.5 / count)
        errors.append([np.linalg.norm(R - y[:9].reshape(3, 3)), np.linalg.norm(v[3:] - y[9:])])
    for error in np.transpose(errors):
        assert 1.8 < fitted_order(0.5 / counts, error) < 2.2


@given(seed=seeds, h=st.sampled_from([1e-3, 1e-2, 0.1]))
def test_a_step_back_undoes_a_step(seed, h):
    rng = np.random.default_rng(seed)
    system, _, w = body(rng)
    q, v = start(rng), np.concatenate([rng.normal(size=3), rng.uniform(0.1, 0.7) / h * w])
    there, after, _ = moved(system, q, v, h)
    back, before, _ = moved(system, there, after, -h)
    np.testing.assert_allclose(before, v, rtol=0, atol=1e-12 * np.abs(v).max())
    np.testing.assert_allclose(system.difference(q, back), 0.0, atol=1e-12)


@given(seed=seeds, h=st.sampled_from([1e-3, 1e-2, 0.1]))
def test_the_centre_of_a_link_moves_along_a_line(seed, h):
    """Of a robot of one link, whose velocities are in axes that turn and whose centre of mass lies aside."""
    rng = np.random.default_rng(seed)
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "body")
    inertia = pin.Inertia(rng.uniform(0.1, 5.0), 0.3 * rng.normal(size=3), random_inertias(rng, 1)[0])
    model.appendBodyToJoint(joint, inertia, pin.SE3.Identity())
    system, data = ArticulatedSystem(model), model.createData()
    q, v = start(rng), rng.normal(size=6) * [1, 1, 1, 20, 20, 20]
    pin.computeCentroidalMomentum(model, data, q, v)
    centre, linear, spin = data.com[0].copy(), data.hg.linear.copy(), data.hg.angular.copy()
    energy = system.kinetic_energy(q, v)
    displacement, after = system.coast(v, h)
    there = system.integrate(q, displacement)
    pin.computeCentroidalMomentum(model, data, there, after)
    size = np.abs(centre).max() + h * np.abs(v).max()
    np.testing.assert_allclose(data.com[0], centre + h * linear / inertia.mass, rtol=0, atol=1e-13 * (1.0 + size))
    np.testing.assert_allclose(data.hg.linear, linear, rtol=0, atol=1e-12 * np.abs(v).max() * inertia.mass)
    np.testing.assert_allclose(data.hg.angular, spin, rtol=0, atol=1e-12 * np.linalg.norm(spin))
    assert system.kinetic_energy(there, after) == pytest.approx(energy, rel=1e-12)


def test_a_ball_keeps_its_angular_velocity_to_the_bit(rng):
    system = FreeBodies(np.ones(1), 0.4 * np.eye(3)[None], STILL, ("a",))
    v = 100.0 * rng.normal(size=6)
    displacement, after = system.coast(v, 1e-2)
    assert after.tobytes() == v.tobytes() and displacement.tobytes() == (1e-2 * v).tobytes()


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_what_is_not_finite_stays_so(bad, rng):
    system, _, _ = body(rng)
    assert not np.isfinite(system.coast(np.array([0, 0, 0, bad, 1.0, 2.0]), 1e-2)).all()

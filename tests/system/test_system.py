"""Mass matrices, forces and retractions: against Pinocchio, closed forms, and each other."""

import copy
import pickle

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mbvi
from mbvi.projection import DenseMetric, Projector
from mbvi.system import ArticulatedSystem, BlockSystem, FreeBodies, Spheres, located_parts
from support.paths import ROBOTS

GRAVITY = np.array([0.0, 0.0, -9.81])


def quadruped(**more):
    model = pin.buildModelFromUrdf(str(ROBOTS / "quadruped/quadruped.urdf"), pin.JointModelFreeFlyer())
    return ArticulatedSystem(model, "quadruped", **more)


def two_bodies():
    inertias = np.array([np.diag([0.02, 0.012, 0.028]), [[0.3, 0.05, 0], [0.05, 0.2, 0.02], [0, 0.02, 0.25]]])
    return FreeBodies(np.array([2.0, 3.0]), inertias, GRAVITY, ("a", "b"))


def spheres():
    return Spheres(np.array([1.0, 2.0]), GRAVITY, ("c", "d"))


def mixed():
    return BlockSystem([quadruped(), two_bodies(), spheres()])


def state(system, rng):
    q = np.zeros(system.nq)
    for block in getattr(system, "blocks", [None]):
        part = system if block is None else block.system
        where = slice(None) if block is None else block.q
        if isinstance(part, ArticulatedSystem):
            q[where] = pin.neutral(part.model)
        elif isinstance(part, FreeBodies):
            q[where] = np.tile([0, 0, 0, 0, 0, 0, 1.0], part.nq // 7)
    return system.integrate(q, rng.normal(size=system.nv)), rng.normal(size=system.nv)


SYSTEMS = [quadruped, two_bodies, spheres, mixed]


@pytest.mark.parametrize("make", SYSTEMS)
def test_difference_undoes_integrate(make, rng):
    system = make()
    q, dv = state(system, rng)
    np.testing.assert_allclose(system.difference(q, system.integrate(q, dv)), dv, atol=1e-10)


@pytest.mark.parametrize("make", SYSTEMS)
def test_metric_is_the_kinetic_energy(make, rng):
    system = make()
    q, v = state(system, rng)
    metric = system.metric(q)
    assert 0.5 * v @ metric.apply(v) == pytest.approx(system.kinetic_energy(q, v), rel=1e-12)
    np.testing.assert_allclose(metric.dense() @ v, metric.apply(v), rtol=1e-12)
    np.testing.assert_allclose(metric.unwhiten(metric.whiten(metric.apply(v))), v, rtol=1e-9, atol=1e-10)
    columns = rng.normal(size=(system.nv, 3))
    white = metric.whiten(columns)
    np.testing.assert_allclose(
        white.T @ white, columns.T @ np.linalg.solve(metric.dense(), columns), rtol=1e-8, atol=1e-9
    )


@pytest.mark.parametrize("make", SYSTEMS)
def test_free_velocity_is_that_of_the_forces(make, rng):
    system, h = make(), 1e-3
    q, v = state(system, rng)
    # gyroscopic torques of free bodies are those of the mean velocity
    mean, at = 0.5 * (v + system.free_velocity(0.0, q, v, h)), v.copy()
    for part in located_parts(system):
        if part.system.free_bodies:
            at[part.v : part.v + part.system.nv] = mean[part.v : part.v + part.system.nv]
    expected = v + h * np.linalg.solve(system.metric(q).dense(), system.force(0.0, q, at))
    np.testing.assert_allclose(system.free_velocity(0.0, q, v, h), expected, rtol=1e-10, atol=1e-11)
    push = system.free_motion(0.0, q, v, h)
    np.testing.assert_allclose(push.free, expected, rtol=1e-10, atol=1e-11)
    np.testing.assert_allclose(push.metric.dense(), system.metric(q).dense(), rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("make", SYSTEMS)
def test_power_of_the_forces_is_the_rate_of_energy(make, rng):
    """Along the free flow the total energy stands still to second order in the step."""
    system = make()
    q, v = state(system, rng)
    change = []
    for h in (1e-4, 5e-5):
        ahead = [system.integrate(q, s * h * v) for s in (1, -1)]
        speed = [system.free_velocity(0.0, q, v, s * h) for s in (1, -1)]
        energy = [
            system.kinetic_energy(x, w) + system.potential_energy(0.0, x) for x, w in zip(ahead, speed, strict=True)
        ]
        change.append(abs(energy[0] - energy[1]) / (2 * h))
    scale = system.kinetic_energy(q, v) + 1.0
    assert change[0] < 1e-4 * scale


def test_a_free_body_moves_as_pinocchio_says(rng):
    """One body, in the body's own axes, is Pinocchio's free flyer."""
    inertia = np.array([[0.3, 0.05, 0], [0.05, 0.2, 0.02], [0, 0.02, 0.25]])
    system = FreeBodies(np.array([2.0]), inertia[None], GRAVITY, ("a",))
    model = pin.Model()
    model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root")
    model.appendBodyToJoint(1, pin.Inertia(2.0, np.zeros(3), inertia), pin.SE3.Identity())
    q, v = state(system, rng)
    R = pin.Quaternion(q[3:7]).matrix()
    local = np.concatenate([R.T @ v[:3], v[3:]])
    data = model.createData()
    a = pin.aba(model, data, q, local, np.zeros(6))
    world = R @ (a[:3] + np.cross(local[3:], local[:3]))
    rate = np.linalg.solve(system.metric(q).dense(), system.force(0.0, q, v))
    np.testing.assert_allclose(rate[:3], world, atol=1e-12)
    np.testing.assert_allclose(rate[3:], a[3:], atol=1e-12)
    turned = pin.integrate(model, q, np.concatenate([np.zeros(3), v[3:]]))
    np.testing.assert_allclose(np.abs(turned[3:] @ system.integrate(q, v)[3:]), 1.0, atol=1e-12)


@pytest.mark.parametrize("make", SYSTEMS)
def test_no_point_outruns_its_reach(make, rng):
    """The bound that lets far pairs go unasked holds for every point of a shape."""
    system = make()
    for _ in range(40):
        q, _ = state(system, rng)
        dv = rng.normal(size=system.nv) * 10.0 ** rng.uniform(-3, 0.5)
        body = int(rng.integers(1, len(system.bodies)))
        centre, radius = 0.2 * rng.normal(size=3), 0.1
        reach = system.reach(body, centre, radius) @ np.abs(dv)
        direction = rng.normal(size=3)
        point = centre + radius * direction / np.linalg.norm(direction)
        where = (system.placements(x, np.array([body]))[0] for x in (q, system.integrate(q, dv)))
        places = [np.append(point, 1.0) @ place for place in where]
        assert np.linalg.norm(places[1] - places[0]) <= reach * (1 + 1e-12)


def test_reach_knows_how_far_a_slider_carries_what_hangs_on_it(rng):
    scene = mbvi.Scene()
    scene.add_urdf(ROBOTS / "arm/arm.urdf", base="fixed")
    system = scene.build().system
    body = list(system.bodies).index("arm/left_finger_joint")
    reach = system.reach(body, np.zeros(3), 0.01)
    assert reach[system.model.idx_vs[body]] == 1.0
    assert (reach[: system.model.idx_vs[body]] > 0.01).all()


def test_control_and_damping_enter_the_force(rng):
    model = quadruped().model
    model.damping = np.full(18, 0.5)
    asked = []

    def control(t, q, v):
        asked.append((t, q.copy(), v.copy()))
        return np.arange(18.0)

    system = ArticulatedSystem(model, "q", control)
    q, v = state(system, rng)
    plain = quadruped().force(0.7, q, v)
    np.testing.assert_allclose(system.force(0.7, q, v), plain + np.arange(18.0) - 0.5 * v, atol=1e-10)
    assert asked[0][0] == 0.7
    with pytest.raises(mbvi.InputError, match=r"control returned shape \(3,\)"):
        ArticulatedSystem(model, "q", lambda t, q, v: np.zeros(3)).force(0.0, q, v)


def test_strong_damping_of_a_light_link_is_stable():
    model = pin.Model()
    model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "joint")
    model.appendBodyToJoint(1, pin.Inertia(0.01, np.zeros(3), 1e-6 * np.eye(3)), pin.SE3.Identity())
    model.damping = np.array([10.0])
    v = ArticulatedSystem(model, "r").free_velocity(0.0, np.zeros(1), np.ones(1), 1e-3)
    assert 0.0 <= v[0] < 1.0


def test_potential_of_given_forces():
    system = mbvi.LagrangianSystem(lambda q: np.eye(2), lambda t, q, v: np.array([-3 * q[0] - v[0], -9.81]), 2)
    q = np.array([0.4, 0.7])
    assert system.potential_energy(0.0, q) == pytest.approx(1.5 * 0.4**2 + 9.81 * 0.7)
    given = mbvi.LagrangianSystem(lambda q: np.eye(2), lambda t, q, v: np.zeros(2), 2, potential=lambda q: 42.0)
    assert given.potential_energy(0.0, q) == 42.0


@given(st.integers(0, 2**32 - 1))
def test_block_projection_equals_dense(seed):
    """Side by side or in one matrix: the projection is the same."""
    rng = np.random.default_rng(seed)
    system = BlockSystem([two_bodies(), spheres()])
    q, x = state(system, rng)
    J = rng.normal(size=(4, system.nv))
    metric = system.metric(q)
    block = Projector().project(x, metric, J, np.zeros(4))
    dense = Projector().project(x, DenseMetric(metric.dense()), J, np.zeros(4))
    np.testing.assert_allclose(block.velocity, dense.velocity, atol=1e-10)
    np.testing.assert_allclose(block.percussion, dense.percussion, atol=1e-9)


def test_a_copy_of_a_mechanism_stands_on_its_own(rng):
    system = quadruped()
    q, v = state(system, rng)
    expected = system.placements(q, np.arange(5)).copy()
    for twin in (copy.copy(system), copy.deepcopy(system), pickle.loads(pickle.dumps(system))):
        np.testing.assert_array_equal(twin.placements(q, np.arange(5)), expected)
        np.testing.assert_array_equal(twin.free_motion(0.0, q, v, 1e-3).free, system.free_motion(0.0, q, v, 1e-3).free)
        # asked about another q, the twin leaves the first as it was
        twin.placements(state(system, rng)[0], np.arange(5))
        np.testing.assert_array_equal(system.placements(q, np.arange(5)), expected)


@pytest.mark.parametrize("make", SYSTEMS)
def test_a_point_of_a_body_accelerates_by_its_bias_where_v_does_not_change(make, rng):
    """The second derivative of where the point is, along the motion that v would go on with."""
    system = make()
    q, v = state(system, rng)
    bodies = rng.integers(1, len(system.bodies), 5)
    local = rng.normal(size=(5, 3))

    def speed(q):
        # n . velocity of a point, for n along each axis
        places = system.placements(q, bodies)
        at = np.vecmat(local, places[:, :3]) + places[:, 3]
        nothing = np.zeros(5, np.int64)
        return np.array([system.separation_rows(q, nothing, bodies, at, np.tile(n, (5, 1))) @ v for n in np.eye(3)]).T

    h = 1e-3
    ahead, behind = ([speed(system.integrate(q, k * s * h * v)) for k in (1, 2)] for s in (1, -1))
    expected = (8 * (ahead[0] - behind[0]) - (ahead[1] - behind[1])) / (12 * h)
    found = system.point_bias(q, v, bodies, local)
    np.testing.assert_allclose(found, expected, atol=1e-7 * max(1.0, np.abs(expected).max()))


def test_a_free_motion_stays_that_of_its_state(rng):
    """Evaluating the system elsewhere changes neither the velocity nor the mass matrix of an earlier free motion."""
    system = quadruped()
    q, v = pin.neutral(system.model), rng.normal(size=system.nv)
    motion, same = (system.free_motion(0.0, q, v, 1e-3) for _ in range(2))
    free, metric = same.free.copy(), same.metric.dense()
    elsewhere = system.integrate(q, 0.3 * rng.normal(size=system.nv))
    system.free_motion(0.0, elsewhere, -v, 1e-3).metric.dense()
    np.testing.assert_array_equal(motion.free, free)
    np.testing.assert_array_equal(motion.metric.dense(), metric)

"""Pinocchio's results seen in place: the same as its getters give, as long as anyone looks."""

import gc

import numpy as np
import pinocchio as pin
import pytest

from mbvi.system import ArticulatedSystem
from mbvi.system.mechanisms import evaluation
from mbvi.system.mechanisms.by_address import memory
from mbvi.system.mechanisms.by_address.memory import read_results, results_in_place
from mbvi.system.mechanisms.joint_tree import joint_tree
from support.paths import ROBOTS, real_robot


def chain(n):
    """Bodies in a row on revolute and prismatic joints."""
    model = pin.Model()
    for k in range(n):
        joint = pin.JointModelRY() if k % 2 == 0 else pin.JointModelPX()
        child = model.addJoint(k, joint, pin.SE3(np.eye(3), np.array([0.1, 0.2, 0.3])), f"joint{k}")
        model.appendBodyToJoint(
            child, pin.Inertia(1.0 + k, 0.1 * np.ones(3), np.diag([1.0, 2.0, 2.5])), pin.SE3.Identity()
        )
    return model


def of_urdf(path, free):
    return pin.buildModelFromUrdf(str(path), *([pin.JointModelFreeFlyer()] if free else []))


MODELS = {
    "one": lambda: chain(1),
    "two": lambda: chain(2),
    "quadruped": lambda: of_urdf(ROBOTS / "quadruped/quadruped.urdf", True),
    "panda": lambda: of_urdf(real_robot("panda_description/urdf/panda.urdf"), False),
    "talos": lambda: of_urdf(real_robot("talos_data/robots/talos_reduced.urdf"), True),
}


@pytest.fixture
def no_joint_is_known(monkeypatch):
    """Kernels compute nothing: they know no joint of the models."""
    monkeypatch.setattr(evaluation, "joint_tree", lambda model, carrier: joint_tree(pin.Model(), carrier))


every_model = pytest.mark.parametrize("make", MODELS.values(), ids=MODELS)


def moved(model, rng):
    return pin.integrate(model, pin.neutral(model), rng.normal(size=model.nv))


def crba(model, data, q):
    pin.crba(model, data, q, pin.Convention.WORLD)


def got(data, nv):
    """Poses, columns and the lower triangle of M, one body and one entry at a time."""
    poses = [[*np.array(pose.rotation).T, np.array(pose.translation)] for pose in data.oMi]
    J, M = np.array(data.J).reshape(6, nv), np.array(data.M).reshape(nv, nv)
    # crba writes the upper triangle of a symmetric matrix
    return np.array(poses), J.T.copy(), np.triu(M).T


def seen(arrays):
    poses, columns, mass, *_ = arrays
    return np.array(poses), np.array(columns), np.tril(mass)


def bits(arrays):
    return [np.ascontiguousarray(array).tobytes() for array in arrays]


@every_model
def test_arrays_follow_the_getters_bit_for_bit(make, rng):
    model = make()
    data = model.createData()
    arrays = results_in_place(model, data)
    last = None
    for _ in range(5):
        q = moved(model, rng)
        crba(model, data, q)
        effects = pin.nonLinearEffects(model, data, q, rng.normal(size=model.nv))
        assert bits([*seen(arrays), arrays[3]]) == bits([*got(data, model.nv), effects])
        assert bits(seen(read_results(model, data))) == bits(seen(arrays)) != last
        last = bits(seen(arrays))


@every_model
def test_the_mass_matrix_and_the_jacobian_columns_mean_what_is_said(make, rng):
    """Against the kinetic energy and the bodies' velocities of an independent computation."""
    model = make()
    data, other = model.createData(), model.createData()
    poses, columns, mass, _ = results_in_place(model, data)
    q, v = moved(model, rng), rng.normal(size=model.nv)
    crba(model, data, q)
    M = np.tril(mass) + np.tril(mass, -1).T
    assert 0.5 * v @ M @ v == pytest.approx(pin.computeKineticEnergy(model, other, q, v), rel=1e-12)
    pin.forwardKinematics(model, other, q, v)
    for joint in range(1, model.njoints):
        np.testing.assert_allclose(poses[joint, :3].T, other.oMi[joint].rotation, atol=1e-13)
        np.testing.assert_allclose(poses[joint, 3], other.oMi[joint].translation, atol=1e-13)
        carrying = [
            k for a in list(model.supports[joint])[1:] for k in range(model.idx_vs[a], model.idx_vs[a] + model.nvs[a])
        ]
        twist = v[carrying] @ columns[carrying]
        np.testing.assert_allclose(twist, other.oMi[joint].act(other.v[joint]).vector, atol=1e-11)


@every_model
def test_a_layout_that_is_not_the_expected_one_is_found(make, monkeypatch):
    model = make()
    monkeypatch.setattr(memory, "_POSE", 16)
    assert results_in_place(model, model.createData()) is None


@every_model
def test_a_place_that_holds_something_else_is_not_looked_at(make, rng, monkeypatch):
    """An address alone does not convince: what lies there is compared with what the getters say."""
    model = make()
    data, another = model.createData(), model.createData()
    q = moved(model, rng)
    crba(model, data, q)
    crba(model, another, pin.integrate(model, q, rng.normal(size=model.nv)))
    own, strangers = (memory._addresses(model, one) for one in (data, another))
    for k in range(3):
        # one joint's column or mass may be the same everywhere
        if bits(got(data, model.nv))[k] == bits(got(another, model.nv))[k]:
            continue
        wrong = (*own[:k], strangers[k], *own[k + 1 :])
        monkeypatch.setattr(memory, "_addresses", lambda *_, wrong=wrong: wrong)
        assert results_in_place(model, data) is None
    monkeypatch.undo()
    assert results_in_place(model, data) is not None


@every_model
def test_arrays_outlive_whoever_made_them(make, rng):
    """An array keeps the memory that it shows, whatever else is forgotten and allocated over it."""
    model = make()
    data = model.createData()
    crba(model, data, moved(model, rng))
    kept, size = list(results_in_place(model, data)[:3]), model.nv
    expected = bits(got(data, size))
    lower = [kept[0], kept[1], np.tril(kept[2])]
    assert bits(lower) == expected
    del model, data, lower
    gc.collect()
    others = []
    for _ in range(200):
        # what is freed is taken again by things of its own size
        stranger = make()
        others.append(stranger.createData())
        crba(stranger, others[-1], moved(stranger, rng))
        others.extend(np.full(array.shape, np.nan) for array in kept)
        if len(others) > 100:
            del others[::2]
    assert bits([kept[0], kept[1], np.tril(kept[2])]) == expected


def test_a_slice_alone_keeps_the_memory(rng):
    model = MODELS["quadruped"]()
    data = model.createData()
    crba(model, data, moved(model, rng))
    part = results_in_place(model, data)[0][3:5, 1]
    expected = part.copy()
    del data
    gc.collect()
    waste = [model.createData() for _ in range(50)]
    for one in waste:
        crba(model, one, moved(model, rng))
    np.testing.assert_array_equal(part, expected)


@every_model
def test_forces_and_energies_leave_poses_columns_and_mass_as_they_are(make, rng, no_joint_is_known):
    """Whatever else is asked, what was computed for a configuration is what is seen there."""
    model = make()
    system = ArticulatedSystem(model)
    q, v = moved(model, rng), rng.normal(size=model.nv)
    data = model.createData()

    def ask(asked):
        # as a step does, a configuration that cannot change is known by the array
        asked.setflags(write=False)
        crba(model, data, asked)
        expected = bits(got(data, model.nv))
        bodies = np.arange(model.njoints)
        for disturb in (
            lambda: system.free_motion(0.0, asked, v, 1e-3).free,
            lambda: system.force(0.0, asked, v),
            lambda: system.free_velocity(0.0, asked, v, 1e-3),
            lambda: system.kinetic_energy(asked, v) + system.potential_energy(0.0, asked),
            lambda: system.difference(asked, system.integrate(asked, v)),
            lambda: system.force(0.0, system.integrate(asked, v), 2.0 * v),
        ):
            disturb()
            poses, columns, _ = system.kinematics(asked)
            assert bits([poses, columns]) == expected[:2]
            assert bits([system.placements(asked, bodies)]) == expected[:1]
            assert bits([np.tril(system.free_motion(0.0, asked, v, 1e-3).kernel_arguments[0])]) == expected[2:]

    ask(q)
    ask(system.integrate(q, v))
    ask(q)


def test_a_control_that_asks_for_the_mass_matrix_elsewhere_leaves_that_of_the_free_motion(no_joint_is_known):
    model = chain(4)
    system = ArticulatedSystem(model)
    q, v, expected = np.array([0.3, 0.1, -0.7, 0.2]), np.ones(4), ArticulatedSystem(model)

    def control(t, q, v):
        system.metric(q + 1.0)
        return np.zeros(4)

    system.set_control(control)
    np.testing.assert_array_equal(
        system.free_motion(0.0, q, v, 1e-3).metric.dense(), expected.free_motion(0.0, q, v, 1e-3).metric.dense()
    )

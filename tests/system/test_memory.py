"""Pinocchio's results seen in place: the same as its getters give, as long as anyone looks, wherever they lie."""

import gc

import numpy as np
import pinocchio as pin
import pytest

import mbvi
from mbvi.system import ArticulatedSystem, memory
from mbvi.system.memory import Memory
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
    return np.array(arrays.poses), np.array(arrays.columns), np.tril(arrays.mass)


def bits(arrays):
    return [np.ascontiguousarray(array).tobytes() for array in arrays]


@pytest.fixture
def elsewhere(monkeypatch):
    """Call it, and poses are expected to lie further apart than they do."""
    return lambda: monkeypatch.setattr(memory, "_POSE", 16)


@every_model
def test_arrays_follow_the_getters_bit_for_bit(make, rng):
    model = make()
    data = model.createData()
    arrays = Memory(model, data)
    assert arrays.in_place
    poses = arrays.poses
    last = None
    for _ in range(5):
        crba(model, data, moved(model, rng))
        assert bits(seen(arrays)) == bits(got(data, model.nv))
        assert bits(seen(arrays)) != last
        last = bits(seen(arrays))
        arrays.refresh()
        arrays.check()
        assert bits(seen(arrays)) == last
    assert poses.tobytes() == arrays.poses.tobytes()


@every_model
def test_the_mass_matrix_and_the_jacobian_columns_mean_what_is_said(make, rng):
    """Against the kinetic energy and the bodies' velocities of an independent computation."""
    model = make()
    data, other = model.createData(), model.createData()
    arrays = Memory(model, data)
    q, v = moved(model, rng), rng.normal(size=model.nv)
    crba(model, data, q)
    M = np.tril(arrays.mass) + np.tril(arrays.mass, -1).T
    assert 0.5 * v @ M @ v == pytest.approx(pin.computeKineticEnergy(model, other, q, v), rel=1e-12)
    pin.forwardKinematics(model, other, q, v)
    for joint in range(1, model.njoints):
        np.testing.assert_allclose(arrays.poses[joint, :3].T, other.oMi[joint].rotation, atol=1e-13)
        np.testing.assert_allclose(arrays.poses[joint, 3], other.oMi[joint].translation, atol=1e-13)
        carrying = [
            k for a in list(model.supports[joint])[1:] for k in range(model.idx_vs[a], model.idx_vs[a] + model.nvs[a])
        ]
        twist = v[carrying] @ arrays.columns[carrying]
        np.testing.assert_allclose(twist, other.oMi[joint].act(other.v[joint]).vector, atol=1e-11)


@every_model
def test_a_layout_that_is_not_the_expected_one_is_copied(make, rng, elsewhere):
    model = make()
    data = model.createData()
    elsewhere()
    arrays = Memory(model, data)
    assert not arrays.in_place
    for _ in range(3):
        before = bits(seen(arrays))
        crba(model, data, moved(model, rng))
        assert bits(seen(arrays)) == before
        arrays.refresh()
        assert bits(seen(arrays)) == bits(got(data, model.nv)) != before


@every_model
def test_a_place_that_holds_something_else_is_not_looked_at(make, rng, monkeypatch):
    """An address alone does not convince: what lies there is compared with what the getters say."""
    model = make()
    data, another = model.createData(), model.createData()
    q = moved(model, rng)
    crba(model, data, q)
    crba(model, another, pin.integrate(model, q, rng.normal(size=model.nv)))
    strangers = Memory(model, another)._addresses()
    arrays = Memory(model, data)
    assert arrays.in_place
    own = arrays._addresses()
    for k in range(3):
        # one joint's column or mass may be the same everywhere
        if bits(got(data, model.nv))[k] == bits(got(another, model.nv))[k]:
            continue
        wrong = (*own[:k], strangers[k], *own[k + 1 :])
        monkeypatch.setattr(arrays, "_addresses", lambda wrong=wrong: wrong)
        arrays.check()
        assert not arrays.in_place
        assert bits(seen(arrays)) == bits(got(data, model.nv))
    monkeypatch.undo()
    arrays.check()
    assert arrays.in_place


@every_model
def test_arrays_outlive_whoever_made_them(make, rng):
    """An array keeps the memory that it shows, whatever else is forgotten and allocated over it."""
    model = make()
    data = model.createData()
    crba(model, data, moved(model, rng))
    arrays = Memory(model, data)
    assert arrays.in_place
    kept, size = [arrays.poses, arrays.columns, arrays.mass], model.nv
    expected = bits(got(data, size))
    lower = [kept[0], kept[1], np.tril(kept[2])]
    assert bits(lower) == expected
    del model, data, arrays, lower
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
    part = Memory(model, data).poses[3:5, 1]
    expected = part.copy()
    del data
    gc.collect()
    waste = [model.createData() for _ in range(50)]
    for one in waste:
        crba(model, one, moved(model, rng))
    np.testing.assert_array_equal(part, expected)


def landing():
    """A quadruped that falls to the floor while its legs swing."""
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1))
    swing = {f"{leg}_{joint}_joint": rate for leg in ("FL", "RR") for joint, rate in (("thigh", 6.0), ("calf", -4.0))}
    scene.add_urdf(ROBOTS / "quadruped/quadruped.urdf", position=(0, 0, 0.45), velocity=swing)
    return scene.build()


def states(problem):
    return mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=0.3, progress=False)


def test_a_run_is_the_same_in_place_and_with_copies(elsewhere):
    problem = landing()
    in_place = states(problem)
    assert problem.system._memory.in_place
    assert len(in_place.impacts) > 3
    elsewhere()
    problem = landing()
    copied = states(problem)
    assert not problem.system._memory.in_place
    for name in ("q", "v", "residual"):
        np.testing.assert_array_equal(getattr(copied, name), getattr(in_place, name))
    np.testing.assert_array_equal(copied.penetration(), in_place.penetration())
    assert [i.constraints for i in copied.impacts] == [i.constraints for i in in_place.impacts]
    np.testing.assert_array_equal(copied.energy(), in_place.energy())


def test_a_run_looks_again_when_it_starts(elsewhere, monkeypatch):
    problem = landing()
    system = problem.system
    assert system._memory.in_place
    expected = next(mbvi.steps(problem, mbvi.Paoli(), step=1e-3))
    elsewhere()
    assert system._memory.in_place
    step = next(mbvi.steps(problem, mbvi.Paoli(), step=1e-3))
    assert not system._memory.in_place
    np.testing.assert_array_equal(step.v, expected.v)
    # what kernels are given is what the system now keeps
    assert system.kinematics(problem.q0).poses is system._memory.poses
    monkeypatch.undo()
    next(mbvi.steps(problem, mbvi.Paoli(), step=1e-3))
    assert system._memory.in_place
    assert system.kinematics(problem.q0).poses is system._memory.poses


@pytest.mark.parametrize("copies", [False, True])
@every_model
def test_forces_and_energies_leave_poses_columns_and_mass_as_they_are(make, copies, rng, elsewhere):
    """Whatever else is asked, what was computed for a configuration is what is seen there."""
    if copies:
        elsewhere()
    model = make()
    system = ArticulatedSystem(model)
    assert system._memory.in_place != copies
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

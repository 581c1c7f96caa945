"""Poses, Jacobian columns, mass matrix and nonlinear effects of the kernels, against Pinocchio's bindings."""

from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest

from mbvi.compiled import held
from mbvi.system import ArticulatedSystem
from mbvi.system.mechanisms.coordinates import carriers
from mbvi.system.mechanisms.joint_tree import place_joints, weigh_joints, with_own_results, write_effects
from support.joint_tree_arguments import inertia_of, joints, moved_model, place_of, tree_of
from support.paths import ROBOTS, real_robot

SHARED = real_robot("panda_description/urdf/panda.urdf").parents[2]
FILES = sorted([*ROBOTS.rglob("*.urdf"), *SHARED.rglob("*.urdf")])
# one robot has no name, and Pinocchio refuses it
URDFS = [path for path in FILES if "name" in ElementTree.parse(path).getroot().attrib]
LAST_DIGITS = 1e-13


def computed(tree, q, v):
    kept = held(tree)
    place_joints(kept, q)
    weigh_joints(kept)
    write_effects(kept, v)
    return tree.poses.copy(), tree.columns.copy(), tree.mass.copy(), tree.effects.copy()


def expected(model, q, v):
    data = model.createData()
    pin.crba(model, data, q, pin.Convention.WORLD)
    poses = np.array([[*pose.rotation.T, pose.translation] for pose in data.oMi])
    columns = np.reshape(data.J, (6, model.nv)).T
    mass = np.triu(np.reshape(data.M, (model.nv, model.nv))).T
    return poses, columns.copy(), mass.copy(), np.array(pin.nonLinearEffects(model, data, q, v))


def assert_equal(model, tree, q, v):
    for name, here, there in zip(
        ("poses", "columns", "mass", "effects"), computed(tree, q, v), expected(model, q, v), strict=True
    ):
        most = LAST_DIGITS * max(np.abs(there).max(initial=0.0), 1.0)
        np.testing.assert_allclose(here, there, rtol=0.0, atol=most, err_msg=name)


def state(model, rng):
    return pin.integrate(model, pin.neutral(model), rng.normal(size=model.nv)), rng.normal(size=model.nv)


def models_of(path):
    for free in (False, True):
        yield pin.buildModelFromUrdf(str(path), *([pin.JointModelFreeFlyer()] if free else []))


@pytest.mark.parametrize("path", URDFS, ids=lambda path: path.stem)
def test_every_robot_moves_as_by_pinocchio(path, rng):
    for model in models_of(path):
        tree = tree_of(model)
        assert len(tree.kind) == model.njoints or model.nv == 0
        if model.nv:
            for _ in range(3):
                assert_equal(model, tree, *state(model, rng))


@pytest.mark.parametrize("seed", range(60))
def test_random_trees_of_all_kinds_of_joints_move_as_by_pinocchio(seed):
    model, q, v = moved_model(np.random.default_rng(seed))
    assert_equal(model, tree_of(model), q, v)


@pytest.mark.parametrize("path", URDFS, ids=lambda path: path.stem)
def test_what_carries_each_velocity_is_what_pinocchio_names(path):
    for model in models_of(path):
        np.testing.assert_array_equal(carriers(model), np.array(model.createData().parents_fromRow))


@pytest.mark.parametrize("seed", range(20))
def test_what_carries_each_velocity_of_random_trees_is_what_pinocchio_names(seed):
    model, _, _ = moved_model(np.random.default_rng(seed))
    np.testing.assert_array_equal(carriers(model), np.array(model.createData().parents_fromRow))


def test_every_kind_of_joint_is_known(rng):
    for joint in joints(rng):
        model = pin.Model()
        model.addJoint(0, joint, place_of(rng), "joint")
        assert len(tree_of(model).kind) == 2


@pytest.mark.parametrize("joint", [pin.JointModelUniversal(*np.eye(3)[:2]), pin.JointModelHX(0.1)])
def test_a_joint_of_another_kind_is_left_to_pinocchio(joint, rng):
    model = pin.Model()
    for k, each in enumerate((pin.JointModelRY(), joint)):
        body = model.addJoint(k, each, place_of(rng), f"joint{k}")
        model.appendBodyToJoint(body, inertia_of(rng), place_of(rng))
    assert len(tree_of(model).kind) == 0
    system = ArticulatedSystem(model)
    q, v = state(model, rng)
    _, columns, mass, effects = expected(model, q, v)
    np.testing.assert_array_equal(system.kinematics(q).columns, columns)
    np.testing.assert_allclose(system.metric(q).dense(), mass + np.tril(mass, -1).T, rtol=0.0, atol=1e-12)
    np.testing.assert_array_equal(-system.force(0.0, q, v), effects)


@pytest.mark.parametrize("far", [1e3, 1e6])
def test_mass_and_effects_are_as_exact_far_from_the_origin(far, rng):
    """Neither depends on where a free robot is; sums about the world's origin would lose digits with the distance."""
    model = pin.buildModelFromUrdf(str(ROBOTS / "quadruped/quadruped.urdf"), pin.JointModelFreeFlyer())
    tree, (q, v) = tree_of(model), state(model, rng)
    *_, mass, effects = computed(tree, q, v)
    # exactly representable, so that the place itself has no rounding error
    q[:3] = np.round(q[:3] * 1024) / 1024
    *_, near_mass, near_effects = computed(tree, q, v)
    q[:3] += far
    *_, far_mass, far_effects = computed(tree, q, v)
    np.testing.assert_array_equal(far_mass, near_mass)
    np.testing.assert_array_equal(far_effects, near_effects)
    np.testing.assert_allclose(near_mass, mass, rtol=0.0, atol=LAST_DIGITS * np.abs(mass).max())
    np.testing.assert_allclose(near_effects, effects, rtol=0.0, atol=LAST_DIGITS * np.abs(effects).max())


def test_each_record_has_results_of_its_own(rng):
    model, q, v = moved_model(rng)
    tree = tree_of(model)
    before, other = computed(tree, q, v), with_own_results(tree)
    computed(other, *state(model, rng))
    for name, value in zip(("poses", "columns", "mass", "effects"), before, strict=True):
        np.testing.assert_array_equal(getattr(tree, name), value)
        assert not np.shares_memory(getattr(tree, name), getattr(other, name))

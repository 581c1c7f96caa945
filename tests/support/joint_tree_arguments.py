"""Random trees of joints of every kind, as arguments of the kernels that move them."""

import numpy as np
import pinocchio as pin

from mbvi.system.mechanisms.joint_tree import joint_tree, place_joints, weigh_joints
from mbvi.system.mechanisms.mechanism import free_joint
from support.robot_arguments import rotation, unit


def joints(rng):
    """One joint of each kind that the kernels know, or several that differ by their axis."""
    return [
        pin.JointModelFreeFlyer(), pin.JointModelPlanar(), free_joint(), pin.JointModelTranslation(),
        pin.JointModelSpherical(), pin.JointModelPX(), pin.JointModelPZ(), pin.JointModelPrismaticUnaligned(unit(rng)),
        pin.JointModelRX(), pin.JointModelRY(), pin.JointModelRZ(), pin.JointModelRevoluteUnaligned(unit(rng)),
        pin.JointModelRUBX(), pin.JointModelRUBZ(),
    ]  # fmt: skip


def place_of(rng):
    return pin.SE3(rotation(rng), rng.normal(size=3))


def inertia_of(rng):
    return pin.Inertia(1.0 + rng.random(), rng.normal(size=3), np.diag(1.0 + rng.random(3)))


def random_model(rng, count=None):
    """A model of joints in a random order, each on the one before or on one that carries this."""
    chosen, model = rng.permutation(np.array(joints(rng), dtype=object))[:count], pin.Model()
    for k, joint in enumerate(chosen):
        # Pinocchio takes trees that are numbered depth first
        body = model.addJoint(int(rng.choice(list(model.supports[k]))), joint, place_of(rng), f"joint{k}")
        model.appendBodyToJoint(body, inertia_of(rng), place_of(rng))
    model.armature = rng.random(model.nv)
    return model


def moved_model(rng):
    model = random_model(rng, int(rng.integers(1, 9)))
    return model, pin.integrate(model, pin.neutral(model), rng.normal(size=model.nv)), rng.normal(size=model.nv)


def tree_of(model):
    return joint_tree(model, np.array(model.createData().parents_fromRow, dtype=np.int64))


def _placed(rng):
    model, q, _ = moved_model(rng)
    tree = tree_of(model)
    place_joints(tree, q)
    return (tree,)


def _weighed(rng):
    (tree,) = _placed(rng)
    weigh_joints(tree)
    return tree, rng.normal(size=len(tree.carrier))


def _pose(rng):
    return np.array([*rotation(rng), rng.normal(size=3)])


def _quaternion(rng):
    q = rng.normal(size=4)
    return _pose(rng), *(q / np.linalg.norm(q)).tolist()


def _place_joints(rng):
    model, q, _ = moved_model(rng)
    return tree_of(model), q


JOINT_TREE_ARGUMENTS = {
    "cross_product": lambda rng: tuple(rng.normal(size=6).tolist()),
    "turned": lambda rng: (_pose(rng), *rng.normal(size=3).tolist()),
    "turn_about": lambda rng: (_pose(rng), *unit(rng, 1), *(f(rng.random()) for f in (np.sin, np.cos))),
    "turn_by": _quaternion,
    "write_column": lambda rng: (
        np.full(6, np.nan), np.full(6, np.nan), *rng.normal(size=(2, 3)), *unit(rng, 1)[0].tolist(), rng.random() < 0.5,
    ),
    "write_inertia": lambda rng: (_pose(rng), rng.normal(size=3), rng.normal(size=10), np.full(10, np.nan)),
    "momentum": lambda rng: (rng.normal(size=10), *rng.normal(size=6).tolist()),
    "place_joints": _place_joints,
    "weigh_joints": _placed,
    "write_effects": _weighed,
}  # fmt: skip

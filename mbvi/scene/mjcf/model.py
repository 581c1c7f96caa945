"""Reads a model from its MJCF: MuJoCo compiles it, and its bodies and joints become a Pinocchio model.

MuJoCo resolves defaults, angles, frames and inertias. What mbvi does not model is named, see `mjcf_left_out`.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from ...arguments import shown
from ...errors import InputError, MjcfError
from ...geometry.shapes.shapes import Array, HalfSpace, PlacedShape
from ..items import SurfaceItem
from ..reductions import Omission
from ..urdf.robot import Robot
from .equalities import MjcfEqualities, equalities_of
from .file import compiled_model, disabled, gravity_of, placement
from .joint_forces import MjcfForces, forces_of
from .left_out import left_out
from .shapes import Coefficients, Geoms

_FREE, _BALL, _SLIDE, _HINGE = range(4)


@dataclass(frozen=True)
class MjcfModel:
    """What a MJCF describes.

    Attributes
    ----------
    robot : Robot
        All that moves, with the shapes of the static bodies that carry it.
    base : "free" or "fixed"
        "free" where all of it hangs on one free joint.
    pose : pinocchio.SE3
        Where the file puts a free base.
    walls : dict of str to HalfSpace
        Planes of the world, by the names that the file gives them.
    fields : dict of str to SurfaceItem
        Height fields of the world, likewise.
    statics : dict of str to PlacedShape
        Shapes of the world that carry nothing.
    friction : dict of frozenset of str to tuple
        mu, and the lengths of torsional and rolling friction [m], of pairs of the shapes and walls above.
    gravity : ndarray, shape (3,)
        The file's own, in its frame turned into the world [m/s^2].
    ignored : tuple of str
        What acts on the motion in MuJoCo and is left out here.
    velocity : ndarray, shape (nv,)
        At the start.
    equalities : MjcfEqualities
        Its equality constraints.
    forces : MjcfForces
        Its springs and actuators.
    ctrl : ndarray, shape (nu,)
        Inputs of the actuators at the start.
    """

    robot: Robot
    base: str
    pose: pin.SE3
    walls: dict[str, HalfSpace]
    fields: dict[str, SurfaceItem]
    statics: dict[str, PlacedShape]
    friction: dict[frozenset[str], Coefficients]
    gravity: Array
    ignored: tuple[str, ...]
    velocity: Array
    equalities: MjcfEqualities
    forces: MjcfForces
    ctrl: Array


@dataclass
class Tree:
    """The mechanism while it is made.

    Attributes
    ----------
    model : pinocchio.Model
        Joints and inertias.
    joint : list of int
        Of each body of the file the joint that carries it, 0 if it is static.
    place : list of pinocchio.SE3
        The pose of each body's frame in that joint's frame.
    names : list of str
        Of each body.
    """

    model: pin.Model
    joint: list[int] = field(default_factory=list)
    place: list[pin.SE3] = field(default_factory=list)
    names: list[str] = field(default_factory=list)


def load_mjcf(
    file: Path, pose: pin.SE3, name: str, taken: Collection[str] = (), keyframe: str | None = None,
    rolling: bool = False,
) -> MjcfModel:  # fmt: skip
    """Read a MJCF.

    Parameters
    ----------
    file : Path
        The file; MuJoCo finds its meshes.
    pose : pinocchio.SE3
        Where the frame of the file stands in the world.
    name : str
        Name in the scene.
    taken : collection of str
        Names that walls and static shapes must not have.
    keyframe : str, optional
        The keyframe that it starts from.
    rolling : bool
        Whether torsional and rolling friction are modelled.

    Raises
    ------
    MjcfError
        If there is no such file, it is no MJCF, MuJoCo refuses it, or nothing in it moves.
    InputError
        If MuJoCo is not installed, or the file has no such keyframe.
    """
    m, text = compiled_model(file)
    row = None if keyframe is None else _keyframe_number(m, keyframe)
    tree = _tree(m, pose, row)
    model = tree.model
    if model.nv == 0:
        raise MjcfError(f"{file}: no body has a joint: nothing moves")
    reference, moved = _reference(m, tree, pose)
    geoms = Geoms(m, tree.joint, tree.place, tree.names, name, {name, *taken})
    apart, dropped = geoms.pairs_left_out(model, reference)
    named, counted = left_out(m, text, tree.names, rolling)
    start, velocity, ctrl = reference, np.zeros(model.nv), np.zeros(m.nu)
    if row is not None:
        start, velocity, ctrl, moved = *_keyframe(m, tree, pose, row), []
    equalities = equalities_of(m, pose, name, tree.names, _joint_names(m))
    forces = forces_of(m, _joint_names(m))
    omitted = (*geoms.omitted, *named, *moved, *dropped, *equalities.omitted, *forces.omitted)
    free = model.joints[1].shortname() == "JointModelFreeFlyer" and list(model.parents)[1:].count(0) == 1
    base = pin.XYZQUATToSE3(start[:7]) if free else pin.SE3.Identity()
    shapes = tuple(geoms.shapes)
    robot = Robot(name, "", model, shapes, frozenset(apart), omitted, start, str(file.resolve()))
    ignored = (*counted, *(f"{one.what}, {one.why}" for one in moved), *geoms.ignored)
    ignored = (*ignored, *(one.what for one in (*equalities.omitted, *forces.omitted)))
    gravity = pose.rotation @ gravity_of(m)
    kind = "free" if free else "fixed"
    walls, fields, statics, friction = geoms.walls, geoms.fields, geoms.statics, geoms.friction(rolling)
    return MjcfModel(
        robot, kind, base, walls, fields, statics, friction, gravity, ignored, velocity, equalities, forces,
        ctrl[forces.inputs],
    )  # fmt: skip


def _tree(m: Any, pose: pin.SE3, row: int | None) -> Tree:
    """Return the mechanism of an MjModel whose frame stands at a pose, with mocap bodies as a keyframe has them."""
    tree = Tree(pin.Model(), [0], [pose], ["world"])
    model = tree.model
    joints = _joint_names(m)
    for body in range(1, m.nbody):
        tree.names.append(m.body(body).name or f"body{body}")
        parent, place = tree.joint[m.body_parentid[body]], tree.place[m.body_parentid[body]]
        moved = int(m.body_mocapid[body])
        if row is not None and moved >= 0:
            here = m.key_mpos[row].reshape(-1, 3)[moved], m.key_mquat[row].reshape(-1, 4)[moved]
        else:
            here = m.body_pos[body], m.body_quat[body]
        place = place * placement(*here)
        for j in range(m.body_jntadr[body], m.body_jntadr[body] + m.body_jntnum[body]):
            parent, place = _add_joint(m, j, joints[j], model, parent, place)
        tree.joint.append(parent)
        tree.place.append(place)
        inertia = _inertia(m, body)
        if parent:
            model.appendBodyToJoint(parent, inertia, place)
        # the inertia of a frame is kept for forces at its centre of mass; it is part of the joint's already
        above = model.getFrameId(model.names[parent], pin.FrameType.JOINT) if parent else 0
        frame = pin.Frame(tree.names[-1], parent, above, place, pin.FrameType.BODY, inertia)
        model.addFrame(frame, False)
    return tree


def _add_joint(m: Any, j: int, name: str, model: pin.Model, parent: int, place: pin.SE3) -> tuple[int, pin.SE3]:
    """Add a joint below a body's frame; return its number and the frame's new pose in it."""
    kind, anchor = int(m.jnt_type[j]), np.array(m.jnt_pos[j])
    axis, zero = np.array(m.jnt_axis[j]), float(m.qpos0[m.jnt_qposadr[j]])
    dof = int(m.jnt_dofadr[j])
    if kind == _FREE:
        joint = model.addJoint(parent, pin.JointModelFreeFlyer(), pin.SE3.Identity(), name)
        model.addJointFrame(joint)
        model.damping[model.idx_vs[joint] :][:6] = _damping(m, dof, 6)
        return joint, pin.SE3.Identity()
    here = place * pin.SE3(np.eye(3), anchor)
    back = pin.SE3(np.eye(3), -anchor)
    if kind == _BALL:
        joint, width = model.addJoint(parent, pin.JointModelSpherical(), here, name), 3
    else:
        # MuJoCo's joints stand at their reference in the file's pose
        zeroed = pin.exp6(pin.Motion(-zero * axis, np.zeros(3))) if kind == _SLIDE else pin.SE3(
            pin.exp3(-zero * axis), np.zeros(3)
        )  # fmt: skip
        joint, width = model.addJoint(parent, _along(kind, axis), here * zeroed, name), 1
        if m.jnt_limited[j] and not disabled(m, "LIMIT", "CONSTRAINT"):
            k = model.idx_qs[joint]
            model.lowerPositionLimit[k], model.upperPositionLimit[k] = m.jnt_range[j]
    model.addJointFrame(joint)
    v = model.idx_vs[joint]
    model.armature[v : v + width] = m.dof_armature[dof : dof + width]
    model.damping[v : v + width] = _damping(m, dof, width)
    return joint, back


def _damping(m: Any, dof: int, width: int) -> Array:
    """Return the damping of a joint, shape (width,)."""
    return np.zeros(width) if disabled(m, "DAMPER") else np.array(m.dof_damping[dof : dof + width])


def _along(kind: int, axis: Array) -> Any:
    """Return the joint about or along an axis, the aligned one where it is one of the frame's."""
    turns = kind == _HINGE
    aligned = (
        (pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ)
        if turns
        else (pin.JointModelPX, pin.JointModelPY, pin.JointModelPZ)
    )
    for unit, joint in zip(np.eye(3), aligned, strict=True):
        if np.array_equal(axis, unit):
            return joint()
    return pin.JointModelRevoluteUnaligned(axis) if turns else pin.JointModelPrismaticUnaligned(axis)


def _joint_names(m: Any) -> list[str]:
    """Return one name for each joint; those without one are called by their bodies."""
    names: list[str] = []
    for j in range(m.njnt):
        body = m.body(m.jnt_bodyid[j]).name or f"body{m.jnt_bodyid[j]}"
        own = m.joint(j).name or f"{body}_joint"
        default, number = own, 1
        while own in names or own == "universe":
            number += 1
            own = f"{default}_{number}"
        names.append(own)
    return names


def _inertia(m: Any, body: int) -> pin.Inertia:
    turn = placement(m.body_ipos[body], m.body_iquat[body])
    moments = turn.rotation * m.body_inertia[body] @ turn.rotation.T
    return pin.Inertia(float(m.body_mass[body]), turn.translation, 0.5 * (moments + moments.T))


def _configuration(m: Any, tree: Tree, pose: pin.SE3, qpos: Array) -> Array:
    """Return q, shape (nq,), of MuJoCo's positions."""
    q = pin.neutral(tree.model)
    for j in range(m.njnt):
        # joint 0 of Pinocchio is the world
        k, at = tree.model.idx_qs[j + 1], int(m.jnt_qposadr[j])
        if m.jnt_type[j] == _FREE:
            q[k : k + 7] = pin.SE3ToXYZQUAT(pose * placement(qpos[at : at + 3], qpos[at + 3 : at + 7]))
        elif m.jnt_type[j] == _BALL:
            w, x, y, z = qpos[at : at + 4] / np.linalg.norm(qpos[at : at + 4])
            q[k : k + 4] = x, y, z, w
        else:
            q[k] = qpos[at]
    return q


def _keyframe_number(m: Any, name: str) -> int:
    """Return the number of a keyframe."""
    names = [m.key(k).name for k in range(m.nkey)]
    if name not in names:
        raise InputError(f"the file has no keyframe {shown(name)}; it has {', '.join(filter(None, names)) or 'none'}")
    return names.index(name)


def _keyframe(m: Any, tree: Tree, pose: pin.SE3, row: int) -> tuple[Array, Array, Array]:
    """Return q, v and the inputs of a keyframe, shapes (nq,), (nv,) and (nu,)."""
    q, v = _configuration(m, tree, pose, m.key_qpos[row]), np.zeros(tree.model.nv)
    for j in range(m.njnt):
        here, at, width = tree.model.idx_vs[j + 1], int(m.jnt_dofadr[j]), tree.model.nvs[j + 1]
        v[here : here + width] = m.key_qvel[row, at : at + width]
        if m.jnt_type[j] == _FREE:
            # MuJoCo has the linear velocity in the world, Pinocchio in the body
            k = tree.model.idx_qs[j + 1]
            turn = pin.XYZQUATToSE3(q[k : k + 7]).rotation.T @ pose.rotation
            v[here : here + 3] = turn @ v[here : here + 3]
    return q, v, np.array(m.key_ctrl[row])


def _reference(m: Any, tree: Tree, pose: pin.SE3) -> tuple[Array, list[Omission]]:
    """Return the configuration of the file, and the joints that it puts outside their limits."""
    q, moved = _configuration(m, tree, pose, m.qpos0), []
    for j in range(m.njnt):
        if m.jnt_type[j] in (_HINGE, _SLIDE):
            k = tree.model.idx_qs[j + 1]
            lower, upper = tree.model.lowerPositionLimit[k], tree.model.upperPositionLimit[k]
            if not lower <= q[k] <= upper:
                q[k] = 0.5 * (lower + upper)
                why = f"outside its limits; it starts at their middle, {q[k]:.4g}"
                moved.append(Omission(f"reference of joint {tree.model.names[j + 1]}", why))
    return q, moved

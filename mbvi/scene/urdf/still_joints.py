"""Removes joints that never move: the links behind them become part of the link before."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin

from ...arguments import shown
from ...errors import InputError
from ...geometry.shapes.shapes import Array, PlacedShape
from ...system.actuators import Actuators, DrivenActuators
from ..items import RobotItem, SceneItems
from ..reductions import Omission
from .robot import Robot


def checked_locked(robot: Robot, base: str, q: Array, v: Array, locked: Sequence[str]) -> tuple[str, ...]:
    """Return the joints that a user locks, each once.

    Raises
    ------
    InputError
        If there is no such joint, it is to move, stands outside its limits, or nothing else moves.
    """
    model = robot.model
    known = list(model.names)[2 if base == "free" else 1 :]
    for name in locked:
        if name not in known:
            raise InputError(f"{robot.name} has no joint {shown(name)} to lock; known are {', '.join(known) or 'none'}")
        joint = model.getJointId(name)
        if _of(v, model.idx_vs[joint], model.nvs[joint]).any():
            raise InputError(f"joint {name!r} is locked and cannot have a velocity")
        here = slice(model.idx_qs[joint], model.idx_qs[joint] + model.nqs[joint])
        if model.nqs[joint] == 1 and not model.lowerPositionLimit[here] <= q[here] <= model.upperPositionLimit[here]:
            raise InputError(f"joint {name!r} is locked at {q[here][0]:g}, outside its limits")
    if base == "fixed" and len(set(locked)) == len(known):
        raise InputError(f"all joints of {robot.name} are locked: nothing of it is left to move")
    return tuple(dict.fromkeys(locked))


def counts_joints(item: RobotItem, items: SceneItems) -> bool:
    """Return whether a control or a force on a link receives the joints of a robot's URDF in its arguments."""
    on_links = [force.body.partition("/")[0] for force in items.forces if "/" in force.body]
    return item.control is not None or bool(items.controls) or item.robot.name in on_links


def without_still_joints(item: RobotItem, reduce: Sequence[str], counted: bool) -> tuple[RobotItem, list[Omission]]:
    """Return a robot without the joints that are locked or whose limits leave them no range, and what was left out.

    `counted` says that a function of the user's counts the joints of the URDF: those without range then stay.
    """
    model, reasons = item.robot.model, {name: "locked" for name in item.locked}
    if "joints" in reduce and not counted:
        reasons = {name: "its limits leave no range" for name in _without_range(model, item.q0, item.v0)} | reasons
    if not reasons or len(reasons) == model.njoints - 1:
        return item, []
    still = [model.getJointId(name) for name in reasons]
    reduced = pin.buildReducedModel(model, still, item.q0)
    kept = [j for j in range(1, model.njoints) if j not in still]
    q0 = np.concatenate([_of(item.q0, model.idx_qs[j], model.nqs[j]) for j in kept])
    v0 = np.concatenate([_of(item.v0, model.idx_vs[j], model.nvs[j]) for j in kept])
    shapes = tuple(_moved(s, model, reduced, still) for s in item.robot.shapes)
    held = {name: _of(item.q0, model.idx_qs[j], model.nqs[j]) for name, j in zip(reasons, still, strict=True)}
    springs = tuple(f for f in (spring.holding(held) for spring in item.springs) if f.joints)
    control = item.control.holding(held) if isinstance(item.control, Actuators | DrivenActuators) else item.control
    omitted = []
    for name, why in reasons.items():
        j = model.getJointId(name)
        where = _of(item.q0, model.idx_qs[j], model.nqs[j])
        bounds = np.abs([model.lowerPositionLimit[model.idx_qs[j]], model.upperPositionLimit[model.idx_qs[j]]])
        limits = int((bounds < 1e100).sum()) if len(where) == 1 else 0
        at = f", at {where[0]:.4g}" if len(where) == 1 else ""
        omitted.append(Omission(f"joint {item.robot.name}/{name}", why + at, dofs=model.nvs[j], rows=limits))
    robot = replace(item.robot, model=reduced, shapes=shapes)
    return replace(item, robot=robot, q0=q0, v0=v0, springs=springs, control=control), omitted


def _without_range(model: pin.Model, q: Array, v: Array) -> list[str]:
    names = []
    for joint in range(1, model.njoints):
        k = model.idx_qs[joint]
        bounds = model.lowerPositionLimit[k], model.upperPositionLimit[k], q[k]
        if model.nqs[joint] == 1 and len(set(map(float, bounds))) == 1 and v[model.idx_vs[joint]] == 0.0:
            names.append(model.names[joint])
    return names


def _moved(placed: PlacedShape, model: pin.Model, reduced: pin.Model, still: Sequence[int]) -> PlacedShape:
    """Return a shape on the body that now carries it."""
    if placed.body == 0:
        return placed
    name = model.names[placed.body]
    if placed.body not in still:
        return replace(placed, body=reduced.getJointId(name))
    # a joint that was left out is a frame of the new model
    frame = reduced.frames[reduced.getFrameId(name, pin.FrameType.FIXED_JOINT)]
    turn, shift = frame.placement.rotation, frame.placement.translation
    rotation, position = turn @ placed.rotation, turn @ placed.position + shift
    return replace(placed, body=int(frame.parentJoint), rotation=rotation, position=position)


def _of(values: Array, start: int, count: int) -> Array:
    return values[start : start + count]

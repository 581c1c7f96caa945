"""Dry friction of a robot's joints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import pinocchio as pin

from ...arguments import not_negative, numbers_by_name
from ...errors import InputError
from ..reductions import Omission
from .robot import Robot


def with_joint_friction(
    robot: Robot, given: bool | Mapping[str, float], stated: Mapping[str, float]
) -> tuple[Robot, dict[str, float]]:
    """Return a robot with what it leaves out of dry friction, and the friction of its joints by name [N m, N].

    `given` is whether they have that of the file, which is `stated`, or the friction of some joints, which are then all
    that have it.
    """
    friction: Mapping[str, float]
    if isinstance(given, bool):
        friction = stated if given else {}
    else:
        friction = numbers_by_name(given, "joint_friction")
        for name, largest in friction.items():
            if not robot.model.existJointName(name) or _width(robot.model, name) != 1:
                raise InputError(f"joint_friction: {robot.name} has no joint '{name}' that turns or slides")
            not_negative(largest, f"joint_friction['{name}']")
    if stated and given is False:
        omission = Omission(f"dry friction of {', '.join(stated)}", "joint_friction=True models it")
        robot = replace(robot, omitted=(*robot.omitted, omission))
    return robot, {name: largest for name, largest in friction.items() if largest > 0.0}


def set_joint_friction(model: pin.Model, friction: Mapping[str, float]) -> None:
    """Give the joints of a model this dry friction, and no other; joints that it does not have are left out."""
    limit = model.upperDryFrictionLimit.copy()
    limit[:] = 0.0
    for name, largest in friction.items():
        if model.existJointName(name):
            limit[model.idx_vs[model.getJointId(name)]] = largest
    model.upperDryFrictionLimit = limit


def stated_friction(model: pin.Model) -> dict[str, float]:
    """Return the largest torque or force of dry friction of each joint of a URDF that has some [N m, N]."""
    found = {}
    for joint in range(1, model.njoints):
        largest = model.upperDryFrictionLimit[model.idx_vs[joint]] if model.nvs[joint] == 1 else 0.0
        if largest > 0.0:
            found[str(model.names[joint])] = float(largest)
    return found


def _width(model: pin.Model, name: str) -> int:
    return int(model.nvs[model.getJointId(name)])

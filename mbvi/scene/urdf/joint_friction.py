"""Dry friction of a robot's joints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import pinocchio as pin

from ...arguments import not_negative, numbers_by_name
from ...errors import InputError
from .robot import DRY, Robot, stated_friction


def with_joint_friction(robot: Robot, given: bool | Mapping[str, float]) -> tuple[Robot, dict[str, float]]:
    """Return a robot without the omission of what it has of dry friction, and the friction of joints by name [N m, N].

    `given` is whether they have that of the file, or the friction of some joints, which are then all that have it.
    """
    stated = stated_friction(robot.model)
    if isinstance(given, bool):
        friction = stated if given else {}
    else:
        friction = numbers_by_name(given, "joint_friction")
        for name, largest in friction.items():
            if not robot.model.existJointName(name) or _width(robot.model, name) != 1:
                raise InputError(f"joint_friction: {robot.name} has no joint '{name}' that turns or slides")
            not_negative(largest, f"joint_friction['{name}']")
    if friction or not isinstance(given, bool):
        robot = replace(robot, omitted=tuple(one for one in robot.omitted if not one.what.startswith(DRY)))
    return robot, {name: largest for name, largest in friction.items() if largest > 0.0}


def set_joint_friction(model: pin.Model, friction: Mapping[str, float]) -> None:
    """Give the joints of a model this dry friction, and no other; joints that it does not have are left out."""
    limit = model.upperDryFrictionLimit.copy()
    limit[:] = 0.0
    for name, largest in friction.items():
        if model.existJointName(name):
            limit[model.idx_vs[model.getJointId(name)]] = largest
    model.upperDryFrictionLimit = limit


def _width(model: pin.Model, name: str) -> int:
    return int(model.nvs[model.getJointId(name)])

"""Marks the frames of links that external forces and connections act on."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Collection
from dataclasses import replace

import numpy as np
import pinocchio as pin

from ...geometry.shapes.shapes import Array, PlacedShape, Sphere
from ..items import RobotItem
from ..urdf.robot import Robot

_POINT = Sphere(1.0)


def with_frames(item: RobotItem, links: Collection[str]) -> RobotItem:
    """Return a robot with a mark at the frame of each of some links "robot/link", behind its shapes.

    Marks are shapes, so that whatever moves these to other bodies moves marks too.
    """
    model, name, marks = item.robot.model, item.robot.name, []
    for frame in model.frames:
        label = f"{name}/{frame.name}"
        if frame.type == pin.FrameType.BODY and label in links:
            turn, place = np.array(frame.placement.rotation), np.array(frame.placement.translation)
            marks.append(PlacedShape(label, _POINT, int(frame.parentJoint), turn, place))
    return replace(item, robot=replace(item.robot, shapes=(*item.robot.shapes, *marks))) if marks else item


def centre_of(robot: Robot, link: str) -> Array:
    """Return the centre of mass of a link in its frame, shape (3,)."""
    if not robot.text:
        lever: Array = robot.model.frames[robot.model.getFrameId(link, pin.FrameType.BODY)].inertia.lever
        return lever
    for one in ElementTree.fromstring(robot.text).findall("link"):
        origin = one.find("inertial/origin")
        if one.get("name") == link and origin is not None and origin.get("xyz"):
            return np.array(origin.get("xyz", "").split(), dtype=float)
    return np.zeros(3)

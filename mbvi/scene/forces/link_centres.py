"""Marks the centres of mass of the links that external forces act on."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
import pinocchio as pin

from ...geometry.shapes.shapes import Array, PlacedShape, Sphere
from ..items import ForceItem, RobotItem
from ..urdf.robot import Robot

_POINT = Sphere(1.0)


def with_centres(item: RobotItem, forces: Iterable[ForceItem]) -> RobotItem:
    """Return a robot with a mark at the centre of mass of each link that a force acts on, behind its shapes.

    Marks are shapes, so that whatever moves these to other bodies moves marks too.
    """
    links = {f.body.partition("/")[2] for f in forces if f.body.startswith(f"{item.robot.name}/")}
    if not links:
        return item
    model, marks = item.robot.model, []
    for name, centre in _centres(item.robot):
        if name not in links:
            continue
        frame = model.frames[model.getFrameId(name, pin.FrameType.BODY)]
        place = frame.placement.act(centre)
        marks.append(PlacedShape(f"{item.robot.name}/{name}", _POINT, int(frame.parentJoint), np.eye(3), place))
    return replace(item, robot=replace(item.robot, shapes=(*item.robot.shapes, *marks)))


def _centres(robot: Robot) -> Iterator[tuple[str, Array]]:
    """Yield the links of a robot and their centres of mass in the links' frames."""
    if not robot.text:
        yield from ((f.name, f.inertia.lever) for f in robot.model.frames if f.type == pin.FrameType.BODY)
        return
    for link in ElementTree.fromstring(robot.text.encode()).findall("link"):
        origin, centre = link.find("inertial/origin"), np.zeros(3)
        if origin is not None and origin.get("xyz"):
            centre = np.array(origin.get("xyz", "").split(), dtype=float)
        yield link.get("name", ""), centre

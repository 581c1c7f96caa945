"""Planar joints of a URDF, which move across their axes."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

import numpy as np
import pinocchio as pin

_NORMAL = np.array([0.0, 0.0, 1.0])
# that of a joint without <axis>, by the URDF
_AXIS = "1 0 0"


def turn_planar_joints(model: pin.Model, text: str) -> None:
    """Let the planar joints of a model move in the planes that its URDF names by their normals, the axes.

    Pinocchio reads no axis of them, and moves them along x and y of their frames. The frame of such a joint is turned
    by the least rotation that takes z to the axis; what the joint carries stays where it is.
    """
    for one in ElementTree.fromstring(text).findall("joint"):
        name = one.get("name", "")
        if one.get("type") != "planar" or not model.existJointName(name):
            continue
        axis = one.find("axis")
        normal = np.array([float(x) for x in (_AXIS if axis is None else axis.get("xyz", _AXIS)).split()])
        normal /= np.linalg.norm(normal)
        if not np.array_equal(normal, _NORMAL):
            turn = pin.Quaternion.FromTwoVectors(_NORMAL, normal).toRotationMatrix()
            _turn_joint(model, model.getJointId(name), pin.SE3(turn, np.zeros(3)))


def _turn_joint(model: pin.Model, joint: int, turn: pin.SE3) -> None:
    """Turn the frame of a joint, and nothing else."""
    back = turn.inverse()
    model.jointPlacements[joint] = model.jointPlacements[joint] * turn
    model.inertias[joint] = back.act(model.inertias[joint])
    for other in range(1, model.njoints):
        if model.parents[other] == joint:
            model.jointPlacements[other] = back * model.jointPlacements[other]
    for frame in model.frames:
        if frame.parentJoint == joint and frame.type != pin.FrameType.JOINT:
            frame.placement = back * frame.placement

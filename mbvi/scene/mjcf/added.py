"""The part of a scene that adds models from MJCF files."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin

from ...arguments import (
    boolean,
    function,
    label,
    made_label,
    not_negative,
    numbers_by_name,
    optional,
    printable,
    several_names,
    vector,
)
from ...errors import InputError, MbviWarning
from ...geometry.shapes.orientation import RotationLike, rotation_matrix
from ...geometry.shapes.shapes import Array
from ...system.actuators import Actuators, DrivenActuators, Inputs
from ...system.mechanisms.articulated import Control
from ..items import BodyItem, RobotItem, SceneItems
from ..reductions import Omission
from ..urdf.checks import check_mass_matrix
from ..urdf.joint_friction import with_joint_friction
from ..urdf.robot_names import description_file
from ..urdf.start import initial_state, set_base_velocity
from ..urdf.still_joints import checked_locked
from .file import mjcf_name
from .model import MjcfModel, load_mjcf

Ctrl = Callable[[float, Array, Array], Any]

_ORIGIN = (0.0, 0.0, 0.0)
_STILL = (0.0,) * 6
_UPRIGHT = np.eye(3)


class MjcfModels:
    """Models that MuJoCo reads."""

    _items: SceneItems

    def add_mjcf(
        self,
        path: str | os.PathLike[str],
        position: Sequence[float] | Array = _ORIGIN,
        rotation: RotationLike = _UPRIGHT,
        joints: Mapping[str, float] | None = None,
        velocity: Mapping[str, float] | None = None,
        control: Control | None = None,
        name: str | None = None,
        locked: Sequence[str] = (),
        tolerance: float | None = None,
        base_velocity: Sequence[float] | Array = _STILL,
        keyframe: str | None = None,
        ctrl: Mapping[str, float] | Sequence[float] | Array | Ctrl | None = None,
        joint_friction: bool | Mapping[str, float] = True,
        rolling_friction: bool = False,
    ) -> str:
        """Add a model from a MJCF, which MuJoCo reads: bodies, joints, geoms, equalities, and what touches what.

        Parameters
        ----------
        path : path
            MJCF file, or a name "robot:..." as of `add_urdf`.
        position, rotation : array_like, optional
            Pose of the file's world: shape (3,) [m], and a rotation as `BodyArguments` has it.
        joints, velocity : mapping of str to float, optional
            Initial positions and velocities of hinges and slides by name; by default those of the file, at rest.
        control, name, locked, tolerance
            As `add_urdf`; a control acts in the place of the file's actuators, and beside its springs. q has MuJoCo's
            order with quaternions (x, y, z, w); velocities of a free joint are in the frame of its body.
        base_velocity : array_like, shape (6,)
            As `add_urdf`, of a model that hangs on one free joint.
        keyframe : str, optional
            Name of the file's keyframe whose positions and velocities it starts from; `joints`, `velocity` and
            `base_velocity` go before it.
        ctrl : mapping of str to float, array_like, shape (nu,), or function, optional
            Inputs of the actuators that are modelled: of some by name, all in the file's order, or a function
            ctrl(t, q, v) of the robot's own q and v that returns all; by default those of the keyframe, or zero.
            `Problem.ctrl` sets them later.
        joint_friction : bool or mapping of str to float
            As `add_urdf`; by default joints have the dry friction of the file.
        rolling_friction : bool
            Whether contacts have the torsional friction of geoms of `condim` 4 and 6, and the rolling friction of 6.
            Steps of robots are not compiled then; see docs/howto/friction.md.

        Returns
        -------
        str
            The name of all that moves, "name/body" its links. Planes, height fields, and shapes of the world that carry
            nothing, have the names of their geoms.

        Raises
        ------
        MjcfError
            If there is no such file, it is no MJCF, MuJoCo refuses it, or nothing in it moves.
        InputError
            If MuJoCo is not installed, and as `add_urdf`.

        Notes
        -----
        Friction between geoms of the file is the file's; with all else it is the scene's, and so are restitution and
        gravity. What is not modelled is named in `Problem.report()`, and in a warning if it changes the motion.
        """
        optional(function, control, "control", "control(t, q, v) -> tau")
        file, given = description_file(path, "MJCF"), optional(label, name)
        placed = {} if joints is None else numbers_by_name(joints, "joints")
        moving = {} if velocity is None else numbers_by_name(velocity, "velocity")
        still, within = several_names(locked, "locked"), optional(not_negative, tolerance, "tolerance")
        if control is not None and ctrl is not None:
            raise InputError("give either control, the torques of joints, or ctrl, the inputs of the file's actuators")
        pose = pin.SE3(rotation_matrix(rotation), vector(position, "position"))
        own = self._items.new_name(given, given or made_label(mjcf_name(file)))
        rolling = boolean(rolling_friction, "rolling_friction")
        found = load_mjcf(file, pose, own, self._items.names(), optional(printable, keyframe, "keyframe"), rolling)
        robot, base = found.robot, found.base
        place, turn = found.pose.translation.copy(), found.pose.rotation.copy()
        q0, v0 = initial_state(robot, base, place, turn, placed, moving, found.velocity)
        if keyframe is None or base_velocity is not _STILL:
            set_base_velocity(q0, v0, base, vector(base_velocity, "base_velocity", 6))
        still = checked_locked(robot, base, q0, v0, still)
        check_mass_matrix(robot.model, q0, still, file)
        ignored, actuators = list(found.ignored), found.forces.actuators
        if control is None:
            control = _driven(found, ctrl)
        elif actuators:
            named = f"actuators {', '.join(force.name for force in actuators)}"
            robot = replace(robot, omitted=(*robot.omitted, Omission(named, "control acts in their place")))
        if not np.array_equal(found.gravity, self._items.gravity):
            what = f"gravity {found.gravity.tolist()} of the file"
            robot = replace(robot, omitted=(*robot.omitted, Omission(what, "the scene's holds")))
            ignored.append(what)
        springs = tuple(found.forces.springs)
        robot, friction = with_joint_friction(robot, joint_friction, found.forces.friction)
        self._items.robots.append(
            RobotItem(robot, base, place, turn, q0, v0, control, still, within, springs, friction)
        )
        self._add_world(found)
        self._items.connections += found.equalities.connections
        self._items.couplings += found.equalities.couplings
        if ignored:
            warnings.warn(
                f"{file.name}: the file also holds what is not modelled: {', '.join(ignored)}",
                MbviWarning,
                stacklevel=2,
            )
        return own

    def _add_world(self, found: MjcfModel) -> None:
        """Add the walls, height fields, static shapes and friction of a file."""
        self._items.walls.update(found.walls)
        self._items.surfaces += found.fields.values()
        zero = np.zeros(3)
        for name, s in found.statics.items():
            inertia = s.shape.inertia(1.0)
            body = BodyItem(name, s.shape, 1.0, inertia, zero, s.position, s.rotation, zero, zero, True)
            self._items.bodies.append(body)
        for pair, (mu, torsion, rolling) in found.friction.items():
            self._items.pair_friction[pair], self._items.pair_resistance[pair] = mu, (torsion, rolling)


def _driven(found: MjcfModel, ctrl: Any) -> Control | None:
    """Return the actuators of a file with the inputs that a user gives; None if it has none."""
    actuators = Actuators(found.forces.actuators, found.ctrl)
    if callable(ctrl):
        return DrivenActuators(actuators, function(ctrl, "ctrl", "ctrl(t, q, v) -> inputs"))
    inputs = Inputs([("", actuators)])
    if isinstance(ctrl, Mapping):
        for name, value in numbers_by_name(ctrl, "ctrl").items():
            inputs[name] = value
    elif ctrl is not None:
        inputs[:] = vector(ctrl, "ctrl", len(inputs))
    return actuators if actuators.forces else None

"""The initial state of a robot from its base's pose and velocity and the values of single joints."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
import pinocchio as pin

from ...arguments import shown
from ...errors import InputError
from .mimic import followed
from .robot import Array, Robot


def initial_state(
    robot: Robot,
    base: str,
    position: Array,
    rotation: Array,
    joints: Mapping[str, float],
    velocity: Mapping[str, float],
    rates: Array | float = 0.0,
    locked: Collection[str] = (),
) -> tuple[Array, Array]:
    """Return q and v of a robot, shapes (nq,) and (nv,), from its base's pose and the values of single joints.

    Joints that are not given stand at the robot's reference, and move at `rates`, shape (nv,); those that mimic others
    follow them, unless they are locked.
    """
    model = robot.model
    q, v = robot.reference.copy(), np.zeros(model.nv) + rates
    names = list(model.names)
    first = 1
    if base == "free":
        q[:7] = pin.SE3ToXYZQUAT(pin.SE3(rotation, position))
        first = 2
    for given, what in ((joints, "position"), (velocity, "velocity")):
        for joint, value in given.items():
            if joint not in names[first:]:
                raise InputError(
                    f"{robot.name} has no joint {shown(joint)}; known are {', '.join(names[first:]) or 'none'}"
                )
            k = names.index(joint)
            if model.nvs[k] != 1:
                raise InputError(f"joint {joint!r} has {model.nvs[k]} degrees of freedom; one number cannot place it")
            if what == "velocity":
                v[model.idx_vs[k]] = value
            elif model.nqs[k] == 1:
                q[model.idx_qs[k]] = value
            else:
                # a joint without limits stores cosine and sine
                q[model.idx_qs[k] : model.idx_qs[k] + 2] = np.cos(value), np.sin(value)
    followed(robot.mimics, model, q, v, joints, velocity, locked)
    return q, v


def set_base_velocity(q: Array, v: Array, base: str, velocity: Array) -> None:
    """Write the velocity of a base, shape (6,) in the world frame, into the v of a robot at q.

    Raises
    ------
    InputError
        If the base is fixed and is to move.
    """
    if base == "free":
        # Pinocchio has it in the frame of the base
        turn = pin.XYZQUATToSE3(q[:7]).rotation
        v[:3], v[3:6] = turn.T @ velocity[:3], turn.T @ velocity[3:]
    elif velocity.any():
        raise InputError("base_velocity is that of a free base, and base='fixed' welds it to the world: leave it out")

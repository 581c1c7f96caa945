"""Planar scenes: checks that all bodies stay in the plane, and the reduced model of robots and walls."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from ..arguments import shown
from ..errors import InadmissibleStartError, InputError
from ..geometry.shapes.shapes import Array, HalfSpace, PlacedShape
from ..system import System
from ..system.free.planar import planar_base
from .reductions import Omission

if TYPE_CHECKING:
    from .items import BodyItem, RobotItem, SceneItems

_ALONG = {"xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}
# values that count as zero: components of unit vectors, and relative velocities, moments of inertia and gravity
_ROUND = 1e-9
# how far another state of a planar problem may be from its plane: what a run drifts by in rounding is far less
_SAME_PLANE = 1e-6


def checked_plane(plane: str | None) -> str | None:
    """Return the name of a plane, or None."""
    if plane is not None and not (isinstance(plane, str) and plane in _ALONG):
        raise InputError(f"plane must be one of {', '.join(_ALONG)}, or None; got {shown(plane)}")
    return plane


def axes_of(plane: str) -> Array:
    """Return in rows two unit vectors along a plane and its normal, their cross product, shape (3, 3)."""
    first, second = np.eye(3)[list(_ALONG[plane])]
    return np.array([first, second, np.cross(first, second)])


def check_plane(items: SceneItems) -> None:
    """Raise `InputError` if a body or robot base of a planar scene would leave the plane or turn out of it."""
    plane = items.plane
    if plane is None:
        return
    axes = axes_of(plane)
    if _leaves(items.gravity, axes):
        raise InputError(
            f"gravity {items.gravity.tolist()} leaves the plane {plane}; give Scene(gravity=...) without that part"
        )
    for name, wall in items.walls.items():
        lean = abs(float(np.dot(wall.normal, axes[2])))
        if _ROUND < lean < 1.0 - _ROUND:
            raise InputError(f"half-space {name} leans out of the plane {plane}: it would push what it meets out of it")
    moving = [(body.name, body.velocity) for body in items.bodies if not body.fixed]
    moving += [pair for s in items.spheres for pair in zip(s.names(), s.velocities, strict=True)]
    turning = [(body.name, body.angular_velocity) for body in items.bodies if not body.fixed]
    for robot in items.robots:
        if robot.base == "free":
            velocity, spin = _base_velocity(robot)
            moving.append((robot.robot.name, velocity))
            turning.append((robot.robot.name, spin))
    for name, velocity in moving:
        if _leaves(velocity, axes):
            raise InputError(f"{name} starts with a velocity out of the plane {plane}")
    for name, spin in turning:
        if np.linalg.norm(axes[:2] @ spin) > _ROUND * np.linalg.norm(spin):
            raise InputError(f"{name} starts with an angular velocity that turns it out of the plane {plane}")
    for body in items.bodies:
        if not body.fixed:
            _check_inertia(body, plane, axes)


def _leaves(vector: Array, axes: Array) -> bool:
    return bool(abs(vector @ axes[2]) > _ROUND * np.linalg.norm(vector))


def _base_velocity(item: RobotItem) -> tuple[Array, Array]:
    """Return the linear and the angular velocity of a free base in the world."""
    turn = pin.XYZQUATToSE3(item.q0[:7]).rotation
    return turn @ item.v0[:3], turn @ item.v0[3:6]


def _check_inertia(body: BodyItem, plane: str, axes: Array) -> None:
    own = body.rotation.T @ axes[2]
    moment = body.inertia @ own
    if np.linalg.norm(moment - (own @ moment) * own) > _ROUND * np.linalg.norm(moment):
        raise InputError(
            f"the normal of the plane {plane} is no principal axis of inertia of {body.name}: turning about it, "
            "it would tumble"
        )


def check_robot(item: RobotItem, plane: str) -> None:
    """Raise `InputError` if a robot has joints that leave a plane."""
    model, axes = item.robot.model, axes_of(plane)
    data = model.createData()
    pin.forwardKinematics(model, data, item.q0)
    out = []
    for joint in range(1 + (item.base == "free"), model.njoints):
        here = model.joints[joint].createData()
        model.joints[joint].calc(here, item.q0)
        # columns of what the joint can do, in its own frame
        S = data.oMi[joint].rotation @ np.asarray(here.S).reshape(2, 3, -1)
        if max(np.abs(axes[2] @ S[0]).max(), np.abs(axes[:2] @ S[1]).max()) > _ROUND:
            out.append(model.names[joint])
    if out:
        raise InputError(
            f"{', '.join(out)} of {item.robot.name} leave{'s' * (len(out) == 1)} the plane {plane}: lock what does by "
            "add_urdf(..., locked=[...])"
        )


def on_planar_base(item: RobotItem, axes: Array) -> RobotItem:
    """Return a robot whose free base moves in a plane: its q are two coordinates, cosine and sine."""
    pose = pin.XYZQUATToSE3(item.q0[:7])
    model = planar_base(item.robot.model, pose, axes)
    turn = axes @ pose.rotation
    shapes = tuple(
        replace(s, rotation=turn @ s.rotation, position=turn @ s.position) if s.body == 1 else s
        for s in item.robot.shapes
    )
    q0 = np.concatenate([axes[:2] @ pose.translation, [1.0, 0.0], item.q0[7:]])
    robot = replace(item.robot, model=model, shapes=shapes)
    velocity, spin = _base_velocity(item)
    v0 = np.concatenate([axes[:2] @ velocity, axes[2:] @ spin, item.v0[6:]])
    return replace(item, robot=robot, q0=q0, v0=v0)


def check_same_plane(system: System, known: Array, q: Array, plane: str) -> None:
    """Raise `InputError` if a body left its plane, or turned out of it, from a known configuration to q."""
    bodies = np.arange(1, len(system.bodies))
    before, after = (system.placements(at, bodies) @ axes_of(plane)[2] for at in (known, q))
    off = np.abs(after - before)
    # places, in rows after three of the axes, are in metres
    off[:, 3] /= 1.0 + np.abs(before[:, 3])
    wrong = np.flatnonzero(off.max(axis=1) > _SAME_PLANE)
    if wrong.size:
        name = system.bodies[1 + int(wrong[0])]
        raise InputError(f"q has {name} outside the plane {plane} that the problem was built for, or turned out of it")


def collinear_points(count: int) -> list[Omission]:
    """Return the omission of so many points of shapes over half-spaces, as others lie in line with them."""
    return [Omission("points in line across the plane", "their rows are the same", rows=count)] if count else []


def beside(
    walls: dict[str, HalfSpace], shapes: Sequence[PlacedShape], system: System, q: Array, axes: Array
) -> Iterator[tuple[str, Omission]]:
    """Yield the half-spaces that lie along the plane, which nothing moves towards.

    Raises
    ------
    InadmissibleStartError
        If a shape reaches into one.
    """
    moving = [s for s in shapes if s.body]
    places = system.placements(q, np.array([s.body for s in moving], dtype=np.intp))
    for name, wall in list(walls.items()):
        normal = np.asarray(wall.normal)
        if abs(normal @ axes[2]) < 0.5:
            continue
        for placed, place in zip(moving, places, strict=True):
            centres, half_axes, radius = placed.shape.support_points()
            up = place[:3] @ normal
            points = centres @ placed.rotation.T + placed.position
            sag = np.linalg.norm(half_axes * (placed.rotation.T @ up), axis=1)
            gap = float((points @ up - sag).min()) - radius + float(place[3] @ normal) - wall.offset
            if gap < -_ROUND * placed.shape.bound:
                raise InadmissibleStartError(
                    f"the initial configuration is not admissible: {placed.name} reaches {-gap:.6g} into {name}, which "
                    "lies along the plane"
                )
        why = "lies along the plane: nothing moves towards it"
        yield name, Omission(f"half-space {name}", why, pairs=len(moving))

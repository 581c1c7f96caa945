"""What acts about the hinges of a scene that close loops: limits, springs, damping, dry friction and controls."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pinocchio as pin

from ...constraints import HingeLimits
from ...geometry.shapes.shapes import Array, PlacedShape
from ...system import System
from ...system.controls import LoopControl
from ...system.hinged import Hinges
from ...system.mechanisms.articulated import Control
from ...system.mechanisms.hinge_angles import HingeAngles
from ..items import SceneItems
from .equalities import Side, frames_of, sides_at
from .items import ConnectionItem


def hinge_limits(
    items: SceneItems, system: System, frames: Mapping[str, PlacedShape], shapes: Sequence[PlacedShape], q: Array,
    lever: float,
) -> list[HingeLimits]:  # fmt: skip
    """Return the limits of the hinges of a scene as one family, none if there are none.

    The other arguments are those of `equalities_between`; `lever` makes a length of an angle [m/rad].
    """
    limited = [(one, one.limits) for one in items.active_connections if one.limits is not None]
    if not limited:
        return []
    angles = _angles([one for one, _ in limited], sides_at(items, system, frames, shapes, q))
    limits, names = np.array([bounds for _, bounds in limited]).T, [one.name for one, _ in limited]
    return [HingeLimits(system, angles, limits, names, items.restitution, lever)]


def acting_hinges(
    items: SceneItems, system: System, frames: Mapping[str, PlacedShape], shapes: Sequence[PlacedShape], q: Array
) -> Hinges | None:
    """Return the hinges of a scene with torques of their own, None if there are none; see `equalities_between`."""
    acting = [one for one in items.active_connections if one.acts]
    if not acting:
        return None
    angles = _angles(acting, sides_at(items, system, frames, shapes, q))
    numbers = np.array([(one.stiffness, one.rest, one.damping, one.friction) for one in acting])
    stiffness, rest, damping, friction = numbers.T.copy()
    names, controls = tuple(one.name for one in acting), tuple(fitted_control(one) for one in acting)
    return Hinges(names, angles, stiffness, rest, damping, friction, controls)


def fitted_control(item: ConnectionItem) -> Control | None:
    """Return the control of a hinge as it acts on a robot of one joint of the hinge's name.

    Raises
    ------
    InputError
        If it does not fit one.
    """
    if not isinstance(item.control, LoopControl):
        return item.control
    model = pin.Model()
    model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), item.name)
    return item.control.fitted(model, item.name)


def _angles(hinges: Sequence[ConnectionItem], sides: Mapping[str, Side]) -> HingeAngles:
    pairs = [(sides[one.first], sides[one.second]) for one in hinges]
    found = np.array([frames_of(one, *pair) for one, pair in zip(hinges, pairs, strict=True)])
    bodies = np.array([[side.body for side in pair] for pair in pairs], dtype=np.int64).T.copy()
    return HingeAngles(bodies, found.transpose(1, 0, 2, 3).copy())

"""Several mechanisms and free bodies as one mechanism: one Pinocchio model with the same q, v and bodies."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import pinocchio as pin

from ...errors import InputError
from ..actuated import ActuatedSystem
from ..blocks import BlockSystem
from ..free.bodies import FreeBodies, Spheres
from ..parts import parts_of
from ..system import Array, System
from .articulated import ArticulatedSystem
from .equalities import Equality
from .mechanism import free_joint

# of the parts that can be joined their gravity, shape (3,) [m/s^2]; of classes derived from these q or v may differ
_GRAVITY: dict[type, Callable[[Any], Array]] = {
    ArticulatedSystem: lambda part: np.array(part.model.gravity.linear),
    FreeBodies: lambda part: np.asarray(part.gravity),
    Spheres: lambda part: np.asarray(part.gravity),
}

# of systems of free bodies, whose masses do not change: making one takes as long as hundreds of steps
_joined: WeakKeyDictionary[System, ArticulatedSystem] = WeakKeyDictionary()


def can_be_joined(system: System) -> bool:
    """Return whether a system consists of mechanisms, free bodies and spheres."""
    if system.whole is not None:
        return True
    parts = parts_of(system)
    if type(_unloaded(system)) not in (BlockSystem, *_GRAVITY) or not all(type(part) in _GRAVITY for part in parts):
        return False
    first, *others = (_GRAVITY[type(part)](part) for part in parts)
    if any((gravity != first).any() for gravity in others):
        return False
    # forces from outside are those of an `ActuatedSystem`
    return system.loaded or not any(part.applied is not None and part.applied.any() for part in parts)


def joined(system: System, between: Sequence[Equality] = ()) -> ArticulatedSystem:
    """Return one mechanism that moves as a system does of which `can_be_joined` is true, without controls and forces.

    A free body has a joint that moves its centre and then turns it, so that q, v and the retraction are its own.
    `between` are equalities between parts.

    Raises
    ------
    InputError
        If there are some, and the parts cannot be joined.
    """
    if isinstance(system.whole, ArticulatedSystem):
        return system.whole
    system = _unloaded(system)
    if isinstance(system, ArticulatedSystem) and not between:
        return system
    if not between and system in _joined:
        return _joined[system]
    if between and not can_be_joined(system):
        raise InputError(
            "bodies that move in a plane cannot be connected: build the scene without the reduction 'plane'"
        )
    parts, model, equalities = parts_of(system), pin.Model(), [*between]
    model.gravity.linear = _GRAVITY[type(parts[0])](parts[0])
    for part in parts:
        if isinstance(part, ArticulatedSystem):
            equalities += [one.moved_to(model.nq, model.nv, model.njoints - 1) for one in part.equalities]
            _add_mechanism(model, part.model)
        elif isinstance(part, FreeBodies):
            for mass, inertia in zip(part.masses, part.inertias, strict=True):
                _add_body(model, free_joint(), pin.Inertia(float(mass), np.zeros(3), inertia))
        elif isinstance(part, Spheres):
            for mass in part.masses:
                _add_body(model, pin.JointModelTranslation(), pin.Inertia(float(mass), np.zeros(3), np.zeros((3, 3))))
    made = ArticulatedSystem(model, equalities=equalities)
    if not between and all(part.free_bodies for part in parts):
        _joined[system] = made
    return made


def _unloaded(system: System) -> System:
    return system.inner if isinstance(system, ActuatedSystem) else system


def _add_body(model: pin.Model, joint: pin.JointModel, inertia: pin.Inertia) -> None:
    added = model.addJoint(0, joint, pin.SE3.Identity(), str(model.njoints))
    model.appendBodyToJoint(added, inertia, pin.SE3.Identity())


def _add_mechanism(model: pin.Model, part: pin.Model) -> None:
    first, begin = model.njoints - 1, model.nv
    for joint in range(1, part.njoints):
        parent = part.parents[joint]
        added = model.addJoint(
            parent + first if parent else 0, part.joints[joint], part.jointPlacements[joint], str(model.njoints)
        )
        model.appendBodyToJoint(added, part.inertias[joint], pin.SE3.Identity())
    model.damping[begin:], model.armature[begin:] = part.damping, part.armature
    model.upperDryFrictionLimit[begin:] = part.upperDryFrictionLimit

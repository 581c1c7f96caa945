"""Which coordinates of a velocity are those of lengths, so that nothing depends on the unit of these."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from .articulated import ArticulatedSystem
from .blocks import BlockSystem
from .bodies import FreeBodies
from .planar import PlanarBodies
from .system import Array, System


def are_lengths(system: System) -> Array:
    """Return which velocities are those of lengths and not of angles, shape (nv,) of bool.

    Of a `LagrangianSystem`, which does not know, and of systems of other kinds all are.
    """
    if isinstance(system, BlockSystem):
        return np.concatenate([are_lengths(part) for part in system.parts])
    if isinstance(system, ArticulatedSystem):
        return _of_joints(system)
    kind: Sequence[bool] = [True]
    if isinstance(system, PlanarBodies):
        kind = [True, True, False]
    elif isinstance(system, FreeBodies):
        kind = [True] * 3 + [False] * 3
    return np.tile(np.array(kind), system.nv // len(kind))


def _of_joints(system: ArticulatedSystem) -> Array:
    model, found = system.model, np.zeros(system.nv, bool)
    neutral = pin.neutral(model)
    for joint in list(model.joints)[1:]:
        # a screw turns as well
        here = joint.createData()
        joint.calc(here, neutral)
        turns = np.abs(np.asarray(here.S).reshape(6, -1)[3:]).max(axis=0) > 0.0
        found[joint.idx_v : joint.idx_v + joint.nv] = ~turns
    return found


def velocity_units(system: System, length: float) -> Array:
    """Return what velocities are measured in: a length for each that is one of lengths, 1 rad for the others."""
    return np.where(are_lengths(system), length, 1.0)

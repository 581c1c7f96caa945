"""The parts that a system consists of, which of its velocities belong together, and their units."""

from __future__ import annotations

import numpy as np

from .system import Array, System


def parts_of(system: System) -> tuple[System, ...]:
    """Return the mechanisms, bodies and spheres that a system consists of, in the order of q and v."""
    return tuple(part.system for part in system.located_parts())


def independent_parts(system: System) -> Array:
    """Return which mechanism, free body or group of these each velocity belongs to, shape (nv,), the last largest."""
    parts, count = [], 0
    for one in parts_of(system):
        bodies = one.independent_bodies
        parts.append(count + np.repeat(np.arange(bodies), one.nv // bodies))
        count += bodies
    found = np.concatenate(parts)
    for columns in system.coupled():
        # what equalities connect does not move independently
        found[np.isin(found, found[columns])] = found[columns].max()
    return found


def velocity_units(system: System, length: float) -> Array:
    """Return the unit of each velocity: the scene's length where it is that of a length, 1 rad for the others."""
    return np.where(system.are_lengths(), length, 1.0)

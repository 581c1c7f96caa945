"""The parts that a system consists of, which of its velocities belong together, and their units."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np

from .mechanisms import coordinates
from .system import Array, System, located_parts

_first_components: WeakKeyDictionary[System, Array] = WeakKeyDictionary()


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


def first_components(system: System) -> Array:
    """Return the first component of the vector of space that each velocity is one of, shape (nv,) of int.

    Components of a vector follow each other, and have the same reach. They are those of the velocity and the rotation
    of what moves freely; other velocities are vectors of their own.
    """
    found = _first_components.get(system)
    if found is None:
        found = _first_components[system] = np.concatenate([p.v + _of_part(p.system) for p in located_parts(system)])
    return found


def _of_part(system: System) -> Array:
    if system.model is not None:
        return coordinates.first_components(system.model)
    every = np.arange(system.nv)
    if not system.free_bodies:
        return every
    # each body has the components of its velocity, then those of its rotation
    turns = ~system.are_lengths()
    begins = every % (system.nv // system.independent_bodies) == 0
    begins[1:] |= turns[1:] & ~turns[:-1]
    return np.asarray(np.maximum.accumulate(np.where(begins, every, 0)))


def velocity_units(system: System, length: float) -> Array:
    """Return the unit of each velocity: the scene's length where it is that of a length, 1 rad for the others."""
    return np.where(system.are_lengths(), length, 1.0)

"""How far closed loops are from a dead centre, where the rank of their equalities drops."""

from __future__ import annotations

import numpy as np

from ..system import Array, System
from .articulated import ArticulatedSystem


def with_equalities(system: System) -> list[tuple[ArticulatedSystem, slice]]:
    """Return the mechanisms of a system that have equalities, each with where its q begins and ends."""
    found: list[tuple[System, slice]]
    if system.whole is not None:
        found = [(system.whole, slice(0, system.nq))]
    else:
        found = [(part.system, slice(part.q, part.q + part.system.nq)) for part in system.located_parts()]
    return [(part, where) for part, where in found if isinstance(part, ArticulatedSystem) and part.equalities]


def loop_margins(system: System, q: Array) -> Array:
    """Return the margin of each equality at q: the part of its gradient that those before it leave, shape (m,).

    Parts are in the kinetic metric: 1 of a gradient that is orthogonal to all before it. Near a dead centre one of them
    is proportional to the distance. Equalities that depend on others have the margin 1.
    """
    found = [np.zeros(0)]
    for part, where in with_equalities(system):
        R = part.metric(q[where]).triangle
        left = R.diagonal()
        found.append(np.divide(left, np.linalg.norm(R, axis=1), out=np.ones(len(R)), where=left > 0.0))
    return np.concatenate(found)


def widest_open(system: System, q: Array) -> str:
    """Return the connection or coupling that is farthest from closed at q, and by how much [m or rad]."""
    parts = [(part, q[where]) for part, where in with_equalities(system)]
    part, place = max(parts, key=lambda one: float(np.abs(one[0].gaps(one[1])).max()))
    return f"{part.widest_open(place)} is open by {np.abs(part.gaps(place)).max():.3g}"

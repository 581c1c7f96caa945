"""The table of the free bodies of a system, as kernels take it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...compiled import record
from ..system import Array, System
from .bodies import FreeBodies, Spheres


@record("i8[::1], i8[::1], f8[::1], f8[:,:,::1], f8[:,:,::1], b1[::1], i8[::1]")
class FreeBodyTable(NamedTuple):
    """The free bodies of a system.

    Attributes
    ----------
    q, v : ndarray of int, shape (n,)
        Where the coordinates of each begin in q, and in v.
    mass : ndarray, shape (n,)
        Masses [kg].
    inertia, inverse : ndarray, shape (n, 3, 3)
        Inertias about the centre in the body's axes, and their inverses; zero of bodies that do not turn.
    turns : ndarray of bool, shape (n,)
        Which have rotations.
    owner : ndarray of int, shape (nv,)
        The body that each velocity is of, -1 of others.
    """

    q: Array
    v: Array
    mass: Array
    inertia: Array
    inverse: Array
    turns: Array
    owner: Array


def free_body_table(system: System) -> FreeBodyTable:
    """Return the table of a system; bodies that move in a plane, or are connected to others, are not in it."""
    q: list[int] = []
    v: list[int] = []
    masses, inertias, turns, owner = [np.zeros(0)], [np.zeros((0, 3, 3))], [], np.full(system.nv, -1)
    for part in system.located_parts():
        bodies = part.system
        # of classes derived from these q or v may differ
        if type(bodies) is not FreeBodies and type(bodies) is not Spheres:
            continue
        n, wide = bodies.independent_bodies, (7, 6) if isinstance(bodies, FreeBodies) else (3, 3)
        owner[part.v : part.v + wide[1] * n] = len(q) + np.repeat(np.arange(n), wide[1])
        q += (part.q + wide[0] * np.arange(n)).tolist()
        v += (part.v + wide[1] * np.arange(n)).tolist()
        masses.append(bodies.masses)
        inertias.append(bodies.inertias if isinstance(bodies, FreeBodies) else np.zeros((n, 3, 3)))
        turns += [isinstance(bodies, FreeBodies)] * n
    columns, mass = np.concatenate([np.zeros(0, np.int64), *system.coupled()]), np.concatenate(masses)
    free = ~np.isin(np.arange(len(mass)), owner[columns])
    number = np.where(free, np.cumsum(free) - 1, -1)
    owner = np.where(owner >= 0, number[owner], -1) if len(number) else owner
    inertia, turning = np.concatenate(inertias)[free], np.array(turns, bool)[free]
    inverse = np.zeros(inertia.shape)
    inverse[turning] = np.linalg.inv(inertia[turning])
    first_q, first_v = np.array(q, np.int64)[free], np.array(v, np.int64)[free]
    return FreeBodyTable(first_q, first_v, mass[free], inertia, inverse, turning, owner)

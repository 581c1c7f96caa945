"""The table of the free bodies of a system, as kernels take it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ...compiled import record
from ..system import Array, System
from .bodies import FreeBodies, Spheres
from .spinning import free_links


@record("i8[::1], i8[::1], f8[::1], f8[:,:,::1], f8[:,:,::1], b1[::1], i8[::1], b1[::1], f8[:,::1]")
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
    turning : ndarray of bool, shape (n,)
        Whose linear velocity is that of an origin, in the body's axes: a robot that is one free link.
    centre : ndarray, shape (n, 3)
        From there to the centre of mass in the body's axes [m]; zero of others.
    """

    q: Array
    v: Array
    mass: Array
    inertia: Array
    inverse: Array
    turns: Array
    owner: Array
    turning: Array
    centre: Array


def free_body_table(system: System) -> FreeBodyTable:
    """Return the table of a system; bodies that move in a plane, or are connected to others, are not in it."""
    found: list[tuple[int, int, float, Array, bool, bool, Array]] = []
    owner, none = np.full(system.nv, -1), np.zeros(3)
    coupled = {column for columns in system.coupled() for column in columns.tolist()}
    for part in system.located_parts():
        bodies, own = part.system, []
        # of classes derived from these q or v may differ
        if type(bodies) is FreeBodies:
            each = enumerate(zip(bodies.masses, bodies.inertias, strict=True))
            own = [(part.q + 7 * k, part.v + 6 * k, mass, inertia, True, False, none) for k, (mass, inertia) in each]
        elif type(bodies) is Spheres:
            balls = enumerate(bodies.masses)
            own = [(part.q + 3 * k, part.v + 3 * k, mass, np.zeros((3, 3)), False, False, none) for k, mass in balls]
        elif bodies.model is not None and is_one_link(bodies.model):
            body = bodies.model.inertias[1]
            own = [(part.q, part.v, body.mass, body.inertia, True, True, body.lever)]
        for one in own:
            columns = range(one[1], one[1] + (6 if one[4] else 3))
            if coupled.isdisjoint(columns):
                owner[columns.start : columns.stop] = len(found)
                found.append(one)
    q, v, mass, inertia, turns, turning, centre = zip(*found, strict=True) if found else ((),) * 7
    inertias, rotates = np.array(inertia, float).reshape(-1, 3, 3), np.array(turns, bool)
    inverse = np.zeros(inertias.shape)
    inverse[rotates] = np.linalg.inv(inertias[rotates])
    return FreeBodyTable(
        np.array(q, np.int64), np.array(v, np.int64), np.array(mass, float), inertias, inverse, rotates, owner,
        np.array(turning, bool), np.array(centre, float).reshape(-1, 3),
    )  # fmt: skip


def is_one_link(model: pin.Model) -> bool:
    """Return whether a robot is one free link whose base has the world's axes."""
    return (
        model.njoints == 2
        and model.joints[1].shortname() == "JointModelFreeFlyer"
        and bool(model.jointPlacements[1].isIdentity(0.0))
        and len(free_links(model).first) == 1
    )

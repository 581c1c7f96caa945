"""The table of the free bodies of a system, as kernels take it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin
from scipy.sparse import block_diag, csr_array, eye_array

from ...compiled import record
from ..system import Array, Part, System
from .bodies import FreeBodies, Spheres
from .planar import PlanarBodies, PlanarSpheres
from .spinning import free_links


@record("i8[::1], i8[::1], f8[::1], f8[:,:,::1], f8[:,:,::1], b1[::1], i8[::1], b1[::1], f8[:,::1]")
class FreeBodyTable(NamedTuple):
    """The free bodies of a system.

    Attributes
    ----------
    q, v : ndarray of int, shape (n,)
        Where the coordinates of each begin in q, and in v; of problems with bodies in a plane in the velocities in
        space, see `velocities_in_space`.
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


# mass, inertia, whether it turns, whether its linear velocity is that of an origin, and its centre from there
_Body = tuple[float, Array, bool, bool, Array]


def free_body_table(system: System) -> FreeBodyTable:
    """Return the table of a system; bodies that are connected to others are not in it."""
    q: list[int] = []
    v: list[int] = []
    found: list[_Body] = []
    coupled = {column for columns in system.coupled() for column in columns.tolist()}
    owner: list[int] = []
    for part in system.located_parts():
        each, place = _bodies_of(part), part.q
        nv = part.system.nv // max(len(each), 1)
        for k, body in enumerate(each):
            columns = 6 if body[2] else 3
            free = coupled.isdisjoint(range(part.v + k * nv, part.v + (k + 1) * nv))
            if free:
                q.append(place)
                v.append(len(owner))
                found.append(body)
            owner += columns * [len(found) - 1 if free else -1]
            place += 7 if body[2] else 3
        owner += [] if each else part.system.nv * [-1]
    mass, inertia, turns, turning, centre = zip(*found, strict=True) if found else ((),) * 5
    inertias, rotates = np.array(inertia, float).reshape(-1, 3, 3), np.array(turns, bool)
    inverse = np.zeros(inertias.shape)
    inverse[rotates] = np.linalg.inv(inertias[rotates])
    return FreeBodyTable(
        np.array(q, np.int64), np.array(v, np.int64), np.array(mass, float), inertias, inverse, rotates,
        np.array(owner, np.int64), np.array(turning, bool), np.array(centre, float).reshape(-1, 3),
    )  # fmt: skip


def _bodies_of(part: Part) -> list[_Body]:
    """Return the free bodies of a part; none of a mechanism, or of a class derived from these: q or v may differ."""
    bodies, none = part.system, np.zeros(3)
    if type(bodies) is FreeBodies:
        return [(mass, own, True, False, none) for mass, own in zip(bodies.masses, bodies.inertias, strict=True)]
    if isinstance(bodies, PlanarBodies):
        # of its inertia only the moment about the normal acts
        moments = bodies.moments.tolist()
        return [(mass, own * np.eye(3), True, False, none) for mass, own in zip(bodies.masses, moments, strict=True)]
    if type(bodies) is Spheres or isinstance(bodies, PlanarSpheres):
        return [(mass, np.zeros((3, 3)), False, False, none) for mass in bodies.masses]
    if bodies.model is not None and is_one_link(bodies.model):
        body = bodies.model.inertias[1]
        return [(body.mass, body.inertia, True, True, body.lever)]
    return []


def velocities_in_space(system: System) -> csr_array | None:
    """Return the matrix that maps v to velocities of bodies in space, of orthonormal columns; None if v has these.

    Parts that do not move in a plane keep theirs.
    """
    parts, flat = [part.system for part in system.located_parts()], (PlanarBodies, PlanarSpheres)
    if not any(isinstance(part, flat) for part in parts):
        return None
    blocks = [part.in_space if isinstance(part, flat) else eye_array(part.nv) for part in parts]
    return csr_array(block_diag(blocks, format="csr"))


def is_one_link(model: pin.Model) -> bool:
    """Return whether a robot is one free link whose base has the world's axes."""
    return (
        model.njoints == 2
        and model.joints[1].shortname() == "JointModelFreeFlyer"
        and bool(model.jointPlacements[1].isIdentity(0.0))
        and len(free_links(model).first) == 1
    )

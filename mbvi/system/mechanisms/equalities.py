"""Equalities c(q) = 0 of a mechanism: points of bodies that coincide, and joints that are coupled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ...compiled import kernel, record
from .frames import cross_product, turned

Array = np.ndarray


@dataclass(frozen=True)
class PointRows:
    """Rows n . (x_b - x_a) = 0 of points x_a and x_b of two bodies, where n turns with the first.

    Attributes
    ----------
    name : str
        Of the connection.
    first, second : int
        The bodies; 0 is the world.
    points : ndarray, shape (m, 6)
        x_a in the first body's frame, then x_b in the second's [m].
    normals : ndarray, shape (m, 3)
        n in the first body's frame.
    """

    name: str
    first: int
    second: int
    points: Array
    normals: Array

    def moved_to(self, q: int, v: int, body: int) -> PointRows:
        """Return the same where q, v and bodies of the mechanism begin elsewhere."""
        first, second = (side + body if side else 0 for side in (self.first, self.second))
        return replace(self, first=first, second=second)


@dataclass(frozen=True)
class CoupledJoints:
    """The row q_a = ratio q_b + offset of two joints with one degree of freedom.

    Attributes
    ----------
    name : str
        Of the coupling.
    first, second : (int, int, int)
        Where the joint's coordinates begin in q and in v, and how many it has in q: 1, or 2 for cosine and sine. The
        second is (-1, -1, 0) where the first is held at the offset.
    ratio, offset : float
        Of the row [rad or m of the first joint].
    """

    name: str
    first: tuple[int, int, int]
    second: tuple[int, int, int]
    ratio: float
    offset: float

    def moved_to(self, q: int, v: int, body: int) -> CoupledJoints:
        """Return the same where q, v and bodies of the mechanism begin elsewhere."""
        (i, j, width), (k, m, others) = self.first, self.second
        second = (k + q, m + v, others) if others else self.second
        return replace(self, first=(i + q, j + v, width), second=second)


Equality = PointRows | CoupledJoints

# see `Equalities`
EACH_ITS_OWN, FIRST_FINDS, FOUND = range(3)


@record(
    "i8[:,::1], f8[:,::1], f8[:,::1], i8[:,::1], f8[:,::1], f8[::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[::1],"
    " f8[::1], f8[:,::1], i8[::1]"
)
class Equalities(NamedTuple):
    """The equalities of a mechanism as arrays, and room for one that works on them.

    Attributes
    ----------
    bodies : ndarray of int, shape (k, 2)
        Of each row of points its bodies.
    points, normals : ndarray, shapes (k, 6) and (k, 3)
        See `PointRows`.
    joints : ndarray of int, shape (j, 6)
        Of each coupling both joints; see `CoupledJoints`.
    ratios : ndarray, shape (j, 2)
        Ratios and offsets.
    gap : ndarray, shape (m,)
        Receives c(q) of all rows, m = k + j.
    L, R : ndarray, shapes (nv + m, nv) and (m, m)
        Room for the factor of M and of J_e; see `span_equalities`.
    kept : ndarray, shape (nv + m, nv)
        Room for the mass matrix.
    moved : ndarray, shape (nv,)
        Room for a displacement.
    place : ndarray, shape (nq,)
        Room for a configuration.
    found : ndarray, shape (nv, nv) or (0, 0)
        Where Pinocchio leaves M, if Pinocchio computes it.
    shared : ndarray of int, shape (1,)
        Whether L and R serve several closings: EACH_ITS_OWN, FIRST_FINDS them, or FOUND.
    """

    bodies: Array
    points: Array
    normals: Array
    joints: Array
    ratios: Array
    gap: Array
    L: Array
    R: Array
    kept: Array
    moved: Array
    place: Array
    found: Array
    shared: Array


def equalities_of(rows: Sequence[Equality], nq: int, nv: int, found: Array | None = None) -> Equalities:
    """Return the record of some equalities, with room of its own; of none, with no room.

    Parameters
    ----------
    rows : sequence of PointRows or CoupledJoints
        The equalities.
    nq, nv : int
        Sizes of q and v.
    found : ndarray, optional
        See `Equalities`.
    """
    points = [one for one in rows if isinstance(one, PointRows)]
    joints = [one for one in rows if isinstance(one, CoupledJoints)]
    bodies = [(one.first, one.second) for one in points for _ in one.normals]
    m = len(bodies) + len(joints)
    n = nv if m else 0
    return Equalities(
        np.array(bodies, dtype=np.int64).reshape(-1, 2),
        np.concatenate([np.zeros((0, 6)), *(one.points for one in points)]),
        np.concatenate([np.zeros((0, 3)), *(one.normals for one in points)]),
        np.array([(*one.first, *one.second) for one in joints], dtype=np.int64).reshape(-1, 6),
        np.array([(one.ratio, one.offset) for one in joints], dtype=float).reshape(-1, 2),
        np.zeros(m), np.zeros((n + m, n)), np.zeros((m, m)), np.zeros((n + m, n)),
        np.zeros(n), np.zeros(nq if m else 0), np.zeros((0, 0)) if found is None or not m else found,
        np.zeros(1, np.int64),
    )  # fmt: skip


@kernel("f8(f8[::1], i8, i8)")
def joint_value(q: Array, first: int, count: int) -> float:
    """Return the coordinate of a joint, where q has it as one number or as cosine and sine."""
    return q[first] if count == 1 else np.arctan2(q[first + 1], q[first])


@kernel("f8(Equalities, f8[:,:,::1], f8[::1])")
def write_gaps(e: Equalities, poses: Array, q: Array) -> float:
    """Write c(q), where bodies have these poses, shape (n, 4, 3); return the largest |c|, or NaN.

    What is returned is relative to the numbers that c is the difference of, where these are above 1 m or 1 rad.
    """
    largest, m = 0.0, len(e.normals)
    for i in range(m):
        a, b, value, size = poses[e.bodies[i, 0]], poses[e.bodies[i, 1]], 0.0, 1.0
        for r in range(3):
            apart, normal = b[3, r] - a[3, r], 0.0
            for c in range(3):
                apart += b[c, r] * e.points[i, 3 + c] - a[c, r] * e.points[i, c]
                normal += a[c, r] * e.normals[i, c]
            value, size = value + normal * apart, max(size, abs(a[3, r]), abs(b[3, r]))
        e.gap[i] = value
        # written so that a NaN stays
        if not abs(value) <= largest * size:
            largest = abs(value) / size
    for j in range(len(e.joints)):
        one, value = e.joints[j], -e.ratios[j, 1]
        place = joint_value(q, one[0], one[2])
        value, size = value + place, max(1.0, abs(place))
        if one[5] > 0:
            value -= e.ratios[j, 0] * joint_value(q, one[3], one[5])
        if one[2] == 2 or one[5] == 2:
            # an angle of cosine and sine has no number of turns
            value -= 2.0 * np.pi * np.round(value / (2.0 * np.pi))
        e.gap[m + j] = value
        if not abs(value) <= largest * size:
            largest = abs(value) / size
    return largest


@kernel("void(Equalities, f8[:,:,::1], f8[:,::1], f8[:,::1], f8[:,::1])")
def write_rows(e: Equalities, poses: Array, columns: Array, support: Array, mass: Array) -> None:
    """Write J_e behind the mass matrix, shape (nv + m, nv); the other arguments are those of `Mechanism`."""
    n, m, count = mass.shape[1], len(e.normals), 0
    moving, side = np.empty(n, np.int64), np.empty(n)
    for i in range(m):
        first, second = e.bodies[i]
        a, b, row = poses[first], poses[second], mass[n + i]
        # rows of one connection move with the same few velocities
        if i == 0 or first != e.bodies[i - 1, 0] or second != e.bodies[i - 1, 1]:
            count = 0
            for k in range(n):
                if support[second, k] != support[first, k]:
                    moving[count], side[count] = k, support[second, k] - support[first, k]
                    count += 1
        point, normal = e.points[i], e.normals[i]
        x, y, z = turned(b, point[3], point[4], point[5])
        u, v, w = turned(a, normal[0], normal[1], normal[2])
        # n . (velocity of that point on the second body less that of the same point on the first)
        d, f, g = cross_product(x + b[3, 0], y + b[3, 1], z + b[3, 2], u, v, w)
        for k in range(n):
            row[k] = 0.0
        for c in range(count):
            s = columns[moving[c]]
            row[moving[c]] = side[c] * (u * s[0] + v * s[1] + w * s[2] + d * s[3] + f * s[4] + g * s[5])
    for j in range(len(e.joints)):
        one, row = e.joints[j], mass[n + m + j]
        for k in range(n):
            row[k] = 0.0
        row[one[1]] = 1.0
        if one[5] > 0:
            row[one[4]] -= e.ratios[j, 0]

"""The active constraints at one (t, q) as arrays, and the least that a user's constraint provides."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
from scipy.sparse import csr_array

from ..compiled import kernel, plain_array
from ..projection.row_speeds import times
from ..system.free.sparse_rows import stack_rows, take_rows
from . import tangents as tangent_rows
from .tangents import Tangents

Array = np.ndarray

# square of the angle between normals of one surface, and of the cosine between gradients of one pair of bodies
_SAME_NORMAL, _SAME_BODIES = 1e-12, 0.8
# difference of two distances that are equal up to rounding, as a share of the coordinates of their ends
_EQUAL = 1e-9
# point and normal of a row that is no contact, such as a joint limit
NO_POINT = np.full(3, np.nan)


class Rows(NamedTuple):
    """Active rows: gaps, gradients J(q), restitution and contact points.

    Attributes
    ----------
    constraint : ndarray of int, shape (k,)
        Which constraint each row belongs to; a flat face gives several rows of one.
    gap : ndarray, shape (k,)
        f, negative where penetrated [m or rad].
    jacobian : ndarray or csr_array, shape (k, nv)
        grad f in the tangent space; sparse where there are many bodies.
    restitution : ndarray, shape (k,)
        e of each row; NaN where the problem's own applies.
    point, normal : ndarray, shape (k, 3)
        Contact point [m] and unit normal in the world; see `Contact`; NaN where the constraint is no contact.
    rate : ndarray, shape (k,), or None
        df/dt at a fixed q, due to walls with a prescribed motion [m/s, rad/s]: a gap changes at J v + rate. None if no
        row has any.
    tangents : Tangents or None
        Friction of all rows; None where no constraint of the problem has friction.
    """

    constraint: Array
    gap: Array
    jacobian: Array | csr_array
    restitution: Array
    point: Array
    normal: Array
    rate: Array | None = None
    tangents: Tangents | None = None

    def speeds(self, v: Array) -> Array:
        """Return the rates of the gaps at a velocity, J v + rate, shape (k,) [m/s, rad/s]."""
        speeds = times(self.jacobian, v)
        return speeds if self.rate is None else speeds + self.rate


def take(rows: Rows, index: Array) -> Rows:
    """Return some of the rows, by a mask or by their indices."""
    number, gap, jacobian, e, point, normal, rate, tangents = rows
    return Rows(
        number[index],
        gap[index],
        take_rows(jacobian, index),
        e[index],
        point[index],
        normal[index],
        None if rate is None else rate[index],
        None if tangents is None else tangents.take(index),
    )


def concatenate(parts: Sequence[Rows]) -> Rows:
    """Return the rows of all parts, one part after the other."""
    if len(parts) == 1:
        return parts[0]
    number, gap, jacobian, restitution, point, normal, rate, tangents = zip(*parts, strict=True)
    rates = None
    if any(one is not None for one in rate):
        rates = np.concatenate([np.zeros(len(part.gap)) if part.rate is None else part.rate for part in parts])
    return Rows(
        np.concatenate(number),
        np.concatenate(gap),
        stack_rows(list(jacobian)),
        np.concatenate(restitution),
        np.concatenate(point),
        np.concatenate(normal),
        rates,
        None if tangents[0] is None else tangent_rows.concatenate(tangents),
    )


@kernel("void(i8[::1], f8[:,::1], i8[::1], f8[:,::1], i8[::1], i8[::1])")
def mutual_nearest(number: Array, point: Array, others: Array, places: Array, order: Array, owner: Array) -> None:
    """Find for each contact the same one among others: of the same number, and each is the nearest to the other.

    Parameters
    ----------
    number, others : ndarray of int, shapes (k,) and (m,)
        Constraints of the contacts.
    point, places : ndarray, shapes (k, 3) and (m, 3)
        Contact points [m]; distances that are NaN, as of joint limits, count as zero.
    order : ndarray of int, shape (m,)
        The order in which `others` ascends.
    owner : ndarray of int, shape (k,)
        Receives the index of each contact among the others, -1 where it is not among them. Of several that are equally
        near, up to rounding, each contact in turn takes the first in that order that is left.
    """
    k, m = len(number), len(others)
    least, nearest, left = np.full(k, np.inf), np.full(m, np.inf), np.ones(m, np.bool_)
    # the least distances of all are known before one is chosen: which of two equal ones is less is rounding
    for choose in range(2):
        for i in range(k):
            first, end = 0, m
            while first < end:
                half = (first + end) // 2
                if others[order[half]] < number[i]:
                    first = half + 1
                else:
                    end = half
            owner[i] = -1
            while first < m and others[order[first]] == number[i] and owner[i] < 0:
                j, square, size = order[first], 0.0, 0.0
                for axis in range(3):
                    square += (point[i, axis] - places[j, axis]) ** 2
                    size = max(size, abs(point[i, axis]) + abs(places[j, axis]))
                apart, rounding = np.sqrt(square), _EQUAL * size
                if np.isnan(apart):
                    apart = rounding = 0.0
                if choose == 0:
                    least[i], nearest[j] = min(least[i], apart), min(nearest[j], apart)
                elif left[j] and apart - min(least[i], nearest[j]) <= rounding:
                    owner[i], left[j] = j, False
                first += 1


def match_contacts(rows: Rows, others: Rows) -> Array:
    """Return for each row the index of the same contact among the others, shape (k,); -1 where there is none.

    Two rows are the same contact if they are of one constraint and each is the nearest to the other; see
    `mutual_nearest`.
    """
    owner = np.empty(len(rows.gap), np.int64)
    order = others.constraint.argsort(kind="stable")
    mutual_nearest(rows.constraint, rows.point, others.constraint, others.point, order, owner)
    return owner


@kernel("b1(f8[::1], f8[::1], f8[::1], f8[::1])")
def goes_on(normal: Array, other_normal: Array, gradient: Array, other_gradient: Array) -> bool:
    """Return whether two contacts push the same bodies in the same direction, as those on both sides of a joint do."""
    along = across = product = own = others = 0.0
    for k in range(3):
        along += normal[k] * other_normal[k]
        across += (normal[k] - other_normal[k]) ** 2
    for k in range(len(gradient)):
        product += gradient[k] * other_gradient[k]
        own += gradient[k] * gradient[k]
        others += other_gradient[k] * other_gradient[k]
    return along > 0.0 and across <= _SAME_NORMAL and product > 0.0 and product * product >= _SAME_BODIES * own * others


@kernel("i8(i8, f8[::1], f8[::1], f8[::1], i8[::1], f8[:,::1], f8[:,::1], f8[:,::1], i8[::1], f8)")
def nearest_going_on(
    number: int, point: Array, normal: Array, gradient: Array, numbers: Array, points: Array, normals: Array,
    gradients: Array, owner: Array, reach: float,
) -> int:  # fmt: skip
    """Return the nearest other contact that goes on from one and is not in `owner`, -1 if none; see `goes_on`.

    Of the same constraint none farther than `reach` goes on: those are other corners of the same shapes.
    """
    best, nearest = -1, np.inf
    for b in range(len(points)):
        distance = 0.0
        for k in range(3):
            distance += (points[b, k] - point[k]) ** 2
        free = distance < nearest and (numbers[b] != number or distance <= reach * reach)
        for c in range(len(owner)):
            free = free and owner[c] != b
        if free and goes_on(normal, normals[b], gradient, gradients[b]):
            best, nearest = b, distance
    return best


def points_going_on(rows: Rows, others: Rows, owner: Array, reach: float) -> Array:
    """Return the points of rows, or of what `nearest_going_on` finds for each among the others, shape (k, 3)."""
    point, J, K = rows.point.copy(), rows.jacobian, others.jacobian
    # among many bodies, whose rows are sparse, this takes too long
    if isinstance(J, np.ndarray) and isinstance(K, np.ndarray):
        found = others.constraint, plain_array(others.point), plain_array(others.normal), plain_array(K), owner, reach
        for a, number in enumerate(rows.constraint.tolist()):
            b = nearest_going_on(number, rows.point[a], rows.normal[a], J[a], *found)
            point[a] = others.point[b] if b >= 0 else point[a]
    return point


def renewed(marks: Rows, rows: Rows, owner: Array) -> Rows:
    """Return marks with rows in the place of those that they belong to; `owner`, shape (k,), is -1 for none."""
    index, found = np.arange(len(marks.gap)), np.flatnonzero(owner >= 0)
    index[owner[found]] = len(index) + found
    return take(concatenate([marks, rows]), index)


class Constraint(Protocol):
    """The least that a user's constraint provides.

    Optional are also `names` or `name(k)`, `size`, `restitution`, `rate(t, q)` and, for friction, `tangents(t, q)`;
    see `GivenConstraint`.

    A constraint that provides more must derive from `ConstraintFamily`.
    """

    def gap(self, t: float, q: Array) -> Array | float:
        """Return f at (t, q): a number, or shape (m,)."""
        ...

    def gradient(self, t: float, q: Array) -> Array:
        """Return grad f in the tangent space: shape (nv,), or (m, nv)."""
        ...

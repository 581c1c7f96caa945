"""Contact points that move with the bodies on which they are."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ..compiled import kernel, plain_array
from .admissible_set import AdmissibleSet
from .family import ConstraintFamily
from .rows import Array, Rows
from .tangents import Tangents


class Place(NamedTuple):
    """A time [s] and a configuration, shape (nq,)."""

    t: float
    q: Array


def carried(constraints: AdmissibleSet, numbers: Array, point: Array, before: Place, after: Place) -> Array:
    """Return where both bodies of some constraints carry points, those of the first and of the second, shape (2, k, 3).

    Parameters
    ----------
    constraints : AdmissibleSet
        The constraints.
    numbers : ndarray of int, shape (k,)
        Their numbers, ascending.
    point : ndarray, shape (k, 3)
        Points in the world at `before` [m]; those of constraints that have no bodies stay.
    before, after : Place
        From where to where the bodies move.
    """
    found = np.array([point, point])
    for family, part, own in _by_family(constraints, numbers):
        old, new = (family.poses_of(own, *place) for place in (before, after))
        if old is not None and new is not None:
            for side in range(2):
                carry_points(point[part], old[side], new[side], found[side, part])
    return found


def carried_along(constraints: AdmissibleSet, rows: Rows, before: Place, after: Place) -> Rows:
    """Return rows with their points midway between where both bodies have carried them.

    They stay where one body is the world, and go with walls that move. What has the nearest points then is the same for
    each observer in uniform motion, and in whatever order bodies are numbered. `before` is where the points are.
    """
    order = rows.constraint.argsort(kind="stable")
    point, at = rows.point.copy(), plain_array(rows.point[order])
    first, second = carried(constraints, rows.constraint[order], at, before, after)
    moved = 0.5 * (first + second)
    for family, part, own in _by_family(constraints, rows.constraint[order]):
        # of walls that move the first body is the wall, which is no body of the world
        if family.moving:
            moved[part] = first[part]
        elif type(family).bodies_of is not ConstraintFamily.bodies_of:
            at_rest = (np.array(family.bodies_of(own)) == 0).any(axis=0)
            moved[part][at_rest] = at[part][at_rest]
    point[order] = moved
    return rows._replace(point=point)


def with_mean_rates(constraints: AdmissibleSet, rows: Rows, t: float, q: Array, h: float) -> Rows:
    """Return rows of walls that move with the mean velocities of the walls in a step, to second order.

    Constraints that have no bodies keep the rates that they have at its begin. Along a normal a wall that turns has the
    least rate of those of a contact that it carries, and of one that stays where it is.

    Parameters
    ----------
    constraints : AdmissibleSet
        The constraints.
    rows : Rows
        Rows at (t, q), where the step begins.
    t, q, h
        Time [s] and configuration there, and the length of the step [s].
    """
    if rows.rate is None:
        return rows
    order, rate, tangents = rows.constraint.argsort(kind="stable"), rows.rate.copy(), rows.tangents
    if tangents is not None and tangents.rate is not None:
        tangents = tangents._replace(rate=tangents.rate.copy())
    for family, part, _ in _by_family(constraints, rows.constraint[order]):
        if family.frame is not None:
            some = order[part]
            velocity, spin = family.frame.motion_after(0.5 * h, rows.point[some], t, q)
            # the points of a roller move away below the contact, and others take their place: it has no motion along
            # its normals. Whether the contact moves with the wall is not known here: a rate that is too low leaves a
            # gap, with one too high a body would fall all the time and never arrive
            rate[some] = np.minimum(
                -np.vecdot(rows.normal[some], velocity), family.frame.rate(rows.point[some], rows.normal[some])
            )
            # tangents of rows without friction are zero
            if tangents is not None and tangents.friction[some].any():
                _set_rates(tangents, rows.normal, some, velocity, spin)
    return rows._replace(rate=rate, tangents=tangents)


def _set_rates(tangents: Tangents, normal: Array, some: Array, velocity: Array, spin: Array) -> None:
    """Set the rates of the tangents of some rows whose walls have given velocities and a spin; see `Tangents`."""
    assert tangents.rate is not None
    rate, axes = tangents.rate.reshape(-1, tangents.width), tangents.axes[some]
    rate[some, :2] = -np.vecdot(axes, velocity[:, None])
    if tangents.resistance is not None:
        about = np.concatenate([normal[some, None], axes], axis=1)
        rate[some, 2:] = np.where(tangents.resistance[some].any(axis=1)[:, None], -about @ spin, 0.0)


def _by_family(constraints: AdmissibleSet, numbers: Array) -> Iterator[tuple[ConstraintFamily, slice, Array]]:
    """Yield the families of some constraints, ascending, where these stand, and their numbers in the family."""
    begin = 0
    for family, start, _ in constraints.numbered():
        end = begin + int(numbers[begin:].searchsorted(start + family.size))
        if end > begin:
            yield family, slice(begin, end), numbers[begin:end] - start
        begin = end


@kernel("void(f8[:,::1], f8[:,:,::1], f8[:,:,::1], f8[:,::1])")
def carry_points(point: Array, old: Array, new: Array, found: Array) -> None:
    """Write where bodies carry points.

    Parameters
    ----------
    point : ndarray, shape (k, 3)
        Points [m].
    old, new : ndarray, shape (k, 4, 3)
        Poses of their bodies; see `System.placements`.
    found : ndarray, shape (k, 3)
        Receives the points [m]; it may be `point`.
    """
    local = np.empty(3)
    for k in range(len(point)):
        for axis in range(3):
            local[axis] = 0.0
            for c in range(3):
                local[axis] += old[k, axis, c] * (point[k, c] - old[k, 3, c])
        for c in range(3):
            found[k, c] = new[k, 3, c]
            for axis in range(3):
                found[k, c] += local[axis] * new[k, axis, c]

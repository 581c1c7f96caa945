"""Contact points that move with the bodies on which they are."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..compiled import kernel
from .admissible_set import AdmissibleSet
from .family import ConstraintFamily
from .rows import Array, Rows


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
    found, begin = np.array([point, point]), 0
    for family, start, _ in constraints.numbered():
        end = begin + int(numbers[begin:].searchsorted(start + family.size))
        if end == begin:
            continue
        own = numbers[begin:end] - start
        old, new = (family.poses_of(own, *place) for place in (before, after))
        if old is not None and new is not None:
            some = np.empty((2, end - begin, 3))
            carry_points(point[begin:end], old, new, some)
            found[:, begin:end] = some
        begin = end
    return found


def carried_along(constraints: AdmissibleSet, rows: Rows, before: Place, after: Place) -> Rows:
    """Return rows with their points where the first bodies have carried them; they stay where one body is the world.

    So that what has the nearest points is the same for each observer in uniform motion. `before` is where the points
    are.
    """
    order = rows.constraint.argsort(kind="stable")
    numbers, point, begin = rows.constraint[order], rows.point.copy(), 0
    moved = carried(constraints, numbers, point[order], before, after)[0]
    for family, start, _ in constraints.numbered():
        end = begin + int(numbers[begin:].searchsorted(start + family.size))
        if end > begin and type(family).bodies_of is not ConstraintFamily.bodies_of and not family.moving:
            at_rest = family.bodies_of(numbers[begin:end] - start)[1] == 0
            moved[begin:end][at_rest] = point[order[begin:end][at_rest]]
        begin = end
    point[order] = moved
    return rows._replace(point=point)


@kernel("void(f8[:,::1], f8[:,:,:,::1], f8[:,:,:,::1], f8[:,:,::1])")
def carry_points(point: Array, old: Array, new: Array, found: Array) -> None:
    """Write where both bodies of contacts carry their points.

    Parameters
    ----------
    point : ndarray, shape (k, 3)
        Contact points [m].
    old, new : ndarray, shape (2, k, 4, 3)
        Poses of the first and of the second bodies; see `System.placements`.
    found : ndarray, shape (2, k, 3)
        Receives the points [m].
    """
    for side in range(2):
        for k in range(len(point)):
            for c in range(3):
                found[side, k, c] = new[side, k, 3, c]
            for axis in range(3):
                along = 0.0
                for c in range(3):
                    along += old[side, k, axis, c] * (point[k, c] - old[side, k, 3, c])
                for c in range(3):
                    found[side, k, c] += along * new[side, k, axis, c]

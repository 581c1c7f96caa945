"""Contact points that move with the bodies on which they are."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .admissible_set import AdmissibleSet
from .rows import Array


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
        Their numbers.
    point : ndarray, shape (k, 3)
        Points in the world at `before` [m]; those of constraints that have no bodies stay.
    before, after : Place
        From where to where the bodies move.
    """
    found = np.array([point, point])
    for family, start, _ in constraints.numbered():
        here = np.flatnonzero((numbers >= start) & (numbers < start + family.size))
        if not here.size:
            continue
        own = numbers[here] - start
        at_first, at_last = (family.poses_of(own, *place) for place in (before, after))
        if at_first is None or at_last is None:
            continue
        for side, old, new in zip(found, at_first, at_last, strict=True):
            # rows are the body's axes: products with them are coordinates in the body
            inside = np.matvec(old[:, :3], point[here] - old[:, 3])
            side[here] = np.vecmat(inside, new[:, :3]) + new[:, 3]
    return found

"""The percussions of the last projection, matched to the rows of the next."""

from __future__ import annotations

import numpy as np

from .dense.scaled_qp import ScaledQP, WarmStart
from .metric import Array

# contact points of one constraint with keys of their own; further points share the last key
_POINTS = 64
# most rows without keys whose percussions are kept: as many as the compiled loop has room for
MOST_KEPT = 400


class LastPercussions:
    """Percussions of the last projection, found again by the index of a row, or by its key if rows have keys.

    Attributes
    ----------
    percussion : ndarray, shape (m,)
        Percussions of the last projection; empty at first.
    keys : ndarray of int, shape (m,), or None
        Ascending keys of their contacts (`contact_keys`); None if rows have no keys.
    """

    __slots__ = ("keys", "percussion")

    def __init__(self) -> None:
        self.percussion = np.zeros(0)
        self.keys: Array | None = None

    def start(self, qp: ScaledQP, keys: Array | None) -> WarmStart | None:
        """Return the scaled start of a projection, or None if there are no last percussions for its rows."""
        found = self._matched(len(qp.lower), keys)
        return None if found is None else WarmStart(found * qp.lengths / qp.scale)

    def _matched(self, m: int, keys: Array | None) -> Array | None:
        """Return the last percussion of each row, None if there is none."""
        if keys is None or self.keys is None:
            unnamed = keys is None and self.keys is None
            return self.percussion if unnamed and len(self.percussion) == m else None
        place = np.searchsorted(self.keys, keys)
        place[place == len(self.keys)] = 0
        return np.where(self.keys[place] == keys, self.percussion[place], 0.0)

    def of_contacts(self, keys: Array) -> tuple[Array, Array]:
        """Return the last percussions of contacts with three each, shape (3 m,), and which of them are known."""
        if self.keys is None or not len(self.keys):
            return np.zeros(3 * len(keys)), np.zeros(len(keys), bool)
        place = np.searchsorted(self.keys, keys)
        place[place == len(self.keys)] = 0
        known = self.keys[place] == keys
        return np.where(known[:, None], self.percussion[place], 0.0).ravel(), known

    def keep(self, percussion: Array, keys: Array | None) -> None:
        """Keep the percussions of rows with these keys, or without any."""
        if keys is None and len(percussion) > MOST_KEPT:
            percussion = percussion[:0]
        if keys is not None and (keys[1:] < keys[:-1]).any():
            order = np.argsort(keys, kind="stable")
            keys, percussion = keys[order], percussion[order]
        self.keys, self.percussion = keys, percussion


def contact_keys(constraints: Array) -> Array:
    """Return a key for each row, by which the next projection finds it again.

    The key is made of the number of the constraint and the place of the row among those of that constraint.

    Parameters
    ----------
    constraints : ndarray of int, shape (m,)
        Number of each row's constraint.
    """
    m = len(constraints)
    ascending = not (constraints[1:] < constraints[:-1]).any()
    order = None if ascending else np.argsort(constraints, kind="stable")
    numbers, place = constraints if order is None else constraints[order], np.arange(m)
    first = place.copy()
    first[1:][numbers[1:] == numbers[:-1]] = 0
    keys = numbers * _POINTS + np.minimum(place - np.maximum.accumulate(first), _POINTS - 1)
    if order is not None:
        keys[order] = keys.copy()
    return keys

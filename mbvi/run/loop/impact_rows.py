"""Finds the rows that take part in an impact, where many bodies rest on each other."""

from __future__ import annotations

from collections import deque
from itertools import islice
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from ...compiled import kernel
from ...projection.sparse.gram import islands
from ...schemes import Step
from ...schemes.contact_friction import friction_of, regime

Array = np.ndarray


@kernel("void(i8[::1], f8[::1], i8[::1], f8[::1])")
def _raise_levels(number: Array, percussion: Array, known: Array, level: Array) -> None:
    """Raise the level of each known constraint to its largest percussion.

    Parameters
    ----------
    number, percussion : ndarray, shape (k,)
        Constraints and percussions of rows; faster where constraints ascend.
    known : ndarray of int, shape (n,)
        Constraints, ascending, each once.
    level : ndarray, shape (n,)
        The largest percussion of each known constraint so far; raised in place.
    """
    k = 0
    for a in range(len(number)):
        if k > 0 and known[k - 1] >= number[a]:
            k = np.searchsorted(known, number[a])
        while k < len(known) and known[k] < number[a]:
            k += 1
        if k < len(known) and known[k] == number[a]:
            level[k] = max(level[k], percussion[a])


class LaterRows(NamedTuple):
    """Constraints and percussions of the rows of some steps, shape (k,), and how many steps."""

    number: Array
    percussion: Array
    steps: int


NO_ROWS = LaterRows(np.zeros(0, np.int64), np.zeros(0), 0)


class RecentPercussions:
    """The percussions of the last steps.

    Parameters
    ----------
    count : int
        How many steps.
    """

    def __init__(self, count: int) -> None:
        # numbers and rates of rows, and of those before them only numbers and percussions of rows that have one
        self._new: deque[tuple[Array, Array]] = deque(maxlen=count)
        self._loaded: deque[tuple[Array, Array]] = deque(maxlen=count)

    def add(self, number: Array, rates: Array) -> None:
        """Add a step: constraints and rates of its rows, shapes (m,) and (4, m)."""
        self._new.append((number, rates))

    def exceeded(self, number: Array, percussion: Array, later: LaterRows = NO_ROWS) -> Array:
        """Return which rows have a percussion above twice the largest that their constraint had in these steps.

        Parameters
        ----------
        number, percussion : ndarray, shape (k,)
            Constraints and percussions of the rows.
        later : LaterRows
            Of steps since the last one that was added.
        """
        for earlier, rates in self._new:
            loaded = rates[0] > 0.0
            self._loaded.append((earlier[loaded], rates[0, loaded]))
        self._new.clear()
        known, place = np.unique(number, return_inverse=True)
        level = np.zeros(len(known))
        left = len(self._loaded) + later.steps - (self._loaded.maxlen or 0)
        for earlier, percussions in [*islice(self._loaded, max(left, 0), None), later[:2]]:
            _raise_levels(earlier, percussions, known, level)
        return np.asarray(percussion > 2.0 * level[place])


def linked(jacobian: Array | csr_array, chosen: Array, seeds: Array, parts: Array) -> Array:
    """Return which rows are linked to a seed by a chain of rows, each acting on a part of the system with the next.

    Parameters
    ----------
    jacobian : ndarray or csr_array, shape (k, nv)
        Gradients of the rows.
    chosen : ndarray of bool, shape (k,)
        The rows that chains consist of.
    seeds : ndarray of bool, shape (k,)
        Which of them are seeds.
    parts : ndarray of int, shape (nv,)
        As returned by `independent_parts`.
    """
    rows = csr_array(jacobian)
    label = np.empty(len(chosen), np.int64)
    columns, starts = parts[rows.indices].astype(np.uint32), rows.indptr.astype(np.uint32)
    count = islands(columns, starts, int(parts[-1]) + 1, chosen & (np.diff(rows.indptr) > 0), label)
    # the last entry is for label -1: rows that are not chosen, or act on nothing
    has_seed = np.zeros(count + 1, bool)
    has_seed[label[seeds]] = True
    has_seed[-1] = False
    return np.asarray(seeds | has_seed[label])


def friction_of_impact(
    step: Step, chosen: Array
) -> tuple[Array, Array, Array, tuple[str, ...], Array, Array | None] | tuple[()]:
    """Return the last six attributes of an `Impact` on the chosen rows of a step; none without friction."""
    found = friction_of(step)
    if found is None:
        return ()
    tangential, before, after, sticks, angular = found.take(chosen)
    regimes = map(regime, sticks.tolist(), step.percussion[chosen].tolist())
    return tangential, before, after, tuple(regimes), step.active.restitution[chosen], angular

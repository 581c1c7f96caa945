"""Finds the rows that take part in an impact, where many bodies rest on each other."""

from __future__ import annotations

from collections import deque

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


class RecentPercussions:
    """The percussions of the last steps that do not belong to impacts.

    Parameters
    ----------
    count : int
        How many steps.
    """

    def __init__(self, count: int) -> None:
        # numbers and percussions of rows, and of those before them only of rows that have one
        self._new: deque[tuple[Array, Array]] = deque(maxlen=count)
        self._loaded: deque[tuple[Array, Array]] = deque(maxlen=count)
        # the constraints of the last step that took part in an impact
        self._struck = np.zeros(0, np.int64)

    def add(self, number: Array, percussion: Array, impacting: Array | None = None) -> None:
        """Add a step: constraints and percussions of its rows, shape (m,), and which of them belong to an impact.

        What a constraint has in the step after an impact may belong to that, too.
        """
        if self._struck.size:
            percussion = np.where(np.isin(number, self._struck), 0.0, percussion)
        self._struck = number[:0]
        if impacting is not None:
            self._struck, percussion = number[impacting], np.where(impacting, 0.0, percussion)
        self._new.append((number, percussion))

    def exceeded(self, number: Array, percussion: Array) -> Array:
        """Return which rows have a percussion above twice the largest that their constraint had in these steps.

        Parameters
        ----------
        number, percussion : ndarray, shape (k,)
            Constraints and percussions of the rows.
        """
        for earlier, percussions in self._new:
            loaded = percussions > 0.0
            self._loaded.append((earlier[loaded], percussions[loaded]))
        self._new.clear()
        known, place = np.unique(number, return_inverse=True)
        level = np.zeros(len(known))
        for earlier, percussions in self._loaded:
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

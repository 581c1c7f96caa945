"""Which pairs of a family must be measured: those whose clearance is used up."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...compiled import kernel
from ..rows import Array


@kernel("Tuple((i8, f8))(f8[::1], f8[:,::1], f8[::1], f8, i8[::1])")
def list_candidates(
    clearance: Array, reach: Array, travel: Array, tolerance: float, candidates: Array
) -> tuple[int, float]:
    """Take the travel from the clearances of pairs, and list the pairs whose clearance is used up.

    Parameters
    ----------
    clearance : ndarray, shape (n,)
        By how much the gap of each pair may still fall [m]; reduced by the travel.
    reach : ndarray, shape (nv, n)
        Reach of each pair: its gap falls by no more than |displacement| . reach.
    travel : ndarray, shape (nv,)
        Sum of |displacement| since the last call; zero afterwards.
    tolerance : float
        A clearance of no more than this is used up [m].
    candidates : ndarray of int, shape (n,)
        Receives these pairs, ascending, in its first places.

    Returns
    -------
    count : int
        How many candidates there are.
    least : float
        The least clearance of the other pairs, less the tolerance [m].
    """
    nv, n = reach.shape
    for k in range(nv):
        if travel[k] != 0.0:
            for i in range(n):
                clearance[i] -= travel[k] * reach[k, i]
            travel[k] = 0.0
    count, least = 0, np.inf
    for i in range(n):
        if clearance[i] <= tolerance:
            candidates[count] = i
            count += 1
        else:
            least = min(least, clearance[i] - tolerance)
    return count, least


class PairCandidates:
    """Which pairs of one family must be measured at a configuration: those whose clearance is used up.

    The clearance of a pair is its last gap, less the most by which the gap can have fallen since. That is the sum of
    reach . |displacement| over the steps since then.

    Parameters
    ----------
    count : int
        How many pairs there are.
    reach : ndarray or csr_array, shape (nv, count), optional
        Reach of each pair: its gap falls by no more than |displacement| . reach. Without it all pairs stay candidates.

    Attributes
    ----------
    reach : ndarray or csr_array, shape (nv, count), or None
        As given.
    index : ndarray of int, shape (k,)
        The candidates, ascending; the same array until it changes.
    clearance : ndarray, shape (count,)
        By how much the gap of each pair may still fall before the pair can touch [m].
    any_empty : bool
        Whether the last measurement found a candidate without a row.
    """

    def __init__(self, count: int, reach: Array | Any = None) -> None:
        self.reach, self.clearance = reach, np.empty(count)
        self.forget()

    def forget(self) -> None:
        """Make every pair a candidate."""
        self.clearance[:] = -np.inf
        self.index, self.any_empty = np.arange(len(self.clearance)), True

    def update(self, travel: Array, tolerance: float) -> float:
        """Consume the travel since the last update and list the candidates.

        Parameters
        ----------
        travel : ndarray, shape (nv,)
            Sum of |difference| over the configurations since then; zero afterwards.
        tolerance : float
            Pairs with a clearance of no more than this are candidates [m].

        Returns
        -------
        clearance : float
            The least clearance of the other pairs, less the tolerance.
        """
        if isinstance(self.reach, np.ndarray):
            index = np.empty(len(self.clearance), np.int64)
            count, least = list_candidates(self.clearance, self.reach, travel, tolerance, index)
            self.index = index[:count]
            return least
        self.clearance -= travel @ self.reach
        travel[:] = 0.0
        spent = self.clearance <= tolerance
        self.index = spent.nonzero()[0]
        return float(np.where(spent, np.inf, self.clearance).min()) - tolerance

"""Plain numpy forms of the kernels in mbvi/constraints/pairs.py."""

from __future__ import annotations

import numpy as np

from mbvi.arguments import Array


def _spend_plain(budget: Array, reach: Array, travel: Array, tolerance: float, due: Array) -> tuple[int, float]:
    """Take the travel from the budgets; return how many are spent, and the least that another has left.

    Parameters
    ----------
    budget : ndarray, shape (n,)
        What each pair's bodies may travel before they can touch [m]; changed.
    reach : ndarray, shape (nv, n)
        How far each velocity carries each pair towards each other.
    travel : ndarray, shape (nv,)
        What was travelled; zero afterwards.
    tolerance : float
        The budget that counts as spent [m].
    due : ndarray of int, shape (n,)
        Receives the pairs whose budgets are spent, ascending, in its first places.
    """
    budget -= travel @ reach
    travel[:] = 0.0
    spent = budget <= tolerance
    due[: spent.sum()] = spent.nonzero()[0]
    return int(spent.sum()), float(np.where(spent, np.inf, budget - tolerance).min(initial=np.inf))


def sift_plain(pair: Array, gap: Array, tolerance: float, budget: Array, near: Array) -> tuple[int, bool]:
    """Find the contacts within the tolerance; the budget of a pair that has none is its least gap.

    Parameters
    ----------
    pair, gap : ndarray, shape (k,)
        Contacts, pair after pair.
    tolerance : float
        Gap at and below which a contact is active [m].
    budget : ndarray, shape (n,)
        Of all pairs; written for those asked.
    near : ndarray of int, shape (k,)
        Receives which contacts are within the tolerance, in its first places.

    Returns
    -------
    count : int
        How many they are.
    vain : bool
        Whether some pair has none.
    """
    inside = gap <= tolerance
    count = int(inside.sum())
    near[:count] = inside.nonzero()[0]
    budget[pair] = np.inf
    np.minimum.at(budget, pair, gap)
    return count, bool((budget[pair] > tolerance).any())

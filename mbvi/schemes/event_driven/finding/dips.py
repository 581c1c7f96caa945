"""Finds where gaps of given functions fall through zero between the places at which a step looks at them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ....system.system import Array
from .interpolants import COARSE, FEW_NODES, interpolation_error
from .root_finding import NOISE, RESOLVED

# bound of how fast a gap falls, relative to its largest rate at the nodes
_STEEPER = 2.0
# shortest way between two places that are looked at, a share of the step: of the first ones, where functions pass zero
# closely, and of those after them, where they stay near it
_SHORTEST, _MOST_SHORT, _SHORT = 1e-4, 100, 1.0 / 128.0
# halvings of the way to a root
_HALVINGS = 40
# a root that comes no earlier than this share before a known one is that
_EARLIER = 1e-5
_LENGTHS = np.diff(FEW_NODES)[:, None]


def unresolved(known: Array) -> Array:
    """Return which functions are no polynomials of low degree, shape (k,) of bool; see `may_dip`."""
    values = np.ascontiguousarray(known)
    error = [interpolation_error(COARSE.last, values, k) for k in range(values.shape[1])]
    return np.asarray(error) > np.maximum(RESOLVED * np.abs(values).max(axis=0), NOISE)


def may_dip(known: Array, slope: Array) -> Array:
    """Return which functions may reach zero between nodes, shape (k,) of bool.

    Parameters
    ----------
    known : ndarray, shape (5, k)
        Their values at `FEW_NODES`.
    slope : ndarray, shape (k,)
        The largest of their slopes there.
    """
    return ~np.asarray((known[1:] + known[:-1] > _LENGTHS * _STEEPER * slope).all(axis=0))


def first_dip(values: Callable[[float], Array], slope: Array, known: float) -> tuple[float, int]:
    """Return where one of some functions first falls through zero well before a known root, and which.

    Without one, the known root and -1. Steps along the functions are as long as none can reach zero, if its slope is at
    most twice the given one, but not shorter than a 10,000th of [0, 1], after 100 steps than a 128th.

    Parameters
    ----------
    values : callable
        values(x) -> the functions at x in [0, 1], shape (k,).
    slope : ndarray, shape (k,)
        Slopes of the functions.
    known : float
        The first root that is known, or 1.
    """
    x, end, steepest = 0.0, known - _EARLIER, np.maximum(_STEEPER * slope, np.finfo(float).tiny)
    found, count = values(x), 0
    while x < end:
        # a function that starts below zero has no root before it rises
        above = found > 0.0
        shortest, count = _SHORTEST if count < _MOST_SHORT else _SHORT, count + 1
        ahead = min(x + max(float((found / steepest).min(initial=np.inf, where=above)), shortest), end)
        later = values(ahead)
        if (above & (later <= 0.0)).any():
            for _ in range(_HALVINGS):
                middle = 0.5 * (x + ahead)
                between = values(middle)
                if (above & (between <= 0.0)).any():
                    ahead, later = middle, between
                else:
                    x, found = middle, between
            first = int((above & (later <= 0.0)).argmax())
            # a function that jumps has no root there
            jumps = found[first] > steepest[first] * _SHORTEST
            return (known, -1) if jumps else (ahead, first)
        x, found = ahead, later
    return known, -1

"""Finds where gaps of given functions fall through zero between the places at which a step looks at them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ....system.system import Array
from .interpolants import COARSE, FEW_NODES, interpolation_error
from .root_finding import NOISE, RESOLVED, Values

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


def first_dip(values: Values, slopes: Callable[[], Array], nodes: Array, root: float) -> tuple[float, int]:
    """Return where one of some functions first falls through zero well before a known root, and which.

    Without one, the known root and -1. Functions that are polynomials of low degree have none.

    Parameters
    ----------
    values : callable
        See `first_root`.
    slopes : callable
        slopes() -> the largest slopes of all at `FEW_NODES`, shape (k,).
    nodes : ndarray, shape (5, k)
        The functions there; NaN where a function is not known.
    root : float
        The first root that is known, or 1.
    """
    nodes = np.ascontiguousarray(nodes)
    error = [interpolation_error(COARSE.last, nodes, k) for k in range(nodes.shape[1])]
    # written so that a NaN is no polynomial
    bends = ~(np.asarray(error) <= np.maximum(RESOLVED * np.abs(nodes).max(axis=0), NOISE))
    if not bends.any():
        return root, -1
    steepest = np.maximum(_STEEPER * slopes(), np.finfo(float).tiny)
    asked = bends & ~(nodes[1:] + nodes[:-1] > _LENGTHS * steepest).all(axis=0)
    if not asked.any():
        return root, -1
    which = np.flatnonzero(asked)
    x, first = _followed(lambda x: values(np.array([x]), which)[0], steepest[which], root)
    return x, int(which[first]) if first >= 0 else -1


def _followed(values: Callable[[float], Array], steepest: Array, root: float) -> tuple[float, int]:
    """Return what `first_dip` does, by steps in which no function reaches zero if none has steeper slopes.

    No step is shorter than a 10,000th of [0, 1], after 100 steps than a 128th.
    """
    x, end, count = 0.0, root - _EARLIER, 0
    found = values(x)
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
            return (root, -1) if jumps else (ahead, first)
        x, found = ahead, later
    return root, -1

"""Finds where functions on [0, 1] first become negative, from interpolants at Chebyshev points.

A root here is a place where a function falls through zero. It is exact to the rounding of the function's largest value;
callers that need more correct it by Newton's method. An interval whose interpolant stays above its own error has no
root; an interval where that is undecided is halved.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from ....system.system import Array
from .interpolants import COARSE, FEW_NODES, FINE, Interpolant, interpolation_error, root_on_grid, write_soonest

Values = Callable[[Array, Array], Array]

# error below which an interpolant replaces the function: relative to its largest value, and absolute rounding of gaps
RESOLVED, NOISE = 1e-7, 1e-15
# most halvings of an interval where a function has a kink, and where it is smooth but only touches zero
KINKED, TOUCHING = 6, 20
# most steps along a function of known slope, and the value that counts as zero, relative to the slope
MOST_STEPS, ZERO = 400, 1e-9


def first_root(values: Values, steepest: Array, known: Array | None = None) -> tuple[float, int]:
    """Return the earliest root of some functions in [0, 1], and the index of its function; 1 and -1 if there is none.

    Parameters
    ----------
    values : callable
        values(x, index) -> the k functions of that index at n places x, shape (n, k).
    steepest : ndarray, shape (k,)
        A bound of how fast each falls; infinite for functions that are smooth enough for interpolants.
    known : ndarray, shape (5, k), optional
        Their values at `FEW_NODES`; NaN of a function for which they are not known.
    """
    best, which = 1.0, -1
    for k, x in _roots(values, np.flatnonzero(np.isinf(steepest)), known):
        if x < best:
            best, which = x, k
    for k in np.flatnonzero(np.isfinite(steepest)).tolist():
        x = first_root_by_slope(_at_one_place(_single(values, k)), best, float(steepest[k]))
        if x < best:
            best, which = x, k
    return best, which


def _soonest(of: Interpolant, values: Array) -> Array:
    """Return what `write_soonest` writes, of values of shape (degree + 1, k)."""
    share = np.empty(values.shape[1])
    write_soonest(of.last, of.grid, np.ascontiguousarray(values), share)
    return share


def _single(values: Values, k: int) -> Callable[[Array], Array]:
    own = np.array([k])
    return lambda x: values(x, own)[:, 0]


def _at_one_place(value: Callable[[Array], Array]) -> Callable[[float], float]:
    return lambda x: float(value(np.array([x]))[0])


def _roots(values: Values, index: Array, known: Array | None) -> Iterator[tuple[int, float]]:
    """Yield functions and their roots, the function that may have the earliest root first."""
    if not index.size:
        return
    coarse = np.full((len(FEW_NODES), len(index)), np.nan) if known is None else known[:, index]
    unknown = np.isnan(coarse[0])
    if unknown.any():
        coarse[:, unknown] = values(FEW_NODES, index[unknown])
    suspect = _soonest(COARSE, coarse) < np.inf
    index = index[suspect]
    if not index.size:
        return
    fine = np.empty((len(FINE.nodes), len(index)))
    # every other node is a node of the coarser interpolant
    fine[::2], fine[1::2] = coarse[:, suspect], values(FINE.nodes[1::2].copy(), index)
    soonest, best = _soonest(FINE, fine), 1.0
    for k in np.argsort(soonest, kind="stable").tolist():
        if soonest[k] >= best:
            return
        x = _root(_single(values, int(index[k])), 0.0, 1.0, fine[:, k], 0)
        if x is not None:
            best = min(best, x)
            yield int(index[k]), x


def _root(value: Callable[[Array], Array], low: float, high: float, known: Array | None, halved: int) -> float | None:
    """Return the first root of one function in an interval, or None."""
    if known is None:
        known = value(low + (high - low) * FINE.nodes)
        if _soonest(FINE, known[:, None])[0] == np.inf:
            return None
    error = interpolation_error(FINE.last, np.ascontiguousarray(known).reshape(-1, 1), 0)
    smooth = error <= max(RESOLVED * float(np.abs(known).max()), NOISE)
    share, sure = root_on_grid(FINE.fine_grid @ known, error)
    if (smooth and sure) or halved >= (TOUCHING if smooth else KINKED):
        return None if share < 0.0 else low + share * (high - low)
    middle = 0.5 * (low + high)
    found = _root(value, low, middle, None, halved + 1)
    return _root(value, middle, high, None, halved + 1) if found is None else found


def first_root_by_slope(value: Callable[[float], float], end: float, steepest: float) -> float:
    """Return the first root of a function, or `end` if there is none before, by steps that cannot pass a root.

    A place where the search has taken `MOST_STEPS` steps counts as a root: the function is nearly zero there.

    Parameters
    ----------
    value : callable
        The function.
    end : float
        Where the search ends.
    steepest : float
        A bound of how fast the function falls.
    """
    x, found = 0.0, value(0.0)
    zero, last = ZERO * steepest, np.inf
    for _ in range(MOST_STEPS):
        # a function that is zero at the start may rise from there
        if found <= zero and x > 0.0 and found <= last:
            break
        x += max(found, zero) / steepest
        if x >= end:
            return end
        last, found = found, value(x)
    return x

"""Finds where functions on [0, 1] first become negative, from interpolants at Chebyshev points.

A root here is a place where a function falls through zero. It is exact to the rounding of the function's largest value;
callers that need more correct it by Newton's method. An interval whose interpolant stays above its own error has no
root; an interval where that is undecided is halved.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.polynomial import chebyshev

from ....compiled import kernel
from ....system.system import Array

Values = Callable[[Array, Array], Array]

# the error of an interpolant is bounded by this factor times its last two coefficients, and by rounding
_ERROR_FACTOR, _ROUNDING = 4.0, 1e-15
# error below which an interpolant replaces the function: relative to its largest value, and absolute rounding of gaps
_RESOLVED, _NOISE = 1e-7, 1e-15
# most halvings of an interval where a function has a kink, and where it is smooth but only touches zero
_KINKED, _TOUCHING = 6, 20
# most steps along a function of known slope, and the value that counts as zero, relative to the slope
_MOST_STEPS, _ZERO = 400, 1e-9


@kernel("f8(f8[:,::1], f8[:,::1], i8)")
def interpolation_error(last: Array, values: Array, k: int) -> float:
    """Return a bound of the error of the interpolant of function k, of values of shape (degree + 1, n).

    Parameters
    ----------
    last : ndarray, shape (2, degree + 1)
        The matrix from values to the last two coefficients.
    values, k
        The values, and which function.
    """
    size = error = 0.0
    for c in range(2):
        coefficient = 0.0
        for i in range(len(values)):
            coefficient += last[c, i] * values[i, k]
        error += abs(coefficient)
    for i in range(len(values)):
        # a NaN is kept
        if abs(values[i, k]) > size or values[i, k] != values[i, k]:
            size = abs(values[i, k])
    return _ERROR_FACTOR * error + _ROUNDING * size


@kernel("void(f8[:,::1], f8[:,::1], f8[:,::1], f8[::1])")
def write_soonest(last: Array, grid: Array, values: Array, share: Array) -> None:
    """Write a lower bound of the first root of each function, shape (k,); infinite where it has certainly none.

    Parameters
    ----------
    last, values
        See `interpolation_error`.
    grid : ndarray, shape (p + 1, degree + 1)
        The matrix from values to the interpolant's values at 0, 1 / p, ..., 1.
    share : ndarray, shape (k,)
        Receives the bounds.
    """
    p, found = len(grid) - 1, np.empty(len(grid))
    for k in range(len(share)):
        bend = 0.0
        for i in range(p + 1):
            found[i] = 0.0
            for j in range(len(values)):
                found[i] += grid[i, j] * values[j, k]
            if i > 1:
                bend = max(bend, abs(found[i] - 2.0 * found[i - 1] + found[i - 2]))
        # a parabola through three grid points dips between them by an eighth of the second difference
        least = interpolation_error(last, values, k) + 0.125 * bend
        share[k] = np.inf
        for i in range(p):
            if not found[i + 1] > least:
                share[k] = i / p
                break


class _Interpolant:
    """A polynomial on [0, 1] through values at the extrema of a Chebyshev polynomial.

    Parameters
    ----------
    degree : int
        Degree of the polynomial.
    """

    def __init__(self, degree: int) -> None:
        self.nodes = 0.5 - 0.5 * np.cos(np.pi * np.arange(degree + 1) / degree)
        self._coefficients = np.linalg.inv(chebyshev.chebvander(2.0 * self.nodes - 1.0, degree))
        self._last = self._coefficients[-2:].copy()
        self._grid, self._fine_grid = (self._evaluation(np.linspace(0.0, 1.0, n)) for n in (65, _PARTS + 1))

    def _evaluation(self, x: Array) -> Array:
        """Return the matrix from values at the nodes to the polynomial's values at x."""
        return np.asarray(chebyshev.chebvander(2.0 * x - 1.0, len(self.nodes) - 1) @ self._coefficients)

    def error(self, values: Array) -> float:
        """Return a bound of the error of one interpolant, of values of shape (degree + 1,)."""
        return interpolation_error(self._last, np.ascontiguousarray(values).reshape(-1, 1), 0)

    def soonest(self, values: Array) -> Array:
        """Return a lower bound of the first root of each function, shape (k,); infinite where it has certainly none.

        The values have the shape (degree + 1, k).
        """
        share = np.empty(values.shape[1])
        write_soonest(self._last, self._grid, np.ascontiguousarray(values), share)
        return share

    def on_fine_grid(self, values: Array) -> Array:
        """Return one interpolant's values at x = 0, 1 / 1024, ..., 1."""
        return np.asarray(self._fine_grid @ values)


# intervals of the fine grid
_PARTS = 1024
_COARSE, _FINE = _Interpolant(4), _Interpolant(8)
FEW_NODES = _COARSE.nodes


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
    suspect = _COARSE.soonest(coarse) < np.inf
    index = index[suspect]
    if not index.size:
        return
    fine = np.empty((len(_FINE.nodes), len(index)))
    # every other node is a node of the coarser interpolant
    fine[::2], fine[1::2] = coarse[:, suspect], values(_FINE.nodes[1::2].copy(), index)
    soonest, best = _FINE.soonest(fine), 1.0
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
        known = value(low + (high - low) * _FINE.nodes)
        if _FINE.soonest(known[:, None])[0] == np.inf:
            return None
    error = _FINE.error(known)
    smooth = error <= max(_RESOLVED * float(np.abs(known).max()), _NOISE)
    share, sure = _root_on_grid(_FINE.on_fine_grid(known), error)
    if (smooth and sure) or halved >= (_TOUCHING if smooth else _KINKED):
        return None if share is None else low + share * (high - low)
    middle = 0.5 * (low + high)
    found = _root(value, low, middle, None, halved + 1)
    return _root(value, middle, high, None, halved + 1) if found is None else found


def first_root_by_slope(value: Callable[[float], float], end: float, steepest: float) -> float:
    """Return the first root of a function, or `end` if there is none before, by steps that cannot pass a root.

    A place where the search has taken `_MOST_STEPS` steps counts as a root: the function is nearly zero there.

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
    zero, last = _ZERO * steepest, np.inf
    for _ in range(_MOST_STEPS):
        # a function that is zero at the start may rise from there
        if found <= zero and x > 0.0 and found <= last:
            break
        x += max(found, zero) / steepest
        if x >= end:
            return end
        last, found = found, value(x)
    return x


def _root_on_grid(p: Array, error: float) -> tuple[float | None, bool]:
    """Return the first root of a polynomial from its values p on the fine grid, or None; and whether it is certain."""
    # three cases: a root at 0, a minimum between grid points that reaches zero, a fall through zero
    below = p <= 0.0
    if below[0] and p[1] <= p[0]:
        # it falls at once, unless it rises and falls back within the first part
        return 0.0, -3.0 * p[0] + 4.0 * p[1] - p[2] <= 0.0
    # a function that starts below zero has its root where it begins to fall
    falls = np.flatnonzero(below[1:] & (p[1:] < p[:-1]))
    last = int(falls[0]) + 1 if falls.size else len(p) - 1
    inner = p[1:last]
    for i in (1 + np.flatnonzero((inner <= p[: last - 1]) & (inner <= p[2 : last + 1]) & (inner > 0.0))).tolist():
        bend, slope = p[i - 1] - 2.0 * p[i] + p[i + 1], 0.5 * (p[i + 1] - p[i - 1])
        least = p[i] - (0.5 * slope**2 / bend if bend > 0.0 else 0.0)
        if least <= error:
            root = _root_of_parabola(p[i - 1 : i + 2]) if least < 0.0 else None
            return None if root is None else (i - 1 + root) / _PARTS, least < -error
    if not falls.size:
        return None, True
    if below[last - 1]:
        return (last - 1) / _PARTS, True
    first = min(last - 1, len(p) - 3)
    root = _root_of_parabola(p[first : first + 3])
    return (first + root) / _PARTS, True


def _root_of_parabola(p: Array) -> float:
    """Return where the parabola through values at 0, 1 and 2 first falls through zero."""
    c, a = float(p[0]), 0.5 * float(p[0] - 2.0 * p[1] + p[2])
    b = float(p[1]) - c - a
    # the form of the falling root that has no cancellation
    root = np.sqrt(max(b * b - 4.0 * a * c, 0.0))
    return float(2.0 * c / (root - b)) if root - b > 0.0 else 0.0

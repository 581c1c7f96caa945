"""Where functions on [0, 1] first fall through zero, from their interpolants at Chebyshev points.

A fall is precise to the rounding of the largest value: who needs more corrects it by Newton's method.
An interval whose interpolant stays above its own error has no fall; one whose interpolant does not tell is halved.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.polynomial import chebyshev

from ...system.system import Array

Values = Callable[[float, Array], Array]

# two coefficients bound the error of an interpolant, which is rounding at least, relative to the largest value
_UNSURE, _ROUNDING = 4.0, 1e-15
# error at which an interpolant is taken for the function: relative to its largest value, and that of gaps by rounding
_RESOLVED, _NOISE = 1e-7, 1e-15
# how often an interval is halved where a function has a kink, and where it is smooth but only touches zero
_KINKED, _TOUCHING = 6, 20
# how often a function of known slope is advanced, and the part of the interval that counts as none
_ADVANCES, _NEAR = 400, 1e-9


class _Interpolant:
    """Values at the extrema of a Chebyshev polynomial made into a polynomial on [0, 1].

    Parameters
    ----------
    degree : int
        Of the polynomial.
    """

    def __init__(self, degree: int) -> None:
        self.nodes = 0.5 - 0.5 * np.cos(np.pi * np.arange(degree + 1) / degree)
        self._coefficients = np.linalg.inv(chebyshev.chebvander(2.0 * self.nodes - 1.0, degree))
        self._on_grid, self._on_fine = (self._on(np.linspace(0.0, 1.0, n)) for n in (65, _PARTS + 1))

    def _on(self, x: Array) -> Array:
        return np.asarray(chebyshev.chebvander(2.0 * x - 1.0, len(self.nodes) - 1) @ self._coefficients)

    def error(self, values: Array) -> Array:
        """Return by how much the interpolants may be off, shape (k,); values have shape (degree + 1, k)."""
        last = np.abs(self._coefficients[-2:] @ values).sum(axis=0)
        return np.asarray(_UNSURE * last + _ROUNDING * np.abs(values).max(axis=0))

    def soonest(self, values: Array) -> Array:
        """Return from where on each may fall, shape (k,), infinite where it stays above its error after the start."""
        grid = self._on_grid @ values
        # between three grid points a parabola dips by an eighth of the second difference
        dip = 0.125 * np.abs(np.diff(grid, 2, axis=0)).max(axis=0)
        low = ~(grid[1:] > self.error(values) + dip)
        return np.where(low.any(axis=0), low.argmax(axis=0) / (len(grid) - 1), np.inf)

    def on_fine(self, values: Array) -> Array:
        """Return one of them at x = 0, 1 / 1024, ..., 1."""
        return np.asarray(self._on_fine @ values)


_PARTS = 1024
_COARSE, _FINE = _Interpolant(4), _Interpolant(8)
FEW_NODES = _COARSE.nodes


def first_root(values: Values, steepest: Array, known: Array | None = None) -> tuple[float, int]:
    """Return where in [0, 1] the first of some functions falls through zero, and which; 1 and -1 if none does.

    Parameters
    ----------
    values : callable
        values(x, index) -> the functions of that index at x.
    steepest : ndarray, shape (k,)
        Infinite for functions that a few values tell apart from others; of the rest, how fast each falls at most.
    known : ndarray, shape (5, k), optional
        Their values at `FEW_NODES`.
    """
    best, which = 1.0, -1
    for k, x in _falls(values, np.flatnonzero(np.isinf(steepest)), known):
        if x < best:
            best, which = x, k
    for k in np.flatnonzero(np.isfinite(steepest)).tolist():
        x = advanced(_one(values, k), best, float(steepest[k]))
        if x < best:
            best, which = x, k
    return best, which


def _one(values: Values, k: int) -> Callable[[float], float]:
    own = np.array([k])
    return lambda x: float(values(x, own)[0])


def _falls(values: Values, index: Array, known: Array | None) -> Iterator[tuple[int, float]]:
    """Yield which functions fall and where, the soonest first as far as can be told beforehand."""
    if not index.size:
        return
    coarse = np.array([values(x, index) for x in FEW_NODES.tolist()]) if known is None else known[:, index]
    suspect = _COARSE.soonest(coarse) < np.inf
    index = index[suspect]
    if not index.size:
        return
    fine = np.empty((len(_FINE.nodes), len(index)))
    # every other node is one of the coarser interpolant
    fine[::2], fine[1::2] = coarse[:, suspect], [values(x, index) for x in _FINE.nodes[1::2].tolist()]
    soonest, best = _FINE.soonest(fine), 1.0
    for k in np.argsort(soonest, kind="stable").tolist():
        if soonest[k] >= best:
            return
        x = _fall(_one(values, int(index[k])), 0.0, 1.0, fine[:, k], 0)
        if x is not None:
            best = min(best, x)
            yield int(index[k]), x


def _fall(value: Callable[[float], float], low: float, high: float, known: Array | None, halved: int) -> float | None:
    """Return where one function first falls through zero in an interval, or None."""
    if known is None:
        known = np.array([value(x) for x in (low + (high - low) * _FINE.nodes).tolist()])
        if _FINE.soonest(known[:, None])[0] == np.inf:
            return None
    error = float(_FINE.error(known[:, None])[0])
    smooth = error <= max(_RESOLVED * float(np.abs(known).max()), _NOISE)
    share, sure = _fall_on_grid(_FINE.on_fine(known), error)
    if (smooth and sure) or halved >= (_TOUCHING if smooth else _KINKED):
        return None if share is None else low + share * (high - low)
    middle = 0.5 * (low + high)
    found = _fall(value, low, middle, None, halved + 1)
    return _fall(value, middle, high, None, halved + 1) if found is None else found


def advanced(value: Callable[[float], float], end: float, steepest: float) -> float:
    """Return where a function first falls to zero, `end` if it does not before, by steps that cannot jump a zero.

    What comes so near that this takes too many steps counts as a fall.
    """
    x, found = 0.0, value(0.0)
    nothing, last = _NEAR * steepest, np.inf
    for _ in range(_ADVANCES):
        # what starts there may rise
        if found <= nothing and x > 0.0 and found <= last:
            break
        x += max(found, nothing) / steepest
        if x >= end:
            return end
        last, found = found, value(x)
    return x


def _fall_on_grid(p: Array, error: float) -> tuple[float | None, bool]:
    """Return where a polynomial on the fine grid first falls through zero, or None; and whether beyond doubt."""
    below = p <= 0.0
    if below[0] and p[1] <= p[0]:
        # down at once, unless it rises and falls back within the first part
        return 0.0, -3.0 * p[0] + 4.0 * p[1] - p[2] <= 0.0
    # what starts below falls where it turns
    falls = np.flatnonzero(below[1:] & (p[1:] < p[:-1]))
    last = int(falls[0]) + 1 if falls.size else len(p) - 1
    inner = p[1:last]
    for i in (1 + np.flatnonzero((inner <= p[: last - 1]) & (inner <= p[2 : last + 1]) & (inner > 0.0))).tolist():
        bend, slope = p[i - 1] - 2.0 * p[i] + p[i + 1], 0.5 * (p[i + 1] - p[i - 1])
        least = p[i] - (0.5 * slope**2 / bend if bend > 0.0 else 0.0)
        if least <= error:
            root = _root(p[i - 1 : i + 2]) if least < 0.0 else None
            return None if root is None else (i - 1 + root) / _PARTS, least < -error
    if not falls.size:
        return None, True
    if below[last - 1]:
        return (last - 1) / _PARTS, True
    first = min(last - 1, len(p) - 3)
    root = _root(p[first : first + 3])
    return (first + root) / _PARTS, True


def _root(p: Array) -> float:
    """Return where the parabola through values at 0, 1 and 2 first falls through zero."""
    c, a = float(p[0]), 0.5 * float(p[0] - 2.0 * p[1] + p[2])
    b = float(p[1]) - c - a
    # of a root that falls, the form without cancellation
    root = np.sqrt(max(b * b - 4.0 * a * c, 0.0))
    return float(2.0 * c / (root - b)) if root - b > 0.0 else 0.0

"""Polynomials through values at Chebyshev points, in kernels: bounds of their errors, and where they have roots."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from ....compiled import kernel, record
from ....system.system import Array

# the error of an interpolant is bounded by this factor times its last two coefficients, and by rounding
_ERROR_FACTOR, _ROUNDING = 4.0, 1e-15
# intervals of the fine grid
PARTS = 1024


@record("f8[::1], f8[:,::1], f8[:,::1], f8[:,::1]")
class Interpolant(NamedTuple):
    """A polynomial on [0, 1] through values at the extrema of a Chebyshev polynomial.

    Attributes
    ----------
    nodes : ndarray, shape (degree + 1,)
        These places.
    last : ndarray, shape (2, degree + 1)
        The matrix from values to the last two coefficients.
    grid, fine_grid : ndarray, shapes (65, degree + 1) and (PARTS + 1, degree + 1)
        The matrices from values to the polynomial's values at 0, 1 / p, ..., 1.
    """

    nodes: Array
    last: Array
    grid: Array
    fine_grid: Array


def interpolant(degree: int) -> Interpolant:
    """Return the polynomial of a degree."""
    nodes = 0.5 - 0.5 * np.cos(np.pi * np.arange(degree + 1) / degree)
    coefficients = np.linalg.inv(chebyshev.chebvander(2.0 * nodes - 1.0, degree))
    grids = (chebyshev.chebvander(np.linspace(-1.0, 1.0, n), degree) @ coefficients for n in (65, PARTS + 1))
    return Interpolant(nodes, coefficients[-2:].copy(), *grids)


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


@kernel("b1(f8[:,::1], f8[:,::1], f8[:,::1])")
def all_stay_positive(last: Array, grid: Array, values: Array) -> bool:
    """Return whether no function has a root; see `write_soonest`."""
    share = np.empty(values.shape[1])
    write_soonest(last, grid, values, share)
    for k in range(len(share)):
        if share[k] < np.inf:
            return False
    return True


@kernel("f8(f8, f8, f8)")
def root_of_parabola(p: float, q: float, r: float) -> float:
    """Return where the parabola through values at 0, 1 and 2 first falls through zero."""
    c, a = p, 0.5 * (p - 2.0 * q + r)
    b = q - c - a
    # the form of the falling root that has no cancellation
    root = np.sqrt(max(b * b - 4.0 * a * c, 0.0))
    return 2.0 * c / (root - b) if root - b > 0.0 else 0.0


@kernel("Tuple((f8, b1))(f8[::1], f8)")
def root_on_grid(p: Array, error: float) -> tuple[float, bool]:
    """Return the first root of a polynomial from its values on the fine grid, -1 without one; and whether it is sure.

    Parameters
    ----------
    p : ndarray, shape (PARTS + 1,)
        The values.
    error : float
        A bound of their errors.
    """
    # three cases: a root at 0, a minimum between grid points that reaches zero, a fall through zero
    if p[0] <= 0.0 and p[1] <= p[0]:
        # it falls at once, unless it rises and falls back within the first part
        return 0.0, -3.0 * p[0] + 4.0 * p[1] - p[2] <= 0.0
    # a function that starts below zero has its root where it begins to fall
    last, falls, parts = len(p) - 1, False, len(p) - 1
    for i in range(1, len(p)):
        if p[i] <= 0.0 and p[i] < p[i - 1]:
            last, falls = i, True
            break
    for i in range(1, last):
        if p[i] <= p[i - 1] and p[i] <= p[i + 1] and p[i] > 0.0:
            bend, slope = p[i - 1] - 2.0 * p[i] + p[i + 1], 0.5 * (p[i + 1] - p[i - 1])
            least = p[i] - (0.5 * slope * slope / bend if bend > 0.0 else 0.0)
            if least <= error:
                if least < 0.0:
                    return (i - 1 + root_of_parabola(p[i - 1], p[i], p[i + 1])) / parts, least < -error
                return -1.0, False
    if not falls:
        return -1.0, True
    if p[last - 1] <= 0.0:
        return (last - 1) / parts, True
    first = min(last - 1, len(p) - 3)
    return (first + root_of_parabola(p[first], p[first + 1], p[first + 2])) / parts, True


# every other node of the second is a node of the first
COARSE, FINE = interpolant(4), interpolant(8)
FEW_NODES = COARSE.nodes

"""Errors of a Runge-Kutta step, and how far its coordinates travel."""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ...system.system import Array


@kernel("void(f8[:,::1], f8[:,::1], f8, f8, f8[::1], f8[::1])")
def write_errors(K: Array, weights: Array, h: float, margin: float, travel: Array, error: Array) -> None:
    """Write how far coordinates travel in a step at most, times a margin, and its errors, by two estimates.

    Their combination, of orders five and three, is of order seven.

    Parameters
    ----------
    K : ndarray, shape (n, nv + k)
        Rates of the stages, of which those with weights count; see `RungeKuttaStep.rates`.
    weights : ndarray, shape (2, s)
        Those of the rates in both estimates.
    h, margin : float
        Length of the step [s], and the margin.
    travel, error : ndarray, shapes (nv,) and (nv + k,)
        Receive travel and errors.
    """
    for k in range(len(error)):
        fifth = third = most = 0.0
        for i in range(weights.shape[1]):
            rate = K[i, k]
            # a NaN is kept
            if abs(rate) > most or rate != rate:
                most = abs(rate)
            fifth += weights[0, i] * rate
            third += weights[1, i] * rate
        fifth, third = h * fifth, h * third
        both = np.sqrt(fifth * fifth + 0.01 * third * third)
        error[k] = fifth * fifth / both if both != 0.0 else 0.0
        if k < len(travel):
            travel[k] = margin * abs(h) * most


@kernel("f8(f8[::1], f8[::1], f8[::1])")
def largest_error(error: Array, v: Array, units: Array) -> float:
    """Return the largest of the errors of coordinates, in units, and those of velocities over the speed, at least 1.

    Parameters
    ----------
    error : ndarray, shape (2 nv,) or (3 nv,)
        See `RungeKuttaStep.error`.
    v, units : ndarray, shape (nv,)
        Velocity and units.
    """
    nv, speed, in_chart, of_v = len(v), 1.0, 0.0, 0.0
    for k in range(nv):
        speed = max(speed, abs(v[k]) / units[k])
    for k in range(len(error)):
        size = error[k] / units[k % nv]
        # a NaN is kept
        if k < nv and (size > in_chart or size != size):
            in_chart = size
        elif k >= nv and (size > of_v or size != size):
            of_v = size
    of_v /= speed
    return in_chart if in_chart > of_v or in_chart != in_chart else of_v

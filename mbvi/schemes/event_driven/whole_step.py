"""A Runge-Kutta step of one mechanism with its error and its dense output, in kernels."""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ...constraints.mechanism.held_rows import HeldRows
from ...system.system import Array
from .stages import SmoothMotion, take_stages


@kernel(
    "void(SmoothMotion, HeldRows, f8[:,::1], f8[:,::1], f8, Array(f8, 1, 'C', True), Array(f8, 1, 'C', True),"
    " f8[:,::1], f8[::1], f8[::1])"
)
def take_whole_step(
    s: SmoothMotion, held: HeldRows, weights: Array, errors: Array, h: float, q: Array, v: Array, K: Array,
    fastest: Array, error: Array,
) -> None:  # fmt: skip
    """Take the stages of a step but the first one, and estimate its errors; its end is in the room of `s`.

    Parameters
    ----------
    s, held, weights, h, q, v, K
        See `take_stages`; the first row of K is given.
    errors : ndarray, shape (2, n)
        The weights of the rates of the first n stages in the estimates of order five and three.
    fastest : ndarray, shape (nv,)
        Receives the largest rate of each coordinate of the chart.
    error : ndarray, shape (2 nv,) or (3 nv,)
        See `RungeKuttaStep`.
    """
    n = errors.shape[1]
    take_stages(s, held, weights, h, 1, n, q, v, K)
    for k in range(len(fastest)):
        fastest[k] = 0.0
        for i in range(n):
            # a NaN stays
            if abs(K[i, k]) > fastest[k] or K[i, k] != K[i, k]:
                fastest[k] = abs(K[i, k])
    for k in range(len(error)):
        fifth = third = 0.0
        for i in range(n):
            fifth += errors[0, i] * K[i, k]
            third += errors[1, i] * K[i, k]
        fifth, third = abs(h * fifth), abs(h * third)
        both = np.sqrt(fifth * fifth + 0.01 * third * third)
        # the combination of two estimates, of order five and three, is of order seven
        error[k] = fifth * (fifth / both) if both != 0.0 else 0.0


@kernel(
    "void(SmoothMotion, HeldRows, f8[:,::1], f8[:,::1], f8, Array(f8, 1, 'C', True), Array(f8, 1, 'C', True),"
    " f8[:,::1], i8, f8[:,:,::1])"
)
def write_dense_output(
    s: SmoothMotion, held: HeldRows, weights: Array, polynomials: Array, h: float, q: Array, v: Array, K: Array,
    first: int, dense: Array,
) -> None:  # fmt: skip
    """Take the stages from `first` on, and write the dense output of the step.

    Parameters
    ----------
    s, held, weights, h, q, v, K
        See `take_stages`.
    polynomials : ndarray, shape (n, 7)
        The matrix from the rates of the stages to coefficients.
    first : int
        The first stage of the dense output.
    dense : ndarray, shape (2, nv, 7)
        See `RungeKuttaStep`.
    """
    nv = len(v)
    take_stages(s, held, weights, h, first, len(K), q, v, K)
    for c in range(2):
        for k in range(nv):
            for d in range(dense.shape[2]):
                dense[c, k, d] = 0.0
            for i in range(len(K)):
                rate = K[i, c * nv + k]
                for d in range(dense.shape[2]):
                    dense[c, k, d] += rate * polynomials[i, d]


@kernel("f8(f8[::1], Array(f8, 1, 'C', True), f8[::1])")
def largest_error(error: Array, v: Array, units: Array) -> float:
    """Return the largest error of a step that leads to v: of velocities relative to the largest one where it exceeds 1.

    A NaN is returned. See `RungeKuttaStep.error` and `velocity_units`.
    """
    nv, speed, largest = len(v), 1.0, 0.0
    for k in range(nv):
        speed = max(speed, abs(v[k]) / units[k])
    for i in range(len(error)):
        size = error[i] / units[i % nv] / (speed if i >= nv else 1.0)
        if size > largest or size != size:
            largest = size
            if size != size:
                return largest
    return largest

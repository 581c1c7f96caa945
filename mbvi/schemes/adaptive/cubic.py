"""The cubic between two states that a run of `Adaptive` returns for the times between them."""

from __future__ import annotations

import numpy as np

from ...system import System

Array = np.ndarray

# exponents of its coefficients
POWERS = np.arange(1, 4)


def cubic(system: System, h: float, begin: tuple[Array, Array], end: tuple[Array, Array]) -> Array:
    """Return the cubic of q between two states (q, v) a time h apart, with the velocities at both, and of v.

    Coefficients have the shape (2, nv, 3): those of a displacement from the first q and of v less the first v, in
    powers of the part of the time, divided by h.
    """
    (q0, v0), (q, v), dense = begin, end, np.zeros((2, system.nv, 3))
    if h <= 0.0:
        return dense
    displacement = system.difference(q0, q)
    last, mean = system.chart_rate(q0, displacement, v), displacement / h
    dense[0] = np.stack([v0, 3.0 * mean - 2.0 * v0 - last, v0 + last - 2.0 * mean], axis=1)
    # the rate of that cubic; what the chart turns is added evenly
    dense[1, :, 0] = (2.0 * dense[0, :, 1] + v - last) / h
    dense[1, :, 1] = 3.0 * dense[0, :, 2] / h
    return dense

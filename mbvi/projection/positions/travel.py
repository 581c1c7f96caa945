"""How far a displacement moves bodies, and with that how far gaps are linear in it."""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ..metric import Array

# most linearisations of the constraints within a step
MOST_LINEARISATIONS = 20
# rows whose gap is below this part of the penetration take part in the projection
NEARBY = 0.1


@kernel("f8(f8[:,::1], f8[::1])")
def largest_travel(squares: Array, displacement: Array) -> float:
    """Return the largest displacement of a body; see `ClearanceCache.travel`; squares of shape (families, nv)."""
    families, n = squares.shape
    most = 0.0
    for i in range(families):
        travel = 0.0
        for k in range(n):
            travel += squares[i, k] * displacement[k] * displacement[k]
        most = max(most, travel)
    return np.sqrt(most)


@kernel("f8(f8[:,::1], f8[::1])")
def largest_bend(squares: Array, displacement: Array) -> float:
    """Return about the second-order part of a gap; see `ClearanceCache.bend`; its squares, shape (families, nv)."""
    families, n = squares.shape
    most = 0.0
    for i in range(families):
        travel = angle = 0.0
        for k in range(n):
            square = displacement[k] * displacement[k]
            travel += squares[i, k] * square
            if squares[i, k] > 0.0:
                angle += square
        most = max(most, travel * angle)
    return np.sqrt(most)

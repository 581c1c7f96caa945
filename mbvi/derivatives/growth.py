"""How variations of the start grow along a run, and until when that leaves digits of its states."""

from __future__ import annotations

import numpy as np

from ..errors import InputError
from ..problem import Problem
from ..system.lengths import velocity_units
from ..system.system import Array
from .directions import Directions


def growth(problem: Problem, matrices: Array, varied: Directions) -> Array:
    """Return the largest factor by which a variation of the start has grown at each time, shape (n + 1,).

    Places count in lengths of the scene and angles in rad, velocities in these a second.
    """
    if "state" not in varied.columns:
        raise InputError('growth is that of variations of the start: wrt must hold "state"')
    own = varied.columns["state"]
    units = np.tile(velocity_units(problem.system, problem.length), 2)
    # each column varies one coordinate
    sizes = units[np.abs(varied.start[:, own]).argmax(axis=0)]
    return np.linalg.norm(matrices[:, :, own] / units[:, None] * sizes, 2, axis=(1, 2))


def trusted_until(times: Array, factors: Array, digits: float, start: float) -> float:
    """Return the first time from which fewer digits are left of a start that is known to a relative error [s]."""
    lost = np.maximum.accumulate(factors) * start > 10.0**-digits
    return float(times[lost.argmax()]) if lost.any() else np.inf

"""Values between limits: on which side of them each is, and by how much it stays there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ....system.system import Array

# by how much a value may pass a limit unseen, relative to the limit or to 1: more than the rounding of values that stay
# at a limit
_PASSED = 1e-12


class State(NamedTuple):
    """Some states of a mechanism: times, shape (p,) [s], configurations, shape (p, nq), and velocities, (p, nv)."""

    t: Array
    q: Array
    v: Array


def sides(values: Array, limits: Array) -> Array:
    """Return -1 for values below their limits, shape (2, k), 1 for those above them, 0 for the others, shape (k,)."""
    low, high = limits
    return (values > high).astype(int) - (values < low)


def at_limits(side: Array, limits: Array) -> Array:
    """Return the limits of values on the sides below and above them, and 0 for others, shape (k,)."""
    return np.where(side > 0, limits[1], np.where(side < 0, limits[0], 0.0))


def margins(values: Array, limits: Array, side: Array) -> Array:
    """Return what becomes negative where values leave their sides; 1 where there is no limit.

    Parameters
    ----------
    values : ndarray, shape (p, k)
        Values in p states.
    limits : ndarray, shape (2, k)
        Lower and upper limits.
    side : ndarray of int, shape (k,)
        See `sides`.

    Returns
    -------
    ndarray, shape (p, 2 k)
        Of all upper limits, then of all lower ones; of values beyond one of their limits the same for both.
    """
    low, high = limits
    beyond = np.where(side > 0, values - high, low - values)
    inside = side == 0
    found = np.hstack([np.where(inside, high - values, beyond), np.where(inside, values - low, beyond)])
    found += _PASSED * np.maximum(np.abs(limits[::-1]), 1.0).reshape(-1)
    return np.where(np.isfinite(found), found, 1.0)

"""Central differences of order four along the directions of the tangent space."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...system import System
from ...system.system import Array

# length of a difference, in lengths of the scene and radians, and per second for velocities: the truncation and the
# rounding of order four are both below 1e-11 there
STEP = 2e-4
_POINTS, _WEIGHTS = (-2.0, -1.0, 1.0, 2.0), (1.0 / 12.0, -8.0 / 12.0, 8.0 / 12.0, -1.0 / 12.0)


def along(values: Callable[[Array], Array], steps: Array) -> Array:
    """Return d values(dx) / d dx at dx = 0, with the directions in the last axis.

    Parameters
    ----------
    values : callable
        values(dx) -> array of any shape, dx of shape (n,).
    steps : ndarray, shape (n,)
        The length of the difference along each direction; the derivative is zero along those where it is zero.
    """
    nothing = 0.0 * values(np.zeros(len(steps)))
    columns = []
    for k, step in enumerate(steps.tolist()):
        dx, total = np.zeros(len(steps)), nothing
        if step == 0.0:
            columns.append(total)
            continue
        for point, weight in zip(_POINTS, _WEIGHTS, strict=True):
            dx[k] = point * step
            total = total + (weight / step) * values(dx)
        columns.append(total)
    return np.stack(columns, axis=-1)


def along_both(values: Callable[[Array, Array], Array], system: System, q: Array, v: Array, steps: Array) -> Array:
    """Return the derivative of values(q, v), shape (k,), along the tangent space of both, shape (k, 2 nv)."""
    of_q = along(lambda dq: values(system.integrate(q, dq), v), steps)
    return np.hstack([of_q, along(lambda dv: values(q, v + dv), steps)])

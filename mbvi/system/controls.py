"""Controls that the compiled loop evaluates itself: torques, proportional-derivative control, compiled functions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..compiled import kernel, record
from .system import Array

# what a control is: none, torques and gains along a trajectory, a function by its address
NONE, TRACKING, FUNCTION = range(3)


@record("i8, i8, f8[::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8[::1]")
class ControlTable(NamedTuple):
    """A control as kernels take it.

    Attributes
    ----------
    kind : int
        `NONE`, `TRACKING` or `FUNCTION`.
    address : int
        Of the compiled function; 0 for others.
    times : ndarray, shape (n,)
        Times of the following [s], ascending.
    torque, q, v : ndarray, shapes (n, nv), (n, nq) and (n, nv)
        Torques [N, N m], configurations and velocities of the trajectory; linear between the times.
    stiffness, rate_gain, limit : ndarray, shape (nv,)
        Gains, and the largest torque.
    """

    kind: int
    address: int
    times: Array
    torque: Array
    q: Array
    v: Array
    stiffness: Array
    rate_gain: Array
    limit: Array


@kernel("Tuple((i8, f8))(f8[::1], f8)")
def bracket(times: Array, t: float) -> tuple[int, float]:
    """Return the last of the times, but the final one, that is not after t, and the share of the way to the next."""
    n = len(times)
    if n == 1 or t <= times[0]:
        return 0, 0.0
    if t >= times[n - 1]:
        return n - 2, 1.0
    first, end = 0, n - 1
    while end - first > 1:
        half = (first + end) // 2
        if times[half] <= t:
            first = half
        else:
            end = half
    return first, (t - times[first]) / (times[first + 1] - times[first])


@kernel("f8(f8[:,::1], i8, i8, f8)")
def between(values: Array, row: int, column: int, share: float) -> float:
    """Return a value between two rows of a table."""
    if share == 0.0:
        return values[row, column]
    if share == 1.0:
        return values[row + 1, column]
    return (1.0 - share) * values[row, column] + share * values[row + 1, column]


@kernel("void(ControlTable, f8, f8[::1], f8[::1], f8[::1])")
def write_torque(control: ControlTable, t: float, q: Array, v: Array, torque: Array) -> None:
    """Write the torque of a control at t, q, v, shape (nv,)."""
    n, shift = len(v), len(q) - len(v)
    if control.kind == NONE:
        for k in range(n):
            torque[k] = 0.0
        return
    row, share = bracket(control.times, t)
    for k in range(n):
        torque[k] = between(control.torque, row, k, share)
        if control.stiffness[k] != 0.0:
            torque[k] += control.stiffness[k] * (between(control.q, row, k + shift, share) - q[k + shift])
        if control.rate_gain[k] != 0.0:
            torque[k] += control.rate_gain[k] * (between(control.v, row, k, share) - v[k])
        torque[k] = min(max(torque[k], -control.limit[k]), control.limit[k])


def no_control(nq: int, nv: int) -> ControlTable:
    """Return the table of a mechanism without a control."""
    zeros, none = np.zeros((1, nv)), np.zeros(nv)
    return ControlTable(NONE, 0, np.zeros(1), zeros, np.zeros((1, nq)), zeros, none, none, none)

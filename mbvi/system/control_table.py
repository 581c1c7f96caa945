"""The table of a control as kernels take it, with the springs of its mechanism, and its torque."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..compiled import call_address, kernel, record
from .joint_forces import ForceRows, add_row_forces, no_forces, rows_side_by_side
from .system import Array

# what a control is
NONE, TRACKING, FUNCTION, HELD = range(4)


@record(
    "i8, i8[::1], i8[::1], f8[::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8[::1], i8[::1], "
    "ForceRows, ForceRows"
)
class ControlTable(NamedTuple):
    """A control as kernels take it; it acts on the last n velocities.

    Attributes
    ----------
    kind : int
        `NONE`, `TRACKING`, `FUNCTION` or `HELD`.
    address : ndarray of int, shape (1,)
        Of the compiled function; 0 for others.
    held : ndarray of int, shape (2,)
        Of `HELD` the rows of `torque` that act, one after the other: the first, and how many.
    times : ndarray, shape (k,)
        Times of the following [s], ascending. Of `HELD` when the first row begins to act, and for how long each does.
    torque, q, v : ndarray, shape (k, n)
        Torques [N, N m], positions and velocities of the trajectory; linear between the times.
    stiffness, damping, limit : ndarray, shape (n,)
        Gains, and the largest torque.
    position : ndarray of int, shape (n,)
        Where in q the position of each joint is, counted from the end.
    actuators, springs : ForceRows
        What acts besides. Of `HELD` the inputs of actuators have the rows of `torque`.
    """

    kind: int
    address: Array
    held: Array
    times: Array
    torque: Array
    q: Array
    v: Array
    stiffness: Array
    damping: Array
    limit: Array
    position: Array
    actuators: ForceRows
    springs: ForceRows


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
    """Return a value between two rows of a table, shape (k, n)."""
    if share == 0.0:
        return values[row, column]
    return (1.0 - share) * values[row, column] + share * values[row + 1, column]


@kernel("void(ControlTable, f8, Array(f8, 1, 'C', True), Array(f8, 1, 'C', True), f8[::1])")
def write_torque(control: ControlTable, t: float, q: Array, v: Array, torque: Array) -> None:
    """Write the torque of a control at t, q, v, shape (nv,)."""
    for k in range(len(torque)):
        torque[k] = 0.0
    if control.kind == FUNCTION:
        call_address(control.address[0], t, q.ctypes.data, v.ctypes.data, torque.ctypes.data)
    n, held = control.torque.shape[1], 0
    rate = len(v) - n
    if control.kind == HELD:
        row: int = np.int64(np.floor((t - control.times[0]) / control.times[1]))  # type: ignore[assignment]
        held = control.held[0] + min(max(row, 0), control.held[1] - 1)
        for k in range(n):
            torque[rate + k] = control.torque[held, k]
    if control.kind == TRACKING:
        row, share = bracket(control.times, t)
        for k in range(n):
            tau = between(control.torque, row, k, share)
            if control.stiffness[k] != 0.0:
                tau += control.stiffness[k] * (between(control.q, row, k, share) - q[len(q) - control.position[k]])
            if control.damping[k] != 0.0:
                tau += control.damping[k] * (between(control.v, row, k, share) - v[rate + k])
            torque[rate + k] = min(max(tau, -control.limit[k]), control.limit[k])
    add_row_forces(control.actuators, held, q, v, torque)
    add_row_forces(control.springs, 0, q, v, torque)


def no_control(nv: int) -> ControlTable:
    """Return the table of a mechanism without a control."""
    return tracking(np.zeros((1, nv)))._replace(kind=NONE)


def side_by_side(tables: Sequence[tuple[ControlTable, int, int]], nq: int, nv: int) -> ControlTable:
    """Return one table of torques, PD controls, actuators and springs that act on several mechanisms.

    Parameters
    ----------
    tables : sequence of (ControlTable, int, int)
        Tables of the kind `TRACKING`, and where q and v of the mechanism of each end.
    nq, nv : int
        Sizes of q and v of all.
    """
    times = np.unique(np.concatenate([table.times for table, *_ in tables]))
    rows, gains = np.zeros((3, len(times), nv)), np.zeros((2, nv))
    limit, position = np.full(nv, np.inf), np.ones(nv, np.int64)
    for table, q_end, v_end in tables:
        n = table.torque.shape[1]
        here = slice(v_end - n, v_end)
        for all_rows, own in zip(rows, (table.torque, table.q, table.v), strict=True):
            all_rows[:, here] = np.transpose([np.interp(times, table.times, column) for column in own.T])
        gains[:, here], limit[here], position[here] = (
            (table.stiffness, table.damping), table.limit, nq - q_end + table.position
        )  # fmt: skip
    torque, q, v = rows
    actuators, springs = (
        rows_side_by_side([(getattr(table, kind), *ends) for table, *ends in tables], nq, nv)
        for kind in ("actuators", "springs")
    )
    return tracking(torque, times)._replace(
        q=q, v=v, stiffness=gains[0], damping=gains[1], limit=limit, position=position, actuators=actuators,
        springs=springs,
    )  # fmt: skip


def tracking(torque: Array, times: Array | None = None) -> ControlTable:
    """Return the table of torques without gains."""
    k, n = torque.shape
    still, none = np.zeros((k, n)), np.zeros(n)
    when = np.zeros(1) if times is None else times
    numbers = np.zeros(1, np.int64), np.zeros(2, np.int64)
    position = n - np.arange(n)
    gains, forces = (none, none, np.full(n, np.inf)), (no_forces(n), no_forces(n))
    return ControlTable(TRACKING, *numbers, when, torque, still, still, *gains, position, *forces)

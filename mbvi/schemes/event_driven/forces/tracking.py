"""Torques of PD control along a step, each held on its side of its limits."""

from __future__ import annotations

import numpy as np

from ....system.control_table import ControlTable, bracket
from ....system.controls import LoopControl, PDControl
from ....system.mechanisms.articulated import ArticulatedSystem
from ....system.system import Array
from ..runge_kutta import MARGIN, RungeKuttaStep
from .limits import State, at_limits, margins, sides


class TrackingLimits:
    """The torques of a `PDControl`, and the times of its trajectory.

    Parameters
    ----------
    system : ArticulatedSystem
        The mechanism that it acts on.
    control : PDControl
        The control.

    Attributes
    ----------
    active, has_breaks : bool
        Whether some torque has a limit that it can reach, and whether there is a trajectory.
    """

    def __init__(self, system: ArticulatedSystem, control: PDControl) -> None:
        self._system, self._control, table = system, control, control.table
        self.has_breaks = len(table.times) > 1
        varies = (table.stiffness > 0.0) | (table.damping > 0.0) | self.has_breaks
        self._limited = np.flatnonzero(varies & (table.limit > 0.0) & np.isfinite(table.limit))
        self.active, high = bool(self._limited.size), table.limit[self._limited]
        self._limits, self._side = np.array([-high, high]), np.zeros(len(high), int)
        # where in v, and in q, are what the torques with limits act on
        self._rates = system.nv - len(table.limit) + self._limited
        self._places = system.nq - table.position[self._limited]
        self._times, self._targets, self._gains = table.times, np.zeros((3, 1, len(high))), np.zeros((2, len(high)))

    def hold(self, now: State, ahead: State, end: float) -> bool:
        """Let torques stay on the sides where they are ahead, up to a time; return whether some are on others now."""
        table, limited = _rows_between(self._control.table, now.t[0], end), self._limited
        self._times, self._targets = table.times, np.array([table.torque, table.q, table.v])[:, :, limited]
        gains = np.array([table.stiffness, table.damping])
        self._gains = gains[:, limited]
        before, self._side = (sides(self._torques(state)[0], self._limits) for state in (now, ahead))
        torque, beyond, limit = table.torque, limited[self._side != 0], table.limit.copy()
        limit[limited] = np.inf
        if beyond.size:
            torque = torque.copy()
            torque[:, beyond] = at_limits(self._side, self._limits)[self._side != 0]
            gains[:, beyond] = 0.0
        held = LoopControl()
        held.table = table._replace(torque=torque, stiffness=gains[0], damping=gains[1], limit=limit)
        self._system.control = held
        return bool((before != self._side).any())

    def release(self) -> None:
        """Let the limits act."""
        self._system.control = self._control

    def margins(self, states: State) -> Array:
        """Return what becomes negative where torques leave their sides, shape (p, k); see `limits.margins`."""
        return margins(self._torques(states), self._limits, self._side)

    def stays(self, step: RungeKuttaStep, start: State, own: slice) -> bool:
        """Return whether torques certainly stay on their sides in a step without equalities.

        `own` is the place of the mechanism in v.
        """
        columns = own.start + self._rates
        faster = MARGIN * step.h * np.abs(step.rates[:, len(step.v) + columns]).max(axis=0)
        stiffness, damping = self._gains
        changes = stiffness * step.travel[columns] + damping * faster
        if len(self._times) > 1:
            changes += self._driven(np.abs(self._targets[:, 1:] - self._targets[:, :-1]).sum(axis=1))
        return bool((self.margins(start)[0] > np.tile(changes, 2)).all())

    def breaks(self, t: float, end: float) -> tuple[Array, Array]:
        """Return the times of the trajectory between two, shape (k,), and by how much slopes jump there, (k, nv)."""
        table = self._control.table
        first, last = np.searchsorted(table.times, [t, end], "right").tolist()
        # from the time before the first one to that after the last one; outside of all times slopes are zero
        near = slice(max(first - 1, 0), last + 1)
        rows = table.torque[near] + table.stiffness * table.q[near] + table.damping * table.v[near]
        slopes = np.diff(rows, axis=0) / np.diff(table.times[near])[:, None]
        slopes = np.pad(slopes, ((int(first == 0), int(last == len(table.times))), (0, 0)))
        jumps = np.zeros((last - first, self._system.nv))
        jumps[:, self._system.nv - len(table.limit) :] = np.diff(slopes, axis=0)
        return table.times[first:last], jumps

    def _torques(self, states: State) -> Array:
        """Return the torques that have limits, without these, in p states, shape (p, k)."""
        targets = self._targets[:, :1]
        if len(self._times) > 1:
            rows, shares = np.array([bracket(self._times, t) for t in states.t.tolist()]).T
            rows, shares = rows.astype(int), shares[:, None]
            targets = (1.0 - shares) * self._targets[:, rows] + shares * self._targets[:, rows + 1]
        stiffness, damping = self._gains
        return self._driven(targets) - stiffness * states.q[:, self._places] - damping * states.v[:, self._rates]

    def _driven(self, targets: Array) -> Array:
        """Return the torques of targets at a state of zeros; targets are those of torques, places and rates."""
        stiffness, damping = self._gains
        return np.asarray(targets[0] + stiffness * targets[1] + damping * targets[2])


def _rows_between(table: ControlTable, t: float, end: float) -> ControlTable:
    """Return a table with the rows of its trajectory that act between two times."""
    own = slice(bracket(table.times, t)[0], bracket(table.times, end)[0] + 2)
    return table._replace(times=table.times[own], torque=table.torque[own], q=table.q[own], v=table.v[own])

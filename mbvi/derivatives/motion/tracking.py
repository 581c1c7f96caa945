"""Torques of PD control along a motion: their slopes, and the times at which these jump."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from ...errors import SensitivityError
from ...schemes.event_driven.runge_kutta import RungeKuttaStep
from ...system.control_table import bracket
from ...system.controls import ConstantTorque, PDControl
from ...system.mechanisms.articulated import ArticulatedSystem
from ...system.system import Array, Part, System
from .limited_forces import SHORT

# distance of a torque from its limit, relative to that, which is rounding
_AT_LIMIT = 1e-10


class Tracking:
    """The torque of a `PDControl` or `ConstantTorque`: its slopes along the motion, and the kinks of these.

    Between the limits it is torque + stiffness (q* - q) + damping (v* - v), at a limit constant. Where it reaches or
    leaves one its slopes jump, and it does not: variations are continuous there, as they are at times of a trajectory.

    Parameters
    ----------
    part : Part
        A mechanism with such a control.
    """

    def __init__(self, part: Part) -> None:
        system = part.system
        assert isinstance(system, ArticulatedSystem) and isinstance(system.control, ConstantTorque | PDControl)
        self._table = system.control.table
        nv, n = system.nv, self._table.torque.shape[1]
        self._own = slice(part.v + nv - n, part.v + nv)
        self._q = part.q + system.nq - self._table.position
        bodies = zip(system.bodies[1:], list(system.model.nvs)[1:], strict=True)
        self._names = [body for body, width in bodies for _ in range(width)][nv - n :]

    def errors(self, t: float, q: Array, v: Array) -> tuple[Array, Array, Array]:
        """Return q* - q, v* - v and whether the torque is between its limits, shapes (n,), at a state of the system."""
        torque, q0, v0 = self._targets(t)
        table, off, slow = self._table, q0 - q[self._q], v0 - v[self._own]
        total = torque + table.stiffness * off + table.damping * slow
        return off, slow, np.abs(total) < table.limit

    def add_slopes(self, t: float, q: Array, v: Array, out: Array) -> None:
        """Add the derivatives of the torques by (q, v) to `out`, shape (nv, 2 nv), at a state of the system."""
        *_, free = self.errors(t, q, v)
        rows, n = np.arange(self._own.start, self._own.stop), len(v)
        out[rows, rows] -= self._table.stiffness * free
        out[rows, n + rows] -= self._table.damping * free

    def kinks(self, step: RungeKuttaStep) -> list[float]:
        """Return the shares of a step at which slopes jump; raise `SensitivityError` if a torque stays at an edge."""
        table, h = self._table, step.h
        times = (table.times - step.t) / h
        inner = times[(times > 0.0) & (times < 1.0)].tolist()
        gains = (table.stiffness > 0.0) | (table.damping > 0.0)
        limited = np.flatnonzero(gains & (table.limit > 0.0) & np.isfinite(table.limit))
        found = list(inner)
        if not limited.size:
            return found
        # the chart of a joint with one coordinate is that coordinate, so that torques are polynomials of the share
        place, speed = step.dense[:, self._own]
        moved = h * (table.stiffness[:, None] * place + table.damping[:, None] * speed)
        for first, last in pairwise([0.0, *inner, 1.0]):
            ends = [self._free_torque(step, share) for share in (first, last)]
            bend = (ends[1] - ends[0]) / (last - first)
            coefficients = np.column_stack([ends[0] - first * bend, -moved])
            coefficients[:, 1] += bend
            for k in limited.tolist():
                found += self._crossings(coefficients[k], k, first, last, step)
        return found

    def _targets(self, t: float) -> tuple[Array, ...]:
        """Return torque, q* and v* at a time, each of shape (n,)."""
        table = self._table
        row, share = bracket(table.times, t)
        each = table.torque, table.q, table.v
        return tuple(x[row] if share == 0.0 else (1.0 - share) * x[row] + share * x[row + 1] for x in each)

    def _free_torque(self, step: RungeKuttaStep, share: float) -> Array:
        """Return the torque without limits at the state where a step starts, at the time of a share of it."""
        torque, q, v = self._targets(step.t + share * step.h)
        table = self._table
        return np.asarray(torque + table.stiffness * (q - step.q0[self._q]) + table.damping * (v - step.v0[self._own]))

    def _crossings(self, torque: Array, k: int, first: float, last: float, step: RungeKuttaStep) -> list[float]:
        """Return the shares between two at which a torque, a polynomial of the share, is at a limit."""
        limit, found = float(self._table.limit[k]), list[float]()
        spread = float(np.abs(torque[1:]).sum())
        for side in (-limit, limit):
            off = torque.copy()
            off[0] -= side
            if abs(off[0]) > spread:
                continue
            if step.h > SHORT and abs(off[0]) + spread <= _AT_LIMIT * limit:
                raise SensitivityError(
                    "the torque of the control stays at its limit, neither above nor below", step.t, (self._names[k],)
                )
            roots = np.roots(off[::-1])
            # a torque that only touches its limit has a double root there, which rounding may make complex
            real = roots.real[roots.imag == 0.0]
            found += real[(real > first) & (real < last)].tolist()
        return found


def follows(system: System) -> bool:
    """Return whether a system is a mechanism with such a control."""
    return isinstance(system, ArticulatedSystem) and isinstance(system.control, ConstantTorque | PDControl)

"""Refuses gaps that pass so near to zero that a small variation would make them close, and impacts that hardly do."""

from __future__ import annotations

import numpy as np

from ..schemes.event_driven.runge_kutta import RungeKuttaStep
from ..system.system import Array
from .impacts import Refuse, Saltation
from .located_impact import LocatedImpact
from .motion.linearised import Linearised

# time in which the slowest impact would go through a gap that nearly closes [s]
_SECOND = 1.0
# share of its rate by which an impact may change within the tolerance of its gap
_CERTAIN = 5e-4
# halvings that find where the rate of a gap is zero
_HALVINGS = 40


class NearMisses:
    """Looks in each smooth step for a gap whose least value is positive and nearly zero.

    A gap that would close more slowly than `Saltation.slowest` if it were lower by its least value is refused.

    Parameters
    ----------
    linear : Linearised
        The derivatives of the motion.
    saltation : Saltation
        Knows which impacts are too slow.
    length : float
        Tolerance of a gap, in the scene's unit of length [m].
    refuse : callable
        refuse(reason, rows, time) raises `SensitivityError`.
    """

    def __init__(self, linear: Linearised, saltation: Saltation, length: float, refuse: Refuse) -> None:
        self._linear, self._saltation, self._refuse = linear, saltation, refuse
        self._length = length
        # lower bounds of gaps at the end of the last step
        self._gaps: Array | None = None

    def impact(self, impact: LocatedImpact) -> None:
        """Refuse an impact that forces slow down so much that the tolerance of its gap changes its rate.

        Where a gap with the acceleration b is off by d, the square of the rate at which it closes is off by 2 b d.
        """
        t, q, v, rows = impact.t, impact.q, impact.before, impact.rows
        J = self._linear.rows.gradients(t, q, rows)
        a = self._linear.flow.acceleration(t, q, v, impact.closed_before)[: len(v)]
        bend = J @ a + self._linear.rows.bias(t, q, v, rows)
        off = np.maximum(bend, 0.0) * self._length / self._linear.rows.lever[rows]
        opens = np.isin(rows, np.union1d(impact.closed_before, impact.held_before), invert=True)
        graze = opens & (J @ v < 0.0) & (off > _CERTAIN * (J @ v) ** 2)
        if graze.any():
            rate = float((J @ v)[graze].min())
            self._refuse(
                f"it grazes: forces would soon open the gap, whose rate of {rate:.2g} is not known to three digits",
                rows[graze],
                t,
            )

    def step(self, step: RungeKuttaStep, closed: Array, held: Array, touching: float) -> None:
        """Check a step; gaps up to `touching` [m] at its start belong to the event before."""
        rows, system = self._linear.rows, self._linear.system
        start = rows.lower_bounds(step.t, step.q0, rows.all) if self._gaps is None else self._gaps
        self._gaps = rows.lower_bounds(step.t + step.h, step.q, rows.all)
        with np.errstate(invalid="ignore"):
            fall = rows.reach @ step.travel
        # a gap that reaches zero within the step falls by at least the sum of its values at both ends
        near = np.flatnonzero(~(start + self._gaps > fall))
        near = np.setdiff1d(near, np.union1d(closed, held))
        near = near[rows.gaps(step.t, step.q0, near) * rows.lever[near] > touching]
        if not near.size:
            return
        first = rows.gradients(step.t, step.q0, near) @ step.v0
        last = rows.gradients(step.t + step.h, step.q, near) @ step.v
        for row in near[(first < 0.0) & (last > 0.0)].tolist():
            one = np.array([row])
            low, high = 0.0, 1.0
            for _ in range(_HALVINGS):
                middle = 0.5 * (low + high)
                q, v = step.at(system, middle)
                rate = float((rows.gradients(step.t + middle * step.h, q, one) @ v)[0])
                low, high = (middle, high) if rate < 0.0 else (low, middle)
            t = step.t + low * step.h
            q, v = step.at(system, low)
            J = rows.gradients(t, q, one)
            gap = float(rows.gaps(t, q, one)[0])
            a = self._linear.flow.acceleration(t, q, v, closed)[: len(v)]
            bend = float((J @ a + rows.bias(t, q, v, one))[0])
            speed = np.sqrt(2.0 * max(gap, 0.0) * max(bend, 0.0))
            slowest = float(self._saltation.slowest(one, J, v)[0])
            # where the rate is nearly constant the speed is small however wide the gap is
            if speed < slowest and gap < slowest * _SECOND:
                self._refuse(f"it grazes: its gap has the least value {gap:.2g}", one, t)

"""Looks for forces of the user's functions that act between the stages of a long step only, as pulses do."""

from __future__ import annotations

import math

import numpy as np

from ...system.control_table import TRACKING
from ...system.controls import LoopControl
from ...system.parts import parts_of
from ...system.system import Array, System
from .runge_kutta import Flow, RungeKuttaStep, slopes_at

# time between places at which accelerations are compared [s]; stages of steps of twice this time are nearer to each
# other
_APART = 0.01
# velocity that an acceleration which was not seen may add in this time, relative to the tolerance
_ALLOWED = 10.0
# least and most part of a step that is left before such an acceleration
_LEAST, _MOST = 0.2, 0.5


class UnseenForces:
    """Compares accelerations with those of the dense output of a step, if functions of the user act.

    Parameters
    ----------
    flow : Flow
        What gives accelerations.
    units : ndarray, shape (nv,)
        See `velocity_units`.
    tolerance : float
        That of the scheme.
    """

    def __init__(self, flow: Flow, units: Array, tolerance: float) -> None:
        self._flow, self._units = flow, units
        self._allowed = _ALLOWED * tolerance / _APART
        self._may_be = _may_change_fast(flow.system)

    def part_before(self, step: RungeKuttaStep, closed: Array, share: float) -> float:
        """Return the part of a step in which no acceleration was missed; 1 if none was up to a share of it.

        Parameters
        ----------
        step : RungeKuttaStep
            The step with its dense output.
        closed : ndarray of int
            The rows that stay closed in it.
        share : float
            How much of the step is used.
        """
        length = share * step.h
        if not self._may_be or length <= 2.0 * _APART:
            return 1.0
        allowed = self._allowed * float(np.abs(step.v / self._units).max(initial=1.0))
        # with contacts also accelerations without their forces: they tell what closed contacts hold
        coefficients, units = self._flow.polynomials(step.rates[:, len(step.v) :]), np.resize(self._units, len(step.a))
        for at in np.linspace(0.0, share, math.ceil(length / _APART) + 1)[1:-1].tolist():
            q, v = step.at(self._flow.system, at)
            miss = self._flow.acceleration(step.t + at * step.h, q, v, closed) - slopes_at(coefficients, at)
            # written so that a NaN is found too
            if not float(np.abs(miss / units).max(initial=0.0)) <= allowed:
                return min(max(at - _APART / step.h, _LEAST), _MOST)
        return 1.0


def _may_change_fast(system: System) -> bool:
    """Return whether functions of the user act: they may change fast at any time."""
    if system.loaded or system.functions():
        return True
    controlled = [part for part in parts_of(system) if part.controlled]
    return system.controlled and not (controlled and all(map(_is_steady, controlled)))


def _is_steady(part: System) -> bool:
    """Return whether the control of a part is a constant torque or a PD control: `ForceKinks` knows its times."""
    control = getattr(part, "control", None)
    return isinstance(control, LoopControl) and control.table.kind == TRACKING

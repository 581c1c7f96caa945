"""Springs and actuators along a step, with inputs and forces held on their sides of their limits."""

from __future__ import annotations

import numpy as np

from ....compiled import plain_array
from ....system.actuators import Actuators, DrivenActuators
from ....system.joint_forces import ForceRows, write_row_forces
from ....system.mechanisms.articulated import ArticulatedSystem
from ....system.system import Array
from ..runge_kutta import RungeKuttaStep
from .limits import State, at_limits, margins, sides

# columns of `ForceRows.law`, and limits that are none
_INPUT, _FORCE = slice(4, 6), slice(6, 8)
_UNLIMITED = np.array([-np.inf, np.inf])


class RowLimits:
    """The springs of a mechanism, or its actuators.

    Parameters
    ----------
    system : ArticulatedSystem
        The mechanism.
    actuators : Actuators, DrivenActuators or None
        Its actuators; None for its springs.

    Attributes
    ----------
    active : bool
        Whether some input or force has a limit that it can reach.
    """

    has_breaks = False

    def __init__(self, system: ArticulatedSystem, actuators: Actuators | DrivenActuators | None) -> None:
        self._system, driven = system, isinstance(actuators, DrivenActuators)
        self._driven = actuators if isinstance(actuators, DrivenActuators) else None
        self._actuators = actuators.actuators if isinstance(actuators, DrivenActuators) else actuators
        self._rows = system.spring_rows if self._actuators is None else self._actuators.table.actuators
        reached = np.where(reached_limits(self._rows, driven), self._rows.law[:, 4:], np.tile(_UNLIMITED, 2))
        # lower and upper limits, each of shape (k,)
        self._inputs, self._forces = reached[:, :2].T, reached[:, 2:].T
        self._free, self._sides = self._rows, np.zeros((2, len(reached)), int)
        self.active = bool(np.isfinite(reached).any())

    def hold(self, now: State, ahead: State, end: float) -> bool:
        """Let inputs and forces stay on the sides where they are ahead; return whether some are on others now."""
        rows, law = self._rows, self._rows.law.copy()
        law[:, _FORCE] = _UNLIMITED
        inputs = [sides(self._evaluated(state)[0][0], self._inputs) for state in (now, ahead)]
        if self._driven is not None:
            law[:, _INPUT] = _UNLIMITED
            law[:, 1] += law[:, 0] * at_limits(inputs[1], self._inputs)
            law[:, 0] *= inputs[1] == 0
        self._free = rows._replace(law=law)
        forces = [sides(self._evaluated(state)[1][0], self._forces) for state in (now, ahead)]
        held = law.copy()
        held[:, :4] *= (forces[1] == 0)[:, None]
        held[:, 1] += at_limits(forces[1], self._forces)
        self._replace(rows._replace(law=held))
        self._sides = np.array([inputs[1], forces[1]])
        return bool((inputs[0] != inputs[1]).any() or (forces[0] != forces[1]).any())

    def release(self) -> None:
        """Let the limits act."""
        self._replace(self._rows)

    def margins(self, states: State) -> Array:
        """Return what becomes negative where inputs and forces leave their sides; see `limits.margins`."""
        inputs, forces = self._evaluated(states)
        found = margins(forces, self._forces, self._sides[1])
        return found if self._driven is None else np.hstack([margins(inputs, self._inputs, self._sides[0]), found])

    def stays(self, step: RungeKuttaStep, start: State, own: slice) -> bool:
        """Return False: forces may leave their sides in any step."""
        return False

    def _evaluated(self, states: State) -> tuple[Array, Array]:
        """Return inputs, and forces without their limits of inputs on their sides, in p states, shapes (p, k)."""
        inputs, forces = np.empty((2, len(states.t), len(self._rows.law)))
        for given, force, t, q, v in zip(inputs, forces, *states, strict=True):
            if self._driven is not None:
                self._driven(float(t), q, v)
            given[:] = self._rows.ctrl[0]
            write_row_forces(self._free, 0, plain_array(q), plain_array(v), force)
        return inputs, forces

    def _replace(self, rows: ForceRows) -> None:
        if self._actuators is None:
            self._system.spring_rows = rows
        else:
            self._actuators.table = self._actuators.table._replace(actuators=rows)


def reached_limits(rows: ForceRows, driven: bool) -> Array:
    """Return which of the limits of inputs and forces something that varies can reach, shape (k, 4)."""
    reached: Array = np.isfinite(rows.law[:, 4:])
    given = (rows.law[:, 0] != 0.0) & driven
    reached[:, :2] &= given[:, None]
    reached[:, 2:] &= (given | rows.law[:, 2:4].any(axis=1))[:, None]
    return reached

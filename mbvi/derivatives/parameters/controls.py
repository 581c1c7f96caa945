"""Parameters of controls: constant torques that are added, and the gains and targets of `PDControl`."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from typing import Any

import numpy as np
import pinocchio as pin

from ...problem import Problem
from ...system.controls import PDControl
from ...system.mechanisms.articulated import ArticulatedSystem
from ...system.system import Array, Part
from ..motion.tracking import Tracking
from .parameter import ACCELERATION, Parameter, replaced_mechanism

# what names of these parameters begin with
OF_TORQUE = "torque of "
_STIFFNESS, _DAMPING, _TARGET = "control stiffness of ", "control damping of ", "control target of "
OF_CONTROL = _STIFFNESS, _DAMPING, _TARGET


class Torque(Parameter):
    """A constant torque that is added at a joint, a column for each of its velocities [N m, N].

    Parameters
    ----------
    problem : Problem
        The problem.
    part : Part
        The mechanism.
    joint : int
        The joint.
    """

    hides_control = True

    def __init__(self, problem: Problem, part: Part, joint: int) -> None:
        self._part, self._own = part, _velocities(part, joint)
        here = problem.q0[part.q : part.q + part.system.nq]
        reached = np.abs(np.asarray(part.system.metric(here).solve_rows(np.eye(part.system.nv)[self._own])))
        lengths = np.where(part.system.are_lengths(), problem.length, 1.0)
        self.sizes = ACCELERATION / (reached / lengths).max(axis=1)

    def add_force(self, t: float, q: Array, v: Array, a: Array, out: Array) -> None:
        np.fill_diagonal(out[self._part.v + self._own.start :], -1.0)

    def vary(self, replaced: dict[int, Any], change: Array) -> None:
        now = replaced.get(id(self._part.system), self._part.system)
        torque = np.zeros(now.nv)
        torque[self._own] = change
        replaced[id(self._part.system)] = replaced_mechanism(now, now.model, _pushed(now.control, torque))


class Gain(Parameter):
    """The stiffness, damping or target of one joint that a `PDControl` moves.

    Parameters
    ----------
    problem : Problem
        The problem.
    part : Part
        The mechanism.
    joint : int
        The joint, of one velocity.
    kind : str
        One of `OF_CONTROL`. A target varies by as much at all times of a trajectory.
    """

    def __init__(self, problem: Problem, part: Part, joint: int, kind: str) -> None:
        self._part, self._kind, self._tracking = part, kind, Tracking(part)
        assert isinstance(part.system, ArticulatedSystem) and isinstance(part.system.control, PDControl)
        table, rate = part.system.control.table, _velocities(part, joint).start
        self._rate, self._k = part.v + rate, rate - part.system.nv + table.torque.shape[1]
        unit = problem.length if part.system.are_lengths()[rate] else 1.0
        self._stiffness = float(table.stiffness[self._k])
        size = {_STIFFNESS: self._stiffness, _DAMPING: float(table.damping[self._k]), _TARGET: unit}[kind]
        # a gain of zero has no size of its own
        self.sizes = np.array([size]) if size > 0.0 else Torque(problem, part, joint).sizes / unit

    def add_force(self, t: float, q: Array, v: Array, a: Array, out: Array) -> None:
        off, slow, free = self._tracking.errors(t, q, v)
        by = {_STIFFNESS: off[self._k], _DAMPING: slow[self._k], _TARGET: self._stiffness}[self._kind]
        out[self._rate, 0] -= by * free[self._k]

    def vary(self, replaced: dict[int, Any], change: Array) -> None:
        now = replaced.get(id(self._part.system), self._part.system)
        control: PDControl = copy(now.control)
        field = {_STIFFNESS: "stiffness", _DAMPING: "damping", _TARGET: "q"}[self._kind]
        values = getattr(control.table, field).copy()
        values[..., self._k] += change[0]
        control.table = control.table._replace(**{field: values})
        control.q = control.table.q
        replaced[id(self._part.system)] = replaced_mechanism(now, now.model, control)


def has_gain(system: ArticulatedSystem, joint: int, kind: str) -> bool:
    """Return whether a joint of a mechanism is one that a `PDControl` moves, so that it has a parameter of a kind."""
    if not isinstance(system.control, PDControl) or system.model.nvs[joint] != 1:
        return False
    table = system.control.table
    k = system.model.idx_vs[joint] - system.nv + table.torque.shape[1]
    acts = k >= 0 and bool(table.stiffness[k] or table.damping[k])
    # the position of a joint without limits is not one coordinate
    return acts and (kind == _DAMPING or system.model.nqs[joint] == 1)


def _velocities(part: Part, joint: int) -> slice:
    """Return the velocities of a joint among those of its mechanism."""
    model: pin.Model = part.system.model
    return slice(model.idx_vs[joint], model.idx_vs[joint] + model.nvs[joint])


def _pushed(control: Callable[[float, Array, Array], Array] | None, torque: Array) -> Any:
    return (lambda t, q, v: torque) if control is None else (lambda t, q, v: control(t, q, v) + torque)

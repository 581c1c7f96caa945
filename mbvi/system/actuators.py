"""Actuators of a robot: forces along joints that inputs set, by name, by a function, or from a table."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from ..arguments import array, returned, shown
from ..errors import InputError
from .control_table import TRACKING, no_control
from .controls import HeldTorque, LoopControl
from .given import called, not_finite
from .joint_forces import JointForce, force_rows
from .system import Array


class Actuators(LoopControl):
    """The actuators of one robot, whose inputs stay as they are set.

    Parameters
    ----------
    forces : sequence of JointForce
        The actuators.
    ctrl : ndarray, shape (nu,)
        Their inputs.

    Attributes
    ----------
    names : tuple of str
        Of the actuators.
    ctrl : ndarray, shape (nu,)
        The inputs; may be written to between the steps of a `Simulator`.
    """

    def __init__(self, forces: Sequence[JointForce], ctrl: Array, model: pin.Model | None = None) -> None:
        self.forces, self._ctrl = tuple(forces), np.array([ctrl], dtype=float)
        self.names = tuple(force.name for force in forces)
        self._fits = model is not None
        if model is not None:
            rows = force_rows(forces, model, self._ctrl)
            self.table = no_control(model.nv)._replace(kind=TRACKING, actuators=rows)

    @property
    def ctrl(self) -> Array:
        """The inputs."""
        inputs: Array = self._ctrl[0]
        return inputs

    def fitted(self, model: pin.Model, name: str) -> Actuators:
        """Return the actuators as they act on a robot, each with inputs of its own."""
        return self if self._fits else Actuators(self.forces, self.ctrl, model)

    def holding(self, held: Mapping[str, Array]) -> Actuators:
        """Return the same for a robot of which some joints stay at given positions; see `JointForce.holding`."""
        return Actuators([force.holding(held) for force in self.forces], self.ctrl)

    def held(self, ctrl: Array, steps: int) -> HeldTorque:
        """Return a control with inputs that are constant in each step, shape (k, nu); see `HeldTorque`."""
        return HeldTorque(np.zeros((len(ctrl), 0)), steps, self.table.actuators._replace(ctrl=ctrl))


class DrivenActuators:
    """Actuators whose inputs are a function ctrl(t, q, v), shape (nu,), of the user."""

    def __init__(self, actuators: Actuators, function: Callable[..., Any]) -> None:
        self.actuators, self.function, self.names = actuators, function, actuators.names
        self.__name__ = called(function)

    def fitted(self, model: pin.Model, name: str) -> DrivenActuators:
        """Return the same on a robot."""
        return DrivenActuators(self.actuators.fitted(model, name), self.function)

    def holding(self, held: Mapping[str, Array]) -> DrivenActuators:
        """Return the same for a robot of which some joints stay."""
        return DrivenActuators(self.actuators.holding(held), self.function)

    def __call__(self, t: float, q: Array, v: Array) -> Array:
        """Return the torque at (t, q, v), shape (nv,) [N, N m]."""
        what = f"ctrl {called(self.function)} at t = {t:.6g} s"
        given, inputs = returned(self.function(t, q, v), what), self.actuators.ctrl
        if given.shape != inputs.shape:
            raise InputError(f"{what} returned shape {given.shape}; {inputs.shape} is expected")
        if not np.isfinite(given).all():
            raise not_finite(what, given, t, q, v)
        inputs[:] = given
        return self.actuators(t, q, v)


class Inputs(Mapping[str, float]):
    """The inputs of all actuators of a problem by name, in the order of the robots and of their files.

    `ctrl["hip"] = 0.3` sets one, `ctrl[:] = array` all of them, `ctrl[:]` is a copy of all. An input beyond its range
    acts as its bound. Where several robots have actuators the names are "robot/actuator".

    Parameters
    ----------
    robots : sequence of (str, Actuators or DrivenActuators)
        The robots that have actuators.

    Attributes
    ----------
    names : tuple of str
        Of the inputs.
    ranges : ndarray, shape (nu, 2)
        Lower and upper bound of each, infinite where there is none.
    """

    def __init__(self, robots: Sequence[tuple[str, Actuators | DrivenActuators]]) -> None:
        self._driven = [name for name, control in robots if isinstance(control, DrivenActuators)]
        self._parts = [control.actuators if isinstance(control, DrivenActuators) else control for _, control in robots]
        prefixes = [f"{name}/" if len(robots) > 1 else "" for name, _ in robots]
        each = [(prefix, f) for prefix, part in zip(prefixes, self._parts, strict=True) for f in part.forces]
        self.names = tuple(prefix + force.name for prefix, force in each)
        self.ranges = np.array([force.ctrl for _, force in each]).reshape(-1, 2)

    def __getitem__(self, key: Any) -> Any:
        """Return an input by name, or an array of those of a slice."""
        found = np.concatenate([np.zeros(0), *(part.ctrl for part in self._parts)])[self._place(key)]
        return float(found) if isinstance(key, str) else found

    def __setitem__(self, key: Any, value: Any) -> None:
        """Set an input by name, or those of a slice.

        Raises
        ------
        InputError
            If there is no such actuator, a shape does not fit, a number is not finite, or a function computes inputs.
        """
        if self._driven:
            raise InputError(f"the inputs of {', '.join(self._driven)} are computed by a function")
        new, place = self[:], self._place(key)
        given = array(value, "ctrl")
        if given.shape not in ((), new[place].shape):
            raise InputError(f"ctrl has shape {given.shape}; it must have {new[place].shape}")
        new[place], done = given, 0
        for part in self._parts:
            part.ctrl[:] = new[done : done + len(part.names)]
            done += len(part.names)

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __len__(self) -> int:
        return len(self.names)

    def __repr__(self) -> str:
        return f"Inputs({dict(self)})"

    def _place(self, key: Any) -> int | slice:
        if isinstance(key, slice):
            return key
        if key not in self.names:
            raise InputError(f"there is no actuator {shown(key)}; known are {', '.join(self.names) or 'none'}")
        return self.names.index(key)

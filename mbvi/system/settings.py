"""The inputs and torques that users set between runs, as they were in a run."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from .actuators import Actuators
from .controls import ConstantTorque
from .hinged import HingedSystem
from .parts import parts_of
from .system import Array, System


class Settings:
    """The present inputs of actuators and torques of `ConstantTorque` of a system, for what is computed later."""

    def __init__(self, system: System) -> None:
        self._system, self._values = system, [one.copy() for one in _settable(system)]

    @contextmanager
    def restored(self) -> Iterator[None]:
        """Let these act within the block, and those that act now after it."""
        now = [one.copy() for one in _settable(self._system)]
        self._set(self._values)
        try:
            yield
        finally:
            self._set(now)

    def _set(self, values: list[Array]) -> None:
        for one, value in zip(_settable(self._system), values, strict=True):
            one[:] = value


def _settable(system: System) -> list[Array]:
    """Return the arrays that users set, in a fixed order."""
    controls = [getattr(part, "control", None) for part in parts_of(system)]
    controls += system.hinges.controls if isinstance(system, HingedSystem) else ()
    inputs = [one.ctrl for one in controls if isinstance(one, Actuators)]
    return inputs + [one.torque for one in controls if isinstance(one, ConstantTorque)]

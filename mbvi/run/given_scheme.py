"""The check of the argument `scheme`, and the adapter for schemes of users' own classes."""

from __future__ import annotations

from typing import Any

from ..arguments import shown
from ..errors import InputError
from ..problem import Problem
from ..projection import Projector
from ..schemes import OwnStepsScheme, Scheme, Step, Timing
from ..system.system import Array


class UserScheme(Scheme):
    """A scheme given as any object with a method `step`; its other attributes may be missing.

    Parameters
    ----------
    given : object
        The user's object. Its attributes `timing`, or `jump` and `whole_steps`, `project_positions`, `check` and
        `shortened` are used if it has them.
    """

    def __init__(self, given: Any) -> None:
        self.given = given
        timing = Timing(getattr(given, "jump", 1.0), getattr(given, "whole_steps", False))
        self.timing = getattr(given, "timing", timing)
        self.project_positions = getattr(given, "project_positions", False)

    @property
    def name(self) -> str:
        """The name of the user's class."""
        return type(self.given).__name__

    def options(self) -> dict[str, Any]:
        """Return the argument of this adapter."""
        return {"given": self.given}

    def __repr__(self) -> str:
        return repr(self.given)

    def check(self, problem: Problem) -> None:
        """See `Scheme`."""
        if hasattr(self.given, "check"):
            self.given.check(problem)

    def step(self, problem: Problem, t: float, q: Array, v: Array, h: float, projector: Projector) -> Step:
        """See `Scheme`."""
        new: Step = self.given.step(problem, t, q, v, h, projector)
        return new

    def shortened(self, problem: Problem, t: float, state: Step, h: float, projector: Projector) -> Step:
        """See `Scheme`."""
        if not hasattr(self.given, "shortened"):
            return super().shortened(problem, t, state, h, projector)
        new: Step = self.given.shortened(problem, t, state, h, projector)
        return new


def checked_scheme(given: object) -> Scheme | OwnStepsScheme:
    """Return the scheme that a user gives, adapted where it is of the user's own class.

    Raises
    ------
    InputError
        If it is no scheme: a class, or an object without a method `step`.
    """
    if isinstance(given, Scheme | OwnStepsScheme):
        return given
    if isinstance(given, type) or not hasattr(given, "step"):
        raise InputError(f"scheme must be an object such as mbvi.Paoli(); got {shown(given)}")
    return UserScheme(given)

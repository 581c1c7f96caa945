"""Where systems of users come in: the check of the argument, and the adapter for objects of their own classes."""

from __future__ import annotations

from typing import Any

from ..arguments import shown
from ..errors import InputError
from .system import System

_NEEDED = ("nq", "nv", "integrate", "metric")


class GivenSystem(System):
    """A system given as any object with the methods of `System`; what the object lacks has the default of `System`.

    Parameters
    ----------
    given : object
        The user's object.
    """

    def __init__(self, given: Any) -> None:
        self.given = given
        for name in (*System.__annotations__, *vars(System)):
            if not name.startswith("_") and hasattr(given, name):
                setattr(self, name, getattr(given, name))

    def __reduce__(self) -> tuple[type, tuple[Any]]:
        return type(self), (self.given,)

    def __repr__(self) -> str:
        return repr(self.given)


def checked_system(given: object) -> System:
    """Return the system that a user gives, adapted where it is of the user's own class.

    Raises
    ------
    InputError
        If it is no system.
    """
    if isinstance(given, System):
        return given
    if isinstance(given, type) or not all(hasattr(given, name) for name in _NEEDED):
        raise InputError(f"system must be a system such as mbvi.LagrangianSystem(...); got {shown(given)}")
    return GivenSystem(given)

"""The points of a study: a grid, a table, a list or an array of samples."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arguments import shown
from ..errors import InputError
from .fingerprint import digest

# more cannot be stored; numbers of runs are parts of file names
_MOST = 10**9
# columns of the result that are no parameters
OWN_COLUMNS = ("run", "status", "message", "notes", "cpu", "host")


@dataclass(frozen=True)
class Points:
    """The points of a study, of which one is made at a time.

    Attributes
    ----------
    columns : dict of str to sequence
        The values of each parameter: on a grid those of its axis, else one for each point.
    grid : bool
        Whether the points are all combinations of the values, the last parameter changing first.
    """

    columns: dict[str, Sequence[Any]]
    grid: bool

    def __len__(self) -> int:
        if not self.columns:
            return 0
        return math.prod(self.shape) if self.grid else self.shape[0]

    @property
    def shape(self) -> tuple[int, ...]:
        """The number of values of each parameter."""
        return tuple(len(values) for values in self.columns.values())

    def __getitem__(self, index: int) -> dict[str, Any]:
        """Return the arguments of one run."""
        if not 0 <= index < len(self):
            raise IndexError(index)
        places: Any = np.unravel_index(index, self.shape) if self.grid else [index] * len(self.columns)
        return {name: _plain(values[int(k)]) for (name, values), k in zip(self.columns.items(), places, strict=True)}

    def digest(self) -> str:
        """Return a digest of all values."""
        numbers = {name: isinstance(v, np.ndarray) and v.dtype.kind in "bif" for name, v in self.columns.items()}
        values = {name: v if numbers[name] else [_plain(x) for x in v] for name, v in self.columns.items()}
        return digest([self.grid, values])


def points_of(parameters: Any, make: Callable[..., Any]) -> Points:
    """Return the points that a user gives.

    Parameters
    ----------
    parameters : mapping, DataFrame, array of shape (n, d), or list of mappings
        A mapping of names to sequences is a grid, a row of a table a point; the columns of an array are the first
        parameters of `make`.
    make : callable
        Function of a point.

    Raises
    ------
    InputError
        If the parameters are something else, are empty, or do not fit `make`.
    """
    try:
        points = _points(parameters, make)
        count = len(points)
    except InputError:
        raise
    except Exception as error:
        # objects of users may raise anything
        raise InputError(
            "parameters must be a mapping of names to values, a table, an array or a list of points; got "
            f"{shown(parameters)}"
        ) from error
    if not 0 < count <= _MOST:
        raise InputError(f"parameters must give 1 to {_MOST} points; got {count}")
    for name in points.columns:
        if not isinstance(name, str) or not name.isidentifier() or name in OWN_COLUMNS:
            raise InputError(
                f"parameters must have names of arguments of make, and not {OWN_COLUMNS}; got {shown(name)}"
            )
    try:
        inspect.signature(make).bind(**points[0], **({"rng": None} if takes_rng(make) else {}))
    except TypeError as error:
        raise InputError(f"make cannot be called with {', '.join(points.columns)}: {error}") from error
    return points


def takes_rng(make: Callable[..., Any]) -> bool:
    """Return whether a function has the argument `rng`."""
    known = inspect.signature(make).parameters.values()
    return any(p.name == "rng" or p.kind is p.VAR_KEYWORD for p in known)


def _points(parameters: Any, make: Callable[..., Any]) -> Points:
    if isinstance(parameters, Mapping):
        return Points({name: _sequence(values, name) for name, values in parameters.items()}, True)
    if isinstance(parameters, np.ndarray):
        if parameters.ndim != 2 or parameters.dtype.kind not in "bif":
            raise InputError(f"an array of parameters must be numbers of shape (n, d); got {shown(parameters)}")
        names = [name for name in inspect.signature(make).parameters if name != "rng"]
        if parameters.shape[1] > len(names):
            raise InputError(f"an array of parameters has {parameters.shape[1]} columns; make takes {len(names)}")
        return Points(dict(zip(names, parameters.T, strict=False)), False)
    if hasattr(parameters, "columns") and hasattr(parameters, "to_dict"):
        return Points({name: parameters[name].to_numpy() for name in parameters.columns}, False)
    if not isinstance(parameters, Sequence) or not all(isinstance(point, Mapping) for point in parameters):
        raise InputError(
            "parameters must be a mapping of names to values, a table, an array or a list of points; got "
            f"{shown(parameters)}"
        )
    names = list(parameters[0]) if parameters else []
    if any(set(point) != set(names) for point in parameters):
        raise InputError("every point must have the same names")
    return Points({name: [point[name] for point in parameters] for name in names}, False)


def _sequence(values: Any, name: Any) -> Sequence[Any]:
    if isinstance(values, str | bytes) or not hasattr(values, "__len__") or not hasattr(values, "__getitem__"):
        raise InputError(f"parameters[{shown(name)}] must be a sequence of values; got {shown(values)}")
    found: Sequence[Any] = values if hasattr(values, "dtype") else list(values)
    return found


def _plain(value: Any) -> Any:
    """Return a number of numpy as one of Python."""
    return value.item() if isinstance(value, np.generic) else value

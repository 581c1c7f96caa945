"""Checks of arrays: each returns a new array of floats or integers, or raises `InputError`."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from numbers import Real
from typing import Any

import numpy as np

from ..errors import InputError
from .numbers import LARGEST, LARGEST_INTEGER, SMALLEST, shown

Array = np.ndarray

# arrays of so few entries are checked without numpy
_FEW = 32


def array(value: Any, name: str, shape: Sequence[int | str] | None = None, *, bounded: bool = True) -> Array:
    """Return a new array of finite numbers.

    Parameters
    ----------
    value : array_like
        Numbers: no bool, no text, no masked or complex entries.
    name : str
        Name of the parameter.
    shape : sequence of int or str, optional
        The shape it must have; a letter stands for any number of one or more.
    bounded : bool
        Whether entries above 1e40 are refused.

    Raises
    ------
    InputError
        If the value is no such array.
    """
    numbers = _numbers(value)
    if numbers is None:
        wanted = "numbers" if shape is None else f"numbers of shape {_shape(shape)}"
        raise InputError(f"{name} must be {wanted}; got {shown(value)}")
    if shape is not None and not _fits(numbers.shape, shape):
        raise InputError(f"{name} has shape {numbers.shape}; it must have {_shape(shape)}")
    # written so that a NaN is refused too
    # the sum of magnitudes is cheap for few entries, bounds each of them, and is NaN if one is
    largest = LARGEST if bounded else np.finfo(float).max
    few = numbers.size <= _FEW and sum(map(abs, numbers.ravel().tolist())) <= largest
    if not few and not np.abs(numbers).max(initial=0.0) <= largest:
        wrong = ~(np.abs(numbers) <= largest)
        at = f"entry {np.argwhere(wrong)[0].tolist()} is" if numbers.ndim else "got"
        size = f", of magnitude {LARGEST:g} at most" if bounded else ""
        raise InputError(f"{name} must be finite{size}; {at} {numbers[wrong][0]:g}")
    return numbers


def vector(value: Sequence[float] | Array, name: str, size: int = 3) -> Array:
    """Return finite numbers, shape (size,)."""
    return array(value, name, (size,))


def vectors(value: Array | Sequence[Sequence[float]], name: str, count: int | None = None) -> Array:
    """Return vectors of three numbers, shape (n, 3), of which there is one at least, or `count`."""
    return array(value, name, ("n" if count is None else count, 3))


def all_positive(value: float | Sequence[float] | Array, name: str, count: int) -> Array:
    """Return `count` positive numbers, shape (count,), from as many or from one."""
    each = array(value, name)
    if each.shape not in ((), (count,)):
        raise InputError(f"{name} has shape {each.shape}; it must be one number or {count} of them")
    wrong = each[each < SMALLEST]
    if wrong.size:
        raise InputError(f"every {name} must be positive, from {SMALLEST:g} to {LARGEST:g}; got {wrong[0]:g}")
    return np.broadcast_to(each, (count,)).copy()


def restitution(value: float | Sequence[float] | Array, count: int, name: str = "restitution e") -> Array:
    """Return e as an array of `count` numbers in [0, 1], from as many or from one."""
    e = array(value, name)
    if e.shape not in ((), (count,)):
        raise InputError(f"{name} has shape {e.shape}; it must be one number or one a constraint ({count})")
    if ((e < 0.0) | (e > 1.0)).any():
        raise InputError(f"{name} must lie in [0, 1]; got {shown(value)}")
    return np.broadcast_to(e, (count,)).copy()


def friction(value: float | Sequence[float] | Array, count: int, name: str = "friction") -> Array:
    """Return mu as an array of `count` numbers that are not negative, from as many or from one."""
    mu = array(value, name)
    if mu.shape not in ((), (count,)):
        raise InputError(f"{name} has shape {mu.shape}; it must be one number or one a constraint ({count})")
    if (mu < 0.0).any():
        raise InputError(f"{name} must be at least 0; got {shown(value)}")
    return np.broadcast_to(mu, (count,)).copy()


def integers(value: Any, name: str, shape: Sequence[int | str]) -> Array:
    """Return an array of integers; floats are refused."""
    array(value, name, shape)
    given = np.asarray(value)
    if given.dtype.kind not in "iu" or given.max(initial=0) > LARGEST_INTEGER:
        raise InputError(f"{name} must be integers of shape {_shape(shape)}; got {shown(value)}")
    return given.astype(np.int64)


def returned(value: Any, name: str) -> Array:
    """Return the result of a user's function as an array of floats, NaN and infinity included."""
    # the usual kinds first, because a run calls this at every step
    if type(value) is np.ndarray and value.dtype == np.float64:
        return value
    if isinstance(value, float):
        return np.asarray(value, dtype=float)
    numbers = _numbers(value)
    if numbers is None:
        raise InputError(f"{name} must return real numbers; it returned {shown(value)}")
    return numbers


def all_finite(values: Array) -> bool:
    """Return whether all of few numbers are finite; cheap, because a run calls it at every step."""
    numbers = values.ravel()
    # a sum may overflow although all numbers are finite
    return isfinite(sum(numbers.tolist())) or bool(np.isfinite(numbers).all())


def _numbers(value: Any) -> Array | None:
    """Return real numbers as a new array, None if an entry is no real number."""
    if type(value) is np.ndarray and value.dtype == np.float64:
        return value.copy()
    try:
        given = np.asarray(value)
        if given.dtype.kind not in "iufO" or np.ma.is_masked(value):
            return None
        # numpy converts a bool in a list of numbers: such lists are refused
        if given.dtype.kind == "O" or (given is not value and not hasattr(value, "__array__")):
            entries = np.asarray(value, dtype=object).ravel().tolist()
            if not all(issubclass(kind, Real) and not issubclass(kind, bool) for kind in set(map(_kind, entries))):
                return None
        with np.errstate(over="ignore"):
            return np.array(given, dtype=float, order="C", subok=False)
    except OverflowError:
        return np.full(np.shape(value), np.inf)
    # a user's __array__ or __len__ may raise anything
    except Exception:
        return None


def _kind(entry: Any) -> type:
    return entry.dtype.type if isinstance(entry, Array) else type(entry)


def _fits(shape: tuple[int, ...], wanted: Sequence[int | str]) -> bool:
    if len(shape) != len(wanted):
        return False
    return all(n == m if isinstance(m, int) else n > 0 for n, m in zip(shape, wanted, strict=True))


def _shape(wanted: Sequence[int | str]) -> str:
    return f"({', '.join(map(str, wanted))}{',' * (len(wanted) == 1)})"

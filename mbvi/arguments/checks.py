"""Checks of arguments: each returns the value in the form that the library computes with, or raises `InputError`.

All public functions use these. A message says which parameter it is about, what that must be, and what was given.
"""

from __future__ import annotations

import inspect
import os
import reprlib
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from math import isfinite
from numbers import Integral, Real
from pathlib import Path
from typing import Any, SupportsFloat, TypeVar

import numpy as np

from ..errors import InputError

Array = np.ndarray
T = TypeVar("T")

# numbers beyond these overflow or vanish once they are multiplied into volumes and moments of inertia
LARGEST, SMALLEST = 1e40, 1e-40
# integers above this are not exact as floats
_LARGEST_INTEGER = 2**53
# entries that are looked at without numpy
_FEW = 32
_PARTS = "/[|"
# in characters; in bytes, as of the operating system
_LONGEST_NAME, _LONGEST_PATH = 200, 4096

_short = reprlib.Repr()
_short.maxstring = _short.maxother = 78


def shown(value: object) -> str:
    """Return how a value is shown in a message: its repr in one line of at most about 80 characters."""
    try:
        text = " ".join(_short.repr(value).split())
    # a value's own repr may raise anything
    except Exception:
        text = f"an object of type {type(value).__name__}"
    return text if len(text) <= 80 else text[:77] + "..."


def number(value: SupportsFloat, name: str) -> float:
    """Return a real number as a float, infinite where no float holds it; no bool, no text."""
    given = value
    if isinstance(value, np.ndarray) and value.ndim == 0 and not isinstance(value, np.ma.MaskedArray):
        value = value[()]
    if not isinstance(value, Real) or isinstance(value, bool):
        raise InputError(f"{name} must be a number; got {shown(given)}")
    try:
        with np.errstate(over="ignore"):
            return float(value)
    except OverflowError:
        return np.inf
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} must be a number; got {shown(given)}") from error


def finite(value: SupportsFloat, name: str) -> float:
    """Return a number of magnitude 1e40 at most."""
    x = number(value, name)
    # written so that a NaN is refused too
    if not abs(x) <= LARGEST:
        raise InputError(f"{name} must be a finite number, of magnitude {LARGEST:g} at most; got {shown(value)}")
    return x


def positive(value: SupportsFloat, name: str) -> float:
    """Return a positive number from 1e-40 to 1e40."""
    x = number(value, name)
    if not SMALLEST <= x <= LARGEST:
        raise InputError(f"{name} must be positive and finite, from {SMALLEST:g} to {LARGEST:g}; got {shown(value)}")
    return x


def not_negative(value: SupportsFloat, name: str) -> float:
    """Return zero or a positive number of 1e40 at most."""
    x = number(value, name)
    if not 0.0 <= x <= LARGEST:
        raise InputError(f"{name} must be zero or a positive, finite number; got {shown(value)}")
    return x


def between(value: SupportsFloat, name: str, low: float, high: float, *, ends: bool = True) -> float:
    """Return a number between two others, `ends` included or not."""
    x = number(value, name)
    if not (low <= x <= high and (ends or low < x < high)):
        where = f"[{low:g}, {high:g}]" if ends else f"({low:g}, {high:g}), its ends excluded"
        raise InputError(f"{name} must lie in {where}; got {shown(value)}")
    return x


def integer(value: SupportsFloat, name: str, least: int = 0) -> int:
    """Return an integer from `least` on; a float that is one is taken."""
    x = number(value, name)
    if not least <= x <= _LARGEST_INTEGER or x != int(x):
        kind = {0: "an integer, zero or positive", 1: "a positive integer"}.get(least, f"an integer of {least} or more")
        raise InputError(f"{name} must be {kind}; got {shown(value)}")
    return int(x)


def generator(seed: int) -> np.random.Generator:
    """Return the random numbers of a seed: an integer, zero or positive, of any size."""
    if not isinstance(seed, Integral) or isinstance(seed, bool) or seed < 0:
        raise InputError(f"seed must be an integer, zero or positive; got {shown(seed)}")
    return np.random.default_rng(int(seed))


def boolean(value: bool, name: str) -> bool:
    """Return True or False."""
    if not isinstance(value, bool | np.bool_):
        raise InputError(f"{name} must be True or False; got {shown(value)}")
    return bool(value)


def function(value: T, name: str, form: str) -> T:
    """Return a function that takes the arguments of a form such as "control(t, q, v) -> tau"."""
    if not callable(value) or isinstance(value, type):
        raise InputError(f"{name} must be a function {form}; got {shown(value)}")
    count = form.partition("(")[2].partition(")")[0].count(",") + 1
    try:
        signature = inspect.signature(value)
    # of some compiled functions Python knows none
    except (ValueError, TypeError):
        return value
    try:
        signature.bind(*[None] * count)
    except TypeError as error:
        raise InputError(f"{name} must be a function {form}; {shown(value)} takes other arguments") from error
    return value


def returned(value: Any, name: str) -> Array:
    """Return what a user's function returned as an array of floats, NaN and infinity included."""
    # the usual ones first: a run calls this at every step
    if type(value) is np.ndarray and value.dtype == np.float64:
        return value
    if isinstance(value, float):
        return np.asarray(value, dtype=float)
    numbers = _numbers(value)
    if numbers is None:
        raise InputError(f"{name} must return real numbers; it returned {shown(value)}")
    return numbers


def all_finite(values: Array) -> bool:
    """Return whether all of few numbers are finite; cheap, for a run calls it at every step."""
    numbers = values.ravel()
    # a sum that overflows is looked at again
    return isfinite(sum(numbers.tolist())) or bool(np.isfinite(numbers).all())


def choice(value: str, name: str, known: Collection[str]) -> str:
    """Return one of the known words."""
    if not isinstance(value, str) or value not in known:
        raise InputError(f"{name} must be one of {', '.join(map(repr, known))}; got {shown(value)}")
    return value


def optional(check: Callable[..., T], value: Any, *more: Any) -> T | None:
    """Return None for None, else what a check returns for the value and its other arguments."""
    return None if value is None else check(value, *more)


def printable(value: str, name: str) -> str:
    """Return text of which every character can be printed."""
    if not isinstance(value, str):
        raise InputError(f"{name} must be text; got {shown(value)}")
    # control characters and lone surrogates neither print nor go into a file
    if not 0 < len(value) <= _LONGEST_NAME or any(not c.isprintable() for c in value):
        raise InputError(f"{name} must be 1 to {_LONGEST_NAME} characters that can be printed; got {shown(value)}")
    return value


def label(value: str, name: str = "name") -> str:
    """Return the name of a thing: text that can be printed, without the characters that separate a thing's parts."""
    text = printable(value, name)
    if set(_PARTS) & set(text):
        raise InputError(
            f"{name} must not hold one of {' '.join(_PARTS)}, which part a thing from its pieces; got {shown(value)}"
        )
    return text


def made_label(text: str) -> str:
    """Return text that a file gives as a name, with _ for what a name must not hold."""
    return "".join(c if c.isprintable() and c not in _PARTS else "_" for c in text)[:_LONGEST_NAME]


def file_path(value: str | os.PathLike[str], name: str = "path") -> Path:
    """Return a path; whether there is a file is not asked."""
    try:
        text = os.fspath(value)
        if not isinstance(text, str):
            raise TypeError("bytes")
    # a user's __fspath__ may raise anything
    except Exception as error:
        raise InputError(f"{name} must be a path, as text or pathlib.Path; got {shown(value)}") from error
    try:
        usable = b"\0" not in os.fsencode(text) and 0 < len(os.fsencode(text)) < _LONGEST_PATH
    except UnicodeError:
        usable = False
    if not usable:
        raise InputError(
            f"{name} must be a path: not empty or too long, no NUL, no lone surrogates; got {shown(value)}"
        )
    return Path(text)


def several_names(value: Iterable[str], name: str) -> tuple[str, ...]:
    """Return several names, as a tuple."""
    if isinstance(value, str):
        raise InputError(f"{name} must be a list of names; got one text: write {name}=[{shown(value)}]")
    if not isinstance(value, list | tuple | set | frozenset) and not (isinstance(value, Array) and value.ndim == 1):
        raise InputError(f"{name} must be a list of names; got {shown(value)}")
    wrong = [one for one in value if not isinstance(one, str)]
    if wrong:
        raise InputError(f"{name} must hold names only; got {shown(wrong[0])} among them")
    return tuple(value)


def numbers_by_name(value: Mapping[str, float], name: str) -> dict[str, float]:
    """Return finite numbers by name."""
    if not isinstance(value, Mapping):
        raise InputError(f"{name} must be a mapping of names to numbers, {{'knee': 0.4}}; got {shown(value)}")
    wrong = [key for key in value if not isinstance(key, str)]
    if wrong:
        raise InputError(f"{name} must have names as its keys; got {shown(wrong[0])}")
    return {key: finite(x, f"{name}[{shown(key)}]") for key, x in value.items()}


def array(value: Any, name: str, shape: Sequence[int | str] | None = None, *, bounded: bool = True) -> Array:
    """Return a new array of finite numbers.

    Parameters
    ----------
    value : array_like
        Numbers: no bool, no text, no masked or complex entries.
    name : str
        Of the parameter.
    shape : sequence of int or str, optional
        The shape it must have; a letter stands for any number of one or more.
    bounded : bool
        Whether entries above 1e40 are refused.

    Raises
    ------
    InputError
        If it is something else.
    """
    numbers = _numbers(value)
    if numbers is None:
        wanted = "numbers" if shape is None else f"numbers of shape {_shape(shape)}"
        raise InputError(f"{name} must be {wanted}; got {shown(value)}")
    if shape is not None and not _fits(numbers.shape, shape):
        raise InputError(f"{name} has shape {numbers.shape}; it must have {_shape(shape)}")
    # written so that a NaN is refused too
    # a sum of few is cheap, and none of them is larger than it; a NaN among them makes it one
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
    """Return a positive number each, shape (count,), from as many or from one."""
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


def integers(value: Any, name: str, shape: Sequence[int | str]) -> Array:
    """Return integers, as an array of such; no floats."""
    array(value, name, shape)
    given = np.asarray(value)
    if given.dtype.kind not in "iu" or given.max(initial=0) > _LARGEST_INTEGER:
        raise InputError(f"{name} must be integers of shape {_shape(shape)}; got {shown(value)}")
    return given.astype(np.int64)


def _numbers(value: Any) -> Array | None:
    """Return real numbers as a new array, None if some are none."""
    if type(value) is np.ndarray and value.dtype == np.float64:
        return value.copy()
    try:
        given = np.asarray(value)
        if given.dtype.kind not in "iufO" or np.ma.is_masked(value):
            return None
        # of other things than arrays numpy would take a bool among numbers for one
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

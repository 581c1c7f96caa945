"""Checks of single numbers: each returns the number as a float or an int, or raises `InputError`.

A message names the parameter, the numbers it may be, and the value that was given.
"""

from __future__ import annotations

import reprlib
from numbers import Integral, Real
from typing import SupportsFloat

import numpy as np

from ..errors import InputError

# numbers beyond these overflow or vanish once they are multiplied into volumes and moments of inertia
LARGEST, SMALLEST = 1e40, 1e-40
# integers above this are not exact as floats
LARGEST_INTEGER = 2**53

_short = reprlib.Repr()
_short.maxstring = _short.maxother = 78


def shown(value: object) -> str:
    """Return the text of a value in a message: its repr in one line of at most 80 characters."""
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
    """Return an integer of at least `least`; a float with an integer value is accepted."""
    x = number(value, name)
    if LARGEST_INTEGER < x < float("inf"):
        raise InputError(f"{name} must be {LARGEST_INTEGER} at most; got {shown(value)}")
    if not least <= x <= LARGEST_INTEGER or x != int(x):
        kind = {0: "an integer, zero or positive", 1: "a positive integer"}.get(least, f"an integer of {least} or more")
        raise InputError(f"{name} must be {kind}; got {shown(value)}")
    return int(x)


def generator(seed: int) -> np.random.Generator:
    """Return the random numbers of a seed: an integer, zero or positive, of any size."""
    if not isinstance(seed, Integral) or isinstance(seed, bool) or seed < 0:
        raise InputError(f"seed must be an integer, zero or positive; got {shown(seed)}")
    return np.random.default_rng(int(seed))

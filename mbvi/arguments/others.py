"""Checks of functions, words, names and paths: each returns the checked value, or raises `InputError`."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ..errors import InputError
from .arrays import Array
from .numbers import finite, shown

T = TypeVar("T")

# characters that separate the parts of a thing's name
_SEPARATORS = "/[|"
# in characters; in bytes, as operating systems limit it
_LONGEST_NAME, _LONGEST_PATH = 200, 4096


def optional(check: Callable[..., T], value: Any, *more: Any) -> T | None:
    """Return None for None, else the result of a check of the value."""
    return None if value is None else check(value, *more)


def boolean(value: bool, name: str) -> bool:
    """Return True or False."""
    if not isinstance(value, bool | np.bool_):
        raise InputError(f"{name} must be True or False; got {shown(value)}")
    return bool(value)


def function(value: T, name: str, form: str) -> T:
    """Return a function that can be called as in a form such as "control(t, q, v) -> tau"."""
    if not callable(value) or isinstance(value, type):
        raise InputError(f"{name} must be a function {form}; got {shown(value)}")
    count = form.partition("(")[2].partition(")")[0].count(",") + 1
    try:
        signature = inspect.signature(value)
    # some compiled functions have no signature
    except (ValueError, TypeError):
        return value
    try:
        signature.bind(*[None] * count)
    except TypeError as error:
        raise InputError(f"{name} must be a function {form}; {shown(value)} takes other arguments") from error
    return value


def choice(value: str, name: str, known: Collection[str]) -> str:
    """Return one of the known words."""
    if not isinstance(value, str) or value not in known:
        raise InputError(f"{name} must be one of {', '.join(map(repr, known))}; got {shown(value)}")
    return value


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
    if set(_SEPARATORS) & set(text):
        raise InputError(
            f"{name} must not hold one of {' '.join(_SEPARATORS)}, which separate the parts of a name; "
            f"got {shown(value)}"
        )
    return text


def made_label(text: str) -> str:
    """Return a name from a file, with _ in place of characters that a name must not hold."""
    return "".join(c if c.isprintable() and c not in _SEPARATORS else "_" for c in text)[:_LONGEST_NAME]


def file_path(value: str | os.PathLike[str], name: str = "path") -> Path:
    """Return a path; the file need not exist."""
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


def not_found(path: str | os.PathLike[str]) -> str:
    """Return why a path leads to no file: there is none, or something on the way to it does not let this process by."""
    try:
        os.stat(path)
    except (FileNotFoundError, NotADirectoryError):
        pass
    except OSError as error:
        return f"{os.fspath(path)} cannot be read: {error.strerror}"
    return f"no such file: {os.fspath(path)}"


def listed(names: Sequence[str], most: int) -> str:
    """Return names in words: so many, and how many more there are."""
    more = len(names) - most
    return ", ".join(names[:most]) + (f" and {more} more" if more > 0 else "")


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

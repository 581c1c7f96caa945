"""Digests of values and of functions: the same in every process, different where a result could differ."""

from __future__ import annotations

import functools
import types
from collections.abc import Callable, Iterator, Mapping
from hashlib import sha256
from typing import Any

import numpy as np

from ..arguments import shown
from ..errors import InputError
from ..problem import Problem
from ..scene.saved.description import describe

# what else a function names may change while it runs, such as a list that keeps what was built
_CONSTANTS = (bool, int, float, complex, str, bytes, type(None), tuple, frozenset, np.ndarray, np.generic, Problem)


def digest(value: Any) -> str:
    """Return a digest of numbers, texts, arrays, containers, functions, and objects whose repr states what they are.

    Raises
    ------
    InputError
        If the value contains itself, or an object that cannot be shown.
    """
    found = sha256()
    try:
        for part in _parts(value, set()):
            found.update(len(part).to_bytes(8, "little"))
            found.update(part)
    # objects of users may raise anything, or contain themselves
    except Exception as error:
        raise InputError(f"{shown(value)} cannot be described: {type(error).__name__}") from error
    return found.hexdigest()[:16]


def _parts(value: Any, seen: set[int]) -> Iterator[bytes]:
    """Yield what decides about a value; `seen` holds the functions that are being described."""
    if isinstance(value, np.ndarray) and value.dtype != object:
        yield f"array {value.dtype} {value.shape}".encode()
        yield np.ascontiguousarray(value).tobytes()
    elif isinstance(value, float):
        yield f"float {float(value).hex()}".encode()
    elif isinstance(value, Mapping):
        yield f"mapping {len(value)}".encode()
        for key, item in value.items():
            yield from _parts(key, seen)
            yield from _parts(item, seen)
    elif isinstance(value, list | tuple | np.ndarray):
        yield f"sequence {len(value)}".encode()
        for item in value:
            yield from _parts(item, seen)
    elif isinstance(value, set | frozenset):
        yield repr(sorted(map(repr, value))).encode()
    elif isinstance(value, types.CodeType):
        yield from _code(value, seen)
    elif isinstance(value, Problem):
        yield describe(value).encode()
        yield from _parts([value.q0, value.v0, value.t0, value.restitution, value.friction], seen)
    elif callable(value):
        yield from _function(value, seen)
    else:
        yield _shown(value).encode()


def _shown(value: Any) -> str:
    kind = f"{type(value).__module__}.{type(value).__qualname__}"
    text = repr(value)
    # an address is another one in each process
    return kind if " at 0x" in text else f"{kind} {text}"


def _function(given: Callable[..., Any], seen: set[int]) -> Iterator[bytes]:
    """Yield the code of a function with its defaults and what it encloses, and the same of functions beside it."""
    if id(given) in seen:
        return
    seen.add(id(given))
    if isinstance(given, functools.partial):
        yield from _parts([given.func, given.args, given.keywords], seen)
        return
    function = getattr(given, "__wrapped__", given)
    if isinstance(function, types.MethodType):
        yield from _parts(vars(function.__self__) if hasattr(function.__self__, "__dict__") else None, seen)
        function = function.__func__
    if isinstance(function, type):
        yield function.__qualname__.encode()
        for name, item in vars(function).items():
            if isinstance(item, types.FunctionType):
                yield name.encode()
                yield from _function(item, seen)
        return
    if not isinstance(function, types.FunctionType):
        # an object that can be called, or a function of another language
        own = vars(type(function)).get("__call__")
        yield _shown(function).encode()
        if isinstance(own, types.FunctionType):
            yield from _parts([vars(function), own], seen)
        return
    yield from _parts([function.__defaults__, function.__kwdefaults__], seen)
    yield from _parts([cell.cell_contents for cell in function.__closure__ or ()], seen)
    yield from _code(function.__code__, seen, function.__doc__)
    for name in sorted(_names(function.__code__)):
        if name in function.__globals__:
            yield from _named(name, function.__globals__[name], function.__module__, seen)


def _named(name: str, value: Any, module: str, seen: set[int]) -> Iterator[bytes]:
    """Yield a constant or a function of the same module that a function names; other modules have their versions."""
    if isinstance(value, _CONSTANTS):
        yield name.encode()
        yield from _parts(value, seen)
    elif callable(value) and getattr(value, "__module__", None) == module:
        yield name.encode()
        yield from _function(value, seen)


def _names(code: types.CodeType) -> set[str]:
    inner = [_names(const) for const in code.co_consts if isinstance(const, types.CodeType)]
    return set(code.co_names).union(*inner)


def _code(code: types.CodeType, seen: set[int], doc: str | None = None) -> Iterator[bytes]:
    """Yield instructions, names and constants; line numbers and the function's docstring do not count."""
    yield repr((code.co_code, code.co_names, code.co_varnames, code.co_argcount, code.co_kwonlyargcount)).encode()
    # a docstring is the first constant
    for const in code.co_consts[doc is not None :]:
        yield from _parts(const, seen)

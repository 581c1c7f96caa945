"""Kernels: loops that numba compiles when a run starts, each standing behind the plain numpy form it must equal."""

from __future__ import annotations

import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path
from types import CellType, FunctionType
from typing import Any, NamedTuple, TypeVar, overload

import numpy as np

Function = TypeVar("Function", bound=Callable[..., Any])


class Kernel(NamedTuple):
    """One kernel: where its name is bound, what it must equal, and the loops with their types."""

    name: str
    namespace: dict[str, Any]
    plain: Callable[..., Any]
    loops: Callable[..., Any]
    signature: str


# in order of definition, so that a kernel may call those above it in its module
KERNELS: list[Kernel] = []
_loaded = False


@overload
def kernel(signature: str) -> Callable[[Function], Function]: ...


@overload
def kernel(signature: str, plain: Function) -> Callable[[Callable[..., Any]], Function]: ...


def kernel(signature: str, plain: Callable[..., Any] | None = None) -> Callable[[Callable[..., Any]], Any]:
    """Mark loops as a kernel: until `load` the name they are defined under means the plain form, then the compiled one.

    Elsewhere a kernel is called through its module: a name imported from there would keep its first meaning.

    Parameters
    ----------
    signature : str
        numba's types of result and arguments; an argument of another type is refused.
    plain : function, optional
        The same in numpy; by default the loops themselves, run by the interpreter.
    """

    def mark(loops: Callable[..., Any]) -> Callable[..., Any]:
        form = loops if plain is None else plain
        KERNELS.append(Kernel(loops.__name__, loops.__globals__, form, loops, signature))
        return form

    return mark


def plain_array(values: np.ndarray) -> np.ndarray:
    """Return the array if a kernel takes it, else a copy: it may be read-only, strided, or no array of floats."""
    return values if values.flags.carray and values.dtype == np.float64 else np.array(values, dtype=float, order="C")


def load() -> None:
    """Compile every kernel, or read it from numba's cache; once a process, before the first step."""
    global _loaded
    if _loaded:
        return
    start, told = time.perf_counter(), False
    with _interrupts_later() as check:
        stamp = _stamp()
        for item in KERNELS:
            compiled, new = _compile(item, stamp)
            # where one is compiled for the first time, so are most of those that follow
            if new and not told:
                print(f"mbvi: compiling up to {len(KERNELS)} kernels, once on this machine ...", file=sys.stderr)
                told = True
            item.namespace[item.name] = compiled
            check()
    # only now: whoever interrupts this does not leave the rest plain for good
    _loaded = True
    if told:
        print(f"mbvi: compiled in {time.perf_counter() - start:.0f} s", file=sys.stderr)


@contextmanager
def _interrupts_later() -> Iterator[Callable[[], None]]:
    """Hold back interrupts (Ctrl-C) until the function that is returned is called.

    LLVM calls Python while it compiles and loads; an exception raised there is printed and lost.
    """
    before = signal.getsignal(signal.SIGINT)
    # a handler that is no Python function interrupts nothing here, and only the main thread may set one
    if before is None or isinstance(before, int) or threading.current_thread() is not threading.main_thread():
        yield lambda: None
        return
    handler, pending = before, list[Any]()

    def check() -> None:
        if pending:
            handler(signal.SIGINT, pending.pop())

    signal.signal(signal.SIGINT, lambda _, frame: pending.append(frame))
    try:
        yield check
    finally:
        signal.signal(signal.SIGINT, before)
    check()


def _stamp() -> str:
    """Return a hash of all the kernels' sources."""
    sources = sorted({item.loops.__code__.co_filename for item in KERNELS})
    return sha256(b"".join(Path(source).read_bytes() for source in sources)).hexdigest()


def _compile(item: Kernel, stamp: str) -> tuple[Any, bool]:
    # imported here for its weight: only runs need it
    from .cache import compiled

    # numba's cache goes by a kernel's own file; those it calls may be in others. It goes by what a function closes over
    # as well, which is where the stamp of all files is put
    code = item.loops.__code__.replace(co_freevars=("stamp",))
    loops = FunctionType(code, item.namespace, item.name, None, (CellType(stamp),))
    loops.__module__, loops.__doc__ = item.loops.__module__, item.loops.__doc__
    return compiled(loops, item.signature)

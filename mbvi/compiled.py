"""Kernels: loops that numba compiles when a run starts, each standing behind the plain numpy form it must equal."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from types import CellType, FunctionType
from typing import Any, NamedTuple, TypeVar

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


def kernel(signature: str, plain: Function) -> Callable[[Callable[..., Any]], Function]:
    """Mark loops as a kernel: until `load` the name they are defined under means the plain form, then the compiled one.

    Elsewhere a kernel is called through its module: a name imported from there would keep its first meaning.

    Parameters
    ----------
    signature : str
        numba's types of result and arguments; an argument of another type is refused.
    plain : function
        The same in numpy.
    """

    def mark(loops: Callable[..., Any]) -> Function:
        KERNELS.append(Kernel(loops.__name__, loops.__globals__, plain, loops, signature))
        return plain

    return mark


def plain_array(values: np.ndarray) -> np.ndarray:
    """Return the array if a kernel takes it, else a copy: it may be read-only, strided, or no array of floats."""
    return values if values.flags.carray and values.dtype == np.float64 else np.array(values, dtype=float, order="C")


def load() -> None:
    """Compile every kernel, or read it from numba's cache; once a process, before the first step."""
    global _loaded
    if _loaded:
        return
    start, told, stamp = time.perf_counter(), False, _stamp()
    for item in KERNELS:
        compiled = _compile(item, stamp)
        # what is not in the cache is compiled for the first time, and so is the rest of them; with numba's own switch
        # off (NUMBA_DISABLE_JIT) there is nothing to compile
        if not told and hasattr(compiled, "stats") and not sum(compiled.stats.cache_hits.values()):
            print(
                f"mbvi: compiling {len(KERNELS)} kernels, once on this machine ...", end="", file=sys.stderr, flush=True
            )
            told = True
        item.namespace[item.name] = compiled
    # only now: whoever interrupts this does not leave the rest plain for good
    _loaded = True
    if told:
        print(f" {time.perf_counter() - start:.0f} s", file=sys.stderr)


def _stamp() -> str:
    """Return a hash of all the kernels' sources."""
    sources = sorted({item.loops.__code__.co_filename for item in KERNELS})
    return sha256(b"".join(Path(source).read_bytes() for source in sources)).hexdigest()


def _compile(item: Kernel, stamp: str) -> Any:
    # imported here for its weight: only runs need it
    from numba import njit

    # numba's cache goes by a kernel's own file; those it calls may be in others. It goes by what a function closes over
    # as well, which is where the stamp of all files is put
    code = item.loops.__code__.replace(co_freevars=("stamp",))
    loops = FunctionType(code, item.namespace, item.name, None, (CellType(stamp),))
    loops.__module__, loops.__doc__ = item.loops.__module__, item.loops.__doc__
    try:
        return njit(item.signature, cache=True, error_model="numpy")(loops)
    except RuntimeError as error:
        if "cannot cache" not in str(error):
            raise
        # nowhere to write to: the next process compiles again
        return njit(item.signature, error_model="numpy")(loops)

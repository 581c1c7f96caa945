"""Kernels: functions on arrays that numba compiles, or reads from its cache, when they are first called."""

from __future__ import annotations

import logging
import os
import re
import sys
import threading
import time
from collections.abc import Callable, Iterable
from functools import cache
from hashlib import sha256
from importlib import import_module
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np

from ..errors import InputError
from .addresses import AddressCall, RecordAt
from .folder import cache_folder

_logger = logging.getLogger(__name__)

Function = TypeVar("Function", bound=Callable[..., Any])
Record = TypeVar("Record", bound=type)

# of the modules that are imported, in order of definition
KERNELS: list[Kernel] = []
# one kernel is compiled at a time; a kernel compiles those that it calls
_LOCK = threading.RLock()
_announced = False
# of each thread, by its identifier
_seconds: dict[int, Seconds] = {}


class Seconds(NamedTuple):
    """What a thread has spent on compiling and loading kernels at their first calls [s]."""

    wall: float = 0.0
    cpu: float = 0.0


class Kernel:
    """A function on arrays, compiled for one signature at its first call.

    Each kernel is the only object of a class of its own, so that later calls reach numba's function as the class's
    `__call__`, without a Python frame between.

    Parameters
    ----------
    loops : function
        Source of the kernel. It may call numpy, and other kernels by their names.
    signature, nogil, apart
        See `kernel`.
    """

    def __init__(self, loops: Callable[..., Any], signature: str, nogil: bool = False, apart: bool = False) -> None:
        self.loops, self.signature, self.nogil, self.apart = loops, signature, nogil, apart
        self.__name__, self.__module__, self.__doc__ = loops.__name__, loops.__module__, loops.__doc__
        self._compiled: Any = None
        self._code: Any = None

    def __call__(self, *arguments: Any) -> Any:
        """Compile the kernel and run it."""
        wall, cpu = time.perf_counter(), time.thread_time()
        function = self.compiled()
        thread, before = threading.get_ident(), seconds_compiling()
        _seconds[thread] = Seconds(before.wall + time.perf_counter() - wall, before.cpu + time.thread_time() - cpu)
        return function(*arguments)

    def __reduce__(self) -> str:
        """Pickle and copy a kernel as a function: by its name."""
        return self.__name__

    def compiled(self, wait: bool = True) -> Any:
        """Return numba's function that Python calls; compile it, or read it from the cache, if needed.

        It is None if another process compiles a part of it, and this one is not to wait for that.
        """
        with _LOCK:
            if self._compiled is None:
                if not _all_made([other.compiled for other in self._apart_callees()], wait):
                    return None
                self._compiled = self._compilable().entry(wait)
                if self._compiled is not None:
                    setattr(type(self), "__call__", staticmethod(self._compiled))  # noqa: B010
        return self._compiled

    def callee(self, wait: bool = True) -> Any:
        """Return numba's function that other kernels call; None as for `compiled`."""
        return self._compilable().callee(wait)

    def carry(self, folder: Path) -> None:
        """Write the machine code for calls from Python to the folder of a wheel, `mbvi/compiled/machine_code` there.

        Raises
        ------
        InputError
            If kernels are compiled for the processor of this machine, which may have instructions that others have not.
        """
        if os.environ.get("NUMBA_CPU_NAME") != "generic":
            raise InputError("machine code for other machines needs NUMBA_CPU_NAME=generic")
        self.compiled()
        self._compilable().carry(folder)

    def interpret(self) -> None:
        """Have Python run the kernel in this process from now on, without compiling it."""
        setattr(type(self), "__call__", staticmethod(self.loops))  # noqa: B010

    def stamp(self, known: dict[Kernel, bytes] | None = None) -> bytes:
        """Return a hash of all that the machine code depends on: the code, the constants and kernels it names.

        Parameters
        ----------
        known : dict, optional
            Hashes found by this call, by kernel; most kernels are called by several others.
        """
        known = {} if known is None else known
        if self not in known:
            known[self] = self._hash(known)
        return known[self]

    def _hash(self, known: dict[Kernel, bytes]) -> bytes:
        digest = sha256(f"{self.signature} {self._allocates()} {self.nogil} {self.apart}".encode())
        if self.__name__ != self.loops.__code__.co_name:
            digest.update(self.__name__.encode())
        for name, each in sorted(self._records().items()):
            digest.update(repr((name, each._fields, each.kernel_types)).encode())
        _add_code(digest, self.loops.__code__)
        for name, value in sorted(self._named().items()):
            digest.update(name.encode())
            digest.update(value.stamp(known) if isinstance(value, Kernel) else _bytes_of(value))
        return digest.digest()

    def callees(self) -> dict[str, Kernel]:
        """Return the kernels that this one calls, by the names that it has for them."""
        return {name: value for name, value in self._named().items() if isinstance(value, Kernel)}

    def _apart_callees(self) -> list[Kernel]:
        """Return the kernels whose machine code that of this one calls; those look after their own callees."""
        found: list[Kernel] = []
        seen, left = {id(self)}, [self]
        while left:
            for other in left.pop().callees().values():
                if id(other) not in seen:
                    seen.add(id(other))
                    (found if other.apart else left).append(other)
        return found

    def _named(self) -> dict[str, Any]:
        """Return the kernels and constants of the module that the kernel names."""
        namespace = self.loops.__globals__
        found = {name: namespace[name] for name in _names(self.loops.__code__) if name in namespace}
        return {name: value for name, value in found.items() if isinstance(value, (Kernel, *_CONSTANTS))}

    def _records(self) -> dict[str, Any]:
        """Return the records that the kernel or its signature names."""
        return _records_of(_names(self.loops.__code__).union(_WORD.findall(self.signature)), self.loops.__globals__)

    def _allocates(self) -> bool:
        """Return whether the kernel makes arrays, or calls a kernel that returns some."""
        others = self.callees().values()
        makes = not ALLOCATING.isdisjoint(self.loops.__code__.co_names)
        return makes or any(not _RETURNS_NUMBERS.match(other.signature) for other in others)

    def _compilable(self) -> Any:
        """Return the code of the kernel, which is compiled when it is asked for its functions."""
        if self._code is None:
            self._code = self._make_code()
        return self._code

    def _make_code(self) -> Any:
        # imported here for its weight: only runs need it
        from .cache import Code, signature_of

        # numba takes no Kernel for a function: the names of other kernels mean compiled functions here
        namespace = dict(self.loops.__globals__)
        others = self.callees()
        loops = FunctionType(self.loops.__code__, namespace, self.__name__)
        loops.__module__, loops.__doc__ = self.__module__, self.__doc__
        # numba names machine code by it: kernels of one source must not share a name
        loops.__qualname__ = self.__name__

        known = {name: namespace.get(name) for name in _names(loops.__code__)}
        calls = {name: each for name, each in known.items() if isinstance(each, AddressCall | RecordAt)}

        def make_callees(wait: bool) -> bool:
            made = _all_made([other.callee for other in others.values()], wait)
            if made:
                namespace.update({name: other.callee() for name, other in {**others, **calls}.items()})
            return made

        signature = signature_of(self.signature, self._records())
        options = self._allocates(), self.nogil, self.apart
        return Code(loops, signature, self.stamp().hex(), make_callees, lambda: _announce(self.__name__), *options)


def kernel(signature: str, nogil: bool = False, apart: bool = False) -> Callable[[Function], Function]:
    """Make a function on arrays a `Kernel`.

    Parameters
    ----------
    signature : str
        numba's types of result and arguments, and names of records; an argument of another type is refused. A plain
        tuple, `Tuple(Name)` of a record, is passed faster from Python than the record itself.
    nogil : bool
        Whether other threads of Python run while Python waits for the kernel.
    apart : bool
        Whether kernels that call it share its machine code, for a long one with several callers. Otherwise each machine
        code holds that of the kernels it calls, which is faster for short ones.
    """

    def mark(loops: Function) -> Function:
        made: Any = type(loops.__name__, (Kernel,), {})(loops, signature, nogil, apart)
        KERNELS.append(made)
        return made

    return mark


def calling_others(function: Function, name: str, **others: Callable[..., Any]) -> Function:
    """Return a kernel with the source of a given one that calls other kernels where that one names its own."""
    given: Any = function
    loops: Any = FunctionType(given.loops.__code__, {**given.loops.__globals__, **others}, name)
    loops.__module__, loops.__doc__ = given.__module__, given.__doc__
    return cast("Function", kernel(given.signature, given.nogil, given.apart)(loops))


def held(record: Any) -> Any:
    """Return what stands for a record in calls of kernels that are to be fast: an object that has its address.

    Its arrays stay alive as long as the object; `replace` puts another one in the place of one of them.
    """
    # imported here for its weight: only runs need it
    from .records import Held

    kind: Any = type(record)
    return Held(record, _type_of_record(kind))


@cache
def _type_of_record(kind: Any) -> Any:
    from .cache import signature_of

    found = _records_of([kind.__name__], vars(sys.modules[kind.__module__]))
    (of,) = signature_of(f"void({kind.__name__})", found).args
    return of


def record(kernel_types: str) -> Callable[[Record], Record]:
    """Let kernels take a NamedTuple, given numba's types of its fields; they may be records of the same module."""

    def mark(kind: Record) -> Record:
        setattr(kind, "kernel_types", kernel_types)  # noqa: B010
        return kind

    return mark


def plain_array(values: np.ndarray) -> np.ndarray:
    """Return the array if a kernel takes it, else a copy: it may be read-only, strided, or no array of floats."""
    return values if values.flags.carray and values.dtype == np.float64 else np.array(values, dtype=float, order="C")


def all_kernels() -> list[Kernel]:
    """Return every kernel of mbvi: the modules of its public names are imported."""
    package = import_module(__name__.partition(".")[0])
    for name in package.__all__:
        getattr(package, name)
    return KERNELS


def compile_all(process: int = 0, processes: int = 1) -> None:
    """Compile every kernel now, so that compiling is no part of a measurement that follows.

    Of several processes each begins with its share, and loads what the others have compiled by then.
    """
    kernels = all_kernels()
    first = process * len(kernels) // processes
    _all_made([item.compiled for item in (*kernels[first:], *kernels[:first])], True)


def seconds_compiling(thread: int | None = None) -> Seconds:
    """Return the time that a thread, by default this one, has spent on compiling and loading kernels [s]."""
    return _seconds.get(threading.get_ident() if thread is None else thread, Seconds())


def _all_made(makers: list[Callable[[bool], Any]], wait: bool) -> bool:
    """Make parts of a kernel, or kernels, and return whether all are made; what other processes compile comes last."""
    left = [make for make in makers if make(False) is None]
    if not wait:
        return not left
    for make in left:
        make(True)
    return True


_WORD = re.compile(r"[A-Za-z_]\w*")
# names of numpy that make arrays in kernels; with others compiling fails, unless a kernel before has compiled them.
# Results of kernels that are no arrays
ALLOCATING = frozenset({"arange", "copy", "empty", "full", "ones", "zeros"})
_RETURNS_NUMBERS = re.compile(r"(void|[a-z]\d|Tuple\(\([a-z\d, ]*\)\)|UniTuple\([a-z]\d, \d\))\(")
_CONSTANTS = (bool, int, float, str, tuple, np.generic, np.ndarray)


def _bytes_of(value: Any) -> bytes:
    if isinstance(value, np.ndarray):
        return f"{value.dtype} {value.shape}".encode() + value.tobytes()
    return repr(value).encode()


def _names(code: CodeType) -> set[str]:
    """Return the names that a function and those inside it look up."""
    inner = [_names(const) for const in code.co_consts if isinstance(const, CodeType)]
    return set(code.co_names).union(*inner)


def _add_code(digest: Any, code: CodeType) -> None:
    """Add a function's instructions, names and constants to a hash; line numbers do not count."""
    digest.update(repr((code.co_code, code.co_names, code.co_varnames, code.co_argcount)).encode())
    for const in code.co_consts:
        if isinstance(const, CodeType):
            _add_code(digest, const)
        else:
            digest.update(repr(const).encode())


def _announce(name: str) -> None:
    """Say once a process that kernels are compiled, which is the first, and why."""
    global _announced
    if not _announced:
        _announced = True
        words = "compiling kernels that %s does not have yet, once on this machine; the first is %s ..."
        _logger.warning(words, cache_folder(), name)


def _records_of(names: Iterable[str], namespace: dict[str, Any]) -> dict[str, Any]:
    """Return the records of a module that bear some names, each after the records in its own fields."""
    found: dict[str, Any] = {}
    for name in names:
        each: Any = namespace.get(name)
        if hasattr(each, "kernel_types"):
            found |= _records_of(_WORD.findall(each.kernel_types), vars(sys.modules[each.__module__]))
            found[name] = each
    return found

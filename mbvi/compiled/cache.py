"""numba's cache of compiled kernels on disk, with a checksum on every file.

Imported when a run starts, for numba's weight.
"""

from __future__ import annotations

import gc
import os
import pickle
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from hashlib import sha256
from typing import Any

from numba import njit, types
from numba.core import typeinfer
from numba.core.caching import FunctionCache, IndexDataCacheFile

_MARK = b"mbvi-1\n\0"
_DIGEST = 32
# said once a process
_said: set[str] = set()


class _DamagedFile(Exception):
    """A file of the cache is not what was written."""


class _CheckedFile(IndexDataCacheFile):
    """numba's index and data files, each behind the checksum of what was written."""

    def _load_index(self) -> dict[Any, str]:
        try:
            found = self._checked(self._index_path)
            if found is None or found[0] != self._version or found[1] != self._source_stamp:
                return {}
            overloads: dict[Any, str] = found[2]
            return overloads
        except _DamagedFile:
            self._remove(self._index_path)
            return {}

    def _save_index(self, overloads: dict[Any, str]) -> None:
        self._write(self._index_path, (self._version, self._source_stamp, overloads))

    def _load_data(self, name: str) -> Any:
        path = self._data_path(name)
        try:
            return self._checked(path)
        except _DamagedFile:
            self._remove(path)
            return None

    def _save_data(self, name: str, data: Any) -> None:
        self._write(self._data_path(name), data)

    def _write(self, path: str, content: Any) -> None:
        data = self._dump(content)
        with self._open_for_write(path) as file:
            file.write(_MARK + sha256(data).digest() + data)

    def _remove(self, path: str) -> None:
        print(f"mbvi: {path} is damaged: its kernel is compiled again", file=sys.stderr, flush=True)
        try:
            os.unlink(path)
        except OSError:
            # it is written over, or nothing is kept
            pass

    @staticmethod
    def _checked(path: str) -> Any:
        """Return what was written to a file, None if there is no such file; nothing else is ever unpickled."""
        try:
            with open(path, "rb") as file:
                found = file.read()
        except FileNotFoundError:
            return None
        except OSError as error:
            raise _DamagedFile from error
        mark, digest, data = found[: len(_MARK)], found[len(_MARK) :][:_DIGEST], found[len(_MARK) + _DIGEST :]
        if mark != _MARK or sha256(data).digest() != digest:
            raise _DamagedFile
        try:
            return pickle.loads(data)
        except Exception as error:
            # written by a numba whose classes are not these
            raise _DamagedFile from error


class _CheckedCache(FunctionCache):
    """numba's cache of one function; what cannot be read is compiled, and what cannot be written is not kept."""

    def __init__(self, function: Callable[..., Any], stamp: str, before_compiling: Callable[[], None]) -> None:
        super().__init__(function)
        self._before_compiling = before_compiling
        # files of numba's own cache, which have no checksum, bear other names
        self._cache_file = _CheckedFile(
            cache_path=self._cache_path,
            filename_base=f"{self._impl.filename_base}.checked",
            source_stamp=stamp,
        )

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        found = super().load_overload(sig, target_context)
        if found is None:
            self._before_compiling()
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        try:
            super().save_overload(sig, data)
        except OSError as error:
            _say_once(
                f"compiled kernels cannot be kept in {self._cache_path} ({error.strerror or error}): the next process "
                "compiles them again"
            )


def signature_of(text: str, records: dict[str, Any]) -> Any:
    """Return numba's signature from its text, in which records stand by their names."""
    known = dict(vars(types))
    for name, each in records.items():
        known[name] = types.BaseTuple.from_types(eval(f"({each.kernel_types},)", known), each)
    return eval(text, known)


def compiled(
    function: Callable[..., Any],
    signature: Any,
    stamp: str,
    before_compiling: Callable[[], None],
    allocates: bool = True,
    nogil: bool = False,
) -> Callable[..., Any]:
    """Return a function compiled for one signature, from the cache where it is there.

    Parameters
    ----------
    function : function
        What is to be compiled.
    signature : str or numba's Signature
        numba's types of result and arguments; other types are refused.
    stamp : str
        Hash of all that the machine code depends on; code of another stamp is not taken from the cache.
    before_compiling : callable
        Called where the cache does not have it.
    allocates : bool
        Whether it makes arrays. Otherwise numba counts no references to arrays, which costs as much as a small kernel.
    nogil : bool
        Whether other threads of Python run meanwhile.
    """
    # no C functions: nothing takes the kernels' addresses
    options: dict[str, Any] = {"error_model": "numpy", "no_cfunc_wrapper": True, "_nrt": allocates, "nogil": nogil}
    dispatcher: Any = njit(**options)(function)
    if not hasattr(dispatcher, "disable_compile"):
        # with numba's own switch off (NUMBA_DISABLE_JIT) there is nothing to compile
        before_compiling()
        return dispatcher
    try:
        dispatcher._cache = _CheckedCache(function, stamp, before_compiling)
    except RuntimeError as error:
        if "cannot cache" not in str(error):
            raise
        # nowhere to write to: the next process compiles again
        before_compiling()
    with typeinfer.register_dispatcher(dispatcher), _without_garbage_collection():
        dispatcher.compile(signature)
        dispatcher.disable_compile()
    return dispatcher


@contextmanager
def _without_garbage_collection() -> Iterator[None]:
    """Collect no garbage until the end of the block: numba makes many objects that stay, and is an eighth faster so."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def _say_once(what: str) -> None:
    if what not in _said:
        _said.add(what)
        print(f"mbvi: {what}", file=sys.stderr, flush=True)

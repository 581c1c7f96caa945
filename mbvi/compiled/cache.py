"""numba's cache of compiled kernels on disk, with a checksum on every file.

Imported when a run starts, for numba's weight.
"""

from __future__ import annotations

import gc
import logging
import os
import pickle
import platform
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path
from typing import Any

import llvmlite
import numba
import numpy as np
from numba import types
from numba.core import config
from numba.core.caching import FunctionCache, IndexDataCacheFile

from ..errors import InputError
from .folder import cache_folder
from .interrupts import interrupts_later
from .linking import (
    compile_now,
    entry_dispatcher,
    function_dispatcher,
    rebuilt,
    rebuilt_entry,
    reduced,
    reduced_entry,
)
from .one_process import one_process
from .records import RecordType, record_type

_logger = logging.getLogger(__name__)

# what a wheel carries, by the versions that made it; a clone has no such folder
_CARRIED = Path(__file__).parent / "machine_code"

_MARK = b"mbvi-6\n\0"
_DIGEST = 32
# files of a kernel that are kept: four of each version of mbvi, numba or Python
_MOST_FILES = 40
# said once a process
_said: set[str] = set()


class _DamagedFile(Exception):
    """A file of the cache is not what was written."""


class _CheckedFile(IndexDataCacheFile):
    """numba's index and data files, each behind the checksum of what was written."""

    def _load_index(self) -> dict[Any, str]:
        try:
            found = self.checked(self._index_path)
            if found is None or found[0] != self._version or found[1] != self._source_stamp:
                return {}
            overloads: dict[Any, str] = found[2]
            return overloads
        except _DamagedFile:
            self._remove(self._index_path)
            return {}

    def _save_index(self, overloads: dict[Any, str]) -> None:
        self.write(self._index_path, (self._version, self._source_stamp, overloads))

    def _load_data(self, name: str) -> Any:
        path = self._data_path(name)
        try:
            return self.checked(path)
        except _DamagedFile:
            self._remove(path)
            return None

    def _save_data(self, name: str, data: Any) -> None:
        self.write(self._data_path(name), data)

    def write(self, path: str, content: Any) -> None:
        """Write what `checked` reads."""
        data = self._dump(content)
        with self._open_for_write(path) as file:
            file.write(_MARK + sha256(data).digest() + data)

    def _remove(self, path: str) -> None:
        _logger.warning("%s is damaged: its kernel is compiled again", path)
        try:
            os.unlink(path)
        except OSError:
            # it is written over, or nothing is kept
            pass

    @staticmethod
    def checked(path: str) -> Any:
        """Return what was written to a file, None if there is no such file; nothing else is ever unpickled."""
        try:
            with open(path, "rb") as file:
                found = file.read()
        except (FileNotFoundError, NotADirectoryError):
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


class _Missing(Exception):
    """A kernel is not in the cache, and it may not be compiled yet."""


class _CheckedCache(FunctionCache):
    """numba's cache of one function; what cannot be read is compiled, and what cannot be written is not kept.

    Files are named by a hash of all that machine code depends on: versions of mbvi do not overwrite each other's.
    """

    def __init__(
        self, function: Callable[..., Any], stamp: str, name: str, is_entry: bool, carried: Path | None = None
    ) -> None:
        self._name, self._py_func, self._is_entry, self._carried = repr(function), function, is_entry, carried
        self._cache_path = str(cache_folder())
        self._cache_file = _CheckedFile(self._cache_path, name, stamp)
        self.enable()
        # whether what is missing is compiled
        self.compiles = False

    def _load_overload(self, sig: Any, target_context: Any) -> Any:
        kept = self._kept_by_wheel() or self.kept(sig, target_context.codegen())
        if kept is None:
            return None
        return (rebuilt_entry if self._is_entry else rebuilt)(target_context, kept)

    def kept(self, sig: Any, codegen: Any) -> Any:
        """Return what the user's cache has, None if nothing."""
        return self._cache_file.load(self._index_key(sig, codegen))

    def _kept_by_wheel(self) -> Any:
        """Return what the wheel carries, None if nothing that can be read."""
        try:
            return None if self._carried is None else _CheckedFile.checked(str(self._carried))
        except _DamagedFile:
            _logger.warning("%s is damaged: its kernel is compiled on this machine", self._carried)
            return None

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        found = super().load_overload(sig, target_context)
        if found is None and not self.compiles:
            raise _Missing
        return found

    def _save_overload(self, sig: Any, data: Any) -> None:
        os.makedirs(self._cache_path, exist_ok=True)
        kept = (reduced_entry if self._is_entry else reduced)(data)
        self._cache_file.save(self._index_key(sig, data.codegen), kept)
        self._remove_old()

    def _remove_old(self) -> None:
        """Remove code of old versions of the same kernel."""
        kernel = self._cache_file._index_name.rpartition("-")[0]
        files = sorted(Path(self._cache_path).glob(f"{kernel}-*.nb?"), key=lambda file: file.stat().st_mtime)
        for file in files[:-_MOST_FILES]:
            file.unlink(missing_ok=True)

    def save_overload(self, sig: Any, data: Any) -> None:
        try:
            super().save_overload(sig, data)
        except OSError as error:
            _say_once(
                f"compiled kernels cannot be kept in {self._cache_path} ({error.strerror or error}): the next process "
                "compiles them again"
            )


def made_by() -> str:
    """Return by which Python, on which platform, and by which numba machine code is made that this process can load."""
    python = f"{sys.implementation.cache_tag}{getattr(sys, 'abiflags', '')}-{sys.platform}-{platform.machine()}"
    return f"{python}-numba-{numba.__version__}-llvmlite-{llvmlite.__version__}"


def signature_of(text: str, records: dict[str, Any]) -> Any:
    """Return numba's signature from its text, in which records stand by their names.

    A record that is a result is returned by value: the memory of a kernel is gone after it.
    """
    known = {**vars(types), "Tuple": lambda of: types.Tuple(getattr(of, "types", of))}
    for name, each in records.items():
        known[name] = record_type(each, eval(f"({each.kernel_types},)", known))
    found = eval(text, known)
    result = getattr(found, "return_type", None)
    return found.replace(return_type=result.by_value) if isinstance(result, RecordType) else found


class Code:
    """The code of one kernel, compiled or from the cache: a function for other kernels, and an entry for Python.

    Parameters
    ----------
    function : function
        What is to be compiled.
    signature : str or numba's Signature
        numba's types of result and arguments; other types are refused.
    stamp : str
        Hash of all that the machine code depends on; code of another stamp is not taken from the cache.
    make_callees : callable
        Called where the cache does not have it: makes the kernels that it calls, and returns whether all are made. Its
        argument is whether it waits for those that other processes compile.
    announce : callable
        Called before it is compiled.
    allocates : bool
        Whether it makes arrays. Otherwise numba counts no references to arrays, which costs as much as a small kernel.
    nogil : bool
        Whether other threads of Python run meanwhile.
    apart : bool
        Whether machine code of other kernels calls that of this one, which must be loaded before.
    """

    def __init__(
        self,
        function: Callable[..., Any],
        signature: Any,
        stamp: str,
        make_callees: Callable[[bool], bool],
        announce: Callable[[], None],
        allocates: bool = True,
        nogil: bool = False,
        apart: bool = False,
    ) -> None:
        self._function, self._signature, self._stamp = function, signature, stamp
        self._make_callees, self._announce, self._nogil, self._apart = make_callees, announce, nogil, apart
        # no C functions: nothing takes the kernels' addresses
        self._options = {"error_model": "numpy", "no_cfunc_wrapper": True, "_nrt": allocates}
        name = f"{Path(function.__code__.co_filename).stem}.{function.__name__}"
        key = sha256(f"{stamp} {numba.__version__} {np.__version__} {sys.version} {_MARK!r}".encode()).hexdigest()[:20]
        self._name, self._carried = f"{name}-{key}", f"{made_by()}/{name}-{stamp[:20]}"
        self._callee: Any = None

    def callee(self, wait: bool = True) -> Any:
        """Return what kernels call; None if another process compiles it, and this one is not to wait for that."""
        if self._callee is None:
            cache = _CheckedCache(self._function, self._stamp, f"{self._name}.function", False)
            number = int(self._stamp[:12], 16) if self._apart else None
            made = function_dispatcher(self._function, self._options, cache, number)
            self._callee = self._made(made, self._make_callees, wait)
        return self._callee

    def entry(self, wait: bool = True) -> Any:
        """Return numba's function that Python calls; None as for `callee`."""
        if getattr(config, "DISABLE_JIT"):  # noqa: B009
            # there is nothing to compile
            self._make_callees(wait)
            return self._function
        cache = _CheckedCache(self._function, self._stamp, self._name, True, _CARRIED / self._carried)
        how = self.callee, self._nogil, self._apart
        made = entry_dispatcher(self._function, self._options, cache, *how)
        return self._made(made, lambda wait: self.callee(wait) is not None, wait)

    def carry(self, folder: Path) -> None:
        """Write machine code for calls from Python, which is in the user's cache, to the folder of a wheel."""
        entry, file = self.entry(), folder / self._carried
        kept = entry._cache.kept(self._signature, entry.targetctx.codegen())
        if kept is None:
            raise InputError(f"{self._name} is not in the cache {cache_folder()}")
        file.parent.mkdir(parents=True, exist_ok=True)
        entry._cache._cache_file.write(str(file), kept)

    def _made(self, dispatcher: Any, make_parts: Callable[[bool], bool], wait: bool) -> Any:
        """Return a dispatcher that is loaded or compiled, after its parts: a process has the lock of one at a time."""
        if self._found(dispatcher):
            return dispatcher
        if not make_parts(wait):
            return None
        with one_process(cache_folder(), dispatcher._cache._cache_file._index_name, wait) as alone:
            if not alone:
                return None
            # another process may have compiled it meanwhile
            if not self._found(dispatcher):
                with interrupts_later(), _without_garbage_collection():
                    self._announce()
                    dispatcher._cache.compiles = True
                    compile_now(dispatcher, self._signature)
        return dispatcher

    def _found(self, dispatcher: Any) -> bool:
        """Return whether a kernel was in the cache; it is loaded then."""
        with interrupts_later(), _without_garbage_collection():
            try:
                compile_now(dispatcher, self._signature)
            except _Missing:
                return False
        return True


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
        _logger.warning(what)

"""A trajectory file opened for reading after its checksums were verified."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import h5py

from ...arguments import not_found
from ...errors import TrajectoryFileError
from .checked_file import lock
from .pages import PAGE, Record, damaged_pages, find_record, page_count

# [s] of CPU, and bytes read in one of them: what a file without checksums may take to be read
_TIME, _SPEED = 5, 20_000_000
_MEMORY = 4_000_000_000
_WALL = 20.0
# HDF5 can loop without end, or crash, where its own structures are damaged: this process may
_READ_ALL = """
import resource, sys
path, seconds, memory = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
try:
    import h5py
except ImportError:
    sys.exit(0)
def read(name, thing):
    for key in thing.attrs:
        thing.attrs[key]
    if isinstance(thing, h5py.Dataset):
        if not thing.shape:
            thing[()]
            return
        rows = max(2**22 // max(thing.nbytes // max(len(thing), 1), 1), 1)
        for start in range(0, len(thing), rows):
            thing[start : start + rows]
try:
    with h5py.File(path, "r", locking=False) as file:
        read("/", file)
        file.visititems(read)
except Exception as error:
    sys.exit(str(error)[:300] or "damaged")
"""


class _Overlaid:
    """A file in which some pages are replaced by those of a journal, as h5py reads it."""

    def __init__(self, file: int, record: Record) -> None:
        self._file, self._record, self._position = file, record, 0

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        start = {os.SEEK_SET: 0, os.SEEK_CUR: self._position, os.SEEK_END: self._record.size}[whence]
        self._position = start + offset
        return self._position

    def tell(self) -> int:
        return self._position

    def read(self, size: int = -1) -> bytes:
        buffer = bytearray(self._record.size - self._position if size < 0 else size)
        return bytes(buffer[: self.readinto(buffer)])

    def readinto(self, buffer: Any) -> int:
        view, done = memoryview(buffer).cast("B"), 0
        count = max(min(len(view), self._record.size - self._position), 0)
        while done < count:
            page, start = divmod(self._position, PAGE)
            n = min(PAGE - start, count - done)
            held = self._record.pages.get(page)
            part = os.pread(self._file, n, self._position) if held is None else held[start : start + n]
            view[done : done + n] = part
            self._position, done = self._position + n, done + n
        return count

    def write(self, data: Any) -> int:
        raise OSError("this file is read only")

    def truncate(self, size: int | None = None) -> int:
        raise OSError("this file is read only")

    def flush(self) -> None:
        """Do nothing."""


@contextmanager
def opened(path: str, *, locked: bool = False) -> Iterator[h5py.File]:
    """Open a trajectory file for reading, as it was last committed.

    Parameters
    ----------
    path : str
        Which file.
    locked : bool
        Whether this process has it locked already.

    Raises
    ------
    TrajectoryFileError
        If it is missing, damaged, no HDF5 file, or locked by a run.
    """
    if not os.path.isfile(path):
        raise TrajectoryFileError(not_found(path))
    try:
        raw = os.open(path, os.O_RDONLY | getattr(os, "O_CLOEXEC", 0))
    except OSError as error:
        raise TrajectoryFileError(f"{path} cannot be read: {error.strerror}") from error
    try:
        if not locked:
            lock(raw, path, exclusive=False)
        with _hdf5(raw, path) as file:
            yield file
    except OSError as error:
        why = (str(error) or type(error).__name__).splitlines()[0]
        raise TrajectoryFileError(f"{path} is truncated or no HDF5 file: {why}; run the simulation again") from error
    finally:
        os.close(raw)


def _hdf5(raw: int, path: str) -> h5py.File:
    record, damaged = find_record(raw)
    if record is not None:
        wrong = damaged_pages(raw, record)
        if wrong:
            raise TrajectoryFileError(
                f"{path} is damaged: {wrong} of {page_count(record.size)} pages differ from their checksums; "
                "take a copy of it that is whole, or run the simulation again"
            )
        if record.pages:
            return h5py.File(_Overlaid(raw, record), "r")
    elif damaged:
        raise TrajectoryFileError(
            f"{path} is damaged: its checksums are; take a copy of it that is whole, or run the simulation again"
        )
    else:
        _try_reading(path, os.fstat(raw).st_size)
    return h5py.File(path, "r", locking=False)


def _try_reading(path: str, size: int) -> None:
    """Read a file without checksums in another process, which may hang or crash; raise if it does."""
    with open(path, "rb") as file:
        if not file.read(8).startswith(b"\x89HDF"):
            raise OSError("it does not begin as one")
    if not sys.executable:
        return
    seconds, memory = _TIME + size // _SPEED, _MEMORY + 4 * size
    there = {**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p), "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-c", _READ_ALL, os.path.abspath(path), str(seconds), str(memory)]
    with suppress(PermissionError, FileNotFoundError):
        try:
            found = subprocess.run(command, env=there, capture_output=True, timeout=_WALL + seconds, check=False)
        except subprocess.TimeoutExpired as error:
            raise OSError("HDF5 does not come to an end of it") from error
        if found.returncode < 0:
            raise OSError("HDF5 fails on it, or does not come to an end of it")
        if found.returncode:
            raise OSError(found.stderr.decode(errors="replace").strip() or "HDF5 fails on it")

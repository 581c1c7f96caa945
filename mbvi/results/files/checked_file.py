"""A file that HDF5 writes to memory and that reaches the disk in commits, each of them whole or not at all.

HDF5 does not report every failed write, and may crash after one. It therefore never meets the disk: it writes to a
`CheckedFile`, whose `commit` writes by calls of the operating system, where every error is seen.
"""

from __future__ import annotations

import errno
import fcntl
import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

import numpy as np

from ...errors import TrajectoryFileError
from .pages import PAGE, pack, page_count, page_length, sums_of

_LOCKED = "locked by a run that is still going on"
_DEFERRED = (signal.SIGINT, signal.SIGTERM, signal.SIGALRM, signal.SIGHUP)
# of file systems without locks, and of those without fsync
_NO_LOCKS = (errno.ENOLCK, errno.ENOTSUP, errno.ENOSYS, errno.EINVAL)
_NO_SYNC = (errno.EINVAL, errno.ENOTSUP, errno.ENOSYS, errno.EROFS)
_REASONS = {
    errno.ENOSPC: "the disk is full",
    errno.EDQUOT: "the disk quota is used up",
    errno.EFBIG: "the limit of file sizes is reached",
}


class CheckedFile:
    """A new file for `h5py.File(checked_file, "w", libver=("v108", "v108"))`.

    Parameters
    ----------
    path : str
        Where; what was there is lost.

    Raises
    ------
    TrajectoryFileError
        If the file cannot be opened for writing, or a run is writing it.

    Notes
    -----
    Writes are kept in memory until `commit`. A commit first appends what lies behind the old end of the file, and a
    journal of the pages that lie before it; then it writes these to their places; then it cuts off the journal. If
    the disk fills up, the file is cut to what it was after the last commit: nothing but the appended part needs space.
    """

    def __init__(self, path: str) -> None:
        self.path = path
        try:
            self._file = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_CLOEXEC", 0), 0o666)
        except OSError as error:
            raise TrajectoryFileError(f"{path} cannot be written: {reason(error)}") from error
        try:
            lock(self._file, path, exclusive=True)
            os.ftruncate(self._file, 0)
        except OSError as error:
            os.close(self._file)
            raise TrajectoryFileError(f"{path} cannot be written: {reason(error)}") from error
        except TrajectoryFileError:
            os.close(self._file)
            raise
        # where HDF5 is, how long its image is, and how long it was when last committed
        self._position = self._size = self._committed = 0
        # the end of the file, trailer included
        self._end = 0
        self._pending: dict[int, bytearray] = {}
        self._sums = np.zeros(0, "<u4")

    @property
    def size(self) -> int:
        """Bytes of the image."""
        return self._size

    # what h5py calls

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Move to an offset."""
        start = {os.SEEK_SET: 0, os.SEEK_CUR: self._position, os.SEEK_END: self._size}[whence]
        self._position = start + offset
        return self._position

    def tell(self) -> int:
        """Return the offset."""
        return self._position

    def read(self, size: int = -1) -> bytes:
        """Return bytes from the offset on."""
        left = max(self._size - self._position, 0)
        buffer = bytearray(left if size < 0 else min(size, left))
        self.readinto(buffer)
        return bytes(buffer)

    def readinto(self, buffer: Any) -> int:
        """Fill a buffer from the offset on; return how many bytes there were."""
        view = memoryview(buffer).cast("B")
        left = count = max(min(len(view), self._size - self._position), 0)
        while left:
            page, start = divmod(self._position, PAGE)
            n = min(PAGE - start, left)
            view[count - left : count - left + n] = self._content(page)[start : start + n]
            self._position, left = self._position + n, left - n
        return count

    def write(self, data: Any) -> int:
        """Keep bytes in memory."""
        view = memoryview(data).cast("B")
        done, count = 0, len(view)
        self._size = max(self._size, self._position + count)
        while done < count:
            page, start = divmod(self._position, PAGE)
            n = min(PAGE - start, count - done)
            self._changeable(page)[start : start + n] = view[done : done + n]
            self._position, done = self._position + n, done + n
        return count

    def truncate(self, size: int | None = None) -> int:
        """Set the size of the image; new bytes are zero."""
        size = self._position if size is None else size
        if size < self._size:
            for page in [k for k in self._pending if k >= page_count(size)]:
                del self._pending[page]
            if size % PAGE:
                self._changeable(size // PAGE)[size % PAGE :] = bytes(PAGE - size % PAGE)
        self._size = size
        return size

    def flush(self) -> None:
        """Do nothing: `commit` writes."""

    # what reaches the disk

    def commit(self) -> None:
        """Write what is new; the file then holds all of it, and holds what it held before if that fails.

        Raises
        ------
        OSError
            If the disk is full, or anything else went wrong.
        """
        size, end = self._size, self._end
        # pages that HDF5 never wrote, where the old trailer may lie
        for page in range(self._committed // PAGE, page_count(size)):
            self._changeable(page)
        sums = np.zeros(page_count(size), "<u4")
        sums[: len(self._sums)] = self._sums[: len(sums)]
        changed = sorted(k for k in self._pending if k < len(sums))
        sums[changed] = sums_of(memoryview(self._pending[k])[: page_length(k, size)] for k in changed)
        trailer, held = pack(size, sums, {}), [k for k in changed if k * PAGE < end]
        parts = [(k * PAGE, memoryview(self._pending[k])[: page_length(k, size)]) for k in changed]
        try:
            for offset, part in parts:
                new = max(end - offset, 0)
                _write(self._file, part[new:], offset + new)
            if end:
                # room for the trailer, which is not to be found before the pages are in their places
                room = max(size, end)
                _write(self._file, memoryview(bytes(max(size + len(trailer) - room, 0))), room)
                journal = pack(size, sums, {k: self._pending[k] for k in held})
                _write(self._file, memoryview(journal), max(end, size + len(trailer)))
            else:
                _write(self._file, memoryview(trailer), size)
        except OSError:
            os.ftruncate(self._file, end)
            raise
        # all of this lies within the file: no space is needed
        if end:
            for offset, part in parts:
                if offset < end:
                    _write(self._file, part[: end - offset], offset)
            _write(self._file, memoryview(trailer), size)
        self._end = size + len(trailer)
        os.ftruncate(self._file, self._end)
        self._sums, self._committed = sums, size
        self._pending.clear()

    def sync(self) -> None:
        """Hand all that was committed to the disk.

        Raises
        ------
        OSError
            If that fails.
        """
        try:
            os.fsync(self._file)
        except OSError as error:
            if error.errno not in _NO_SYNC:
                raise

    def close(self) -> None:
        """Close the file as it was last committed, and release its lock."""
        os.close(self._file)

    def _content(self, page: int) -> bytes | bytearray:
        found = self._pending.get(page)
        return self._stored(page) if found is None else found

    def _changeable(self, page: int) -> bytearray:
        found = self._pending.get(page)
        if found is None:
            found = self._pending[page] = bytearray(self._stored(page))
        return found

    def _stored(self, page: int) -> bytes:
        """Return a page as it was last committed, zero behind the end."""
        length = page_length(page, self._committed)
        found = os.pread(self._file, length, page * PAGE) if length > 0 else b""
        return found.ljust(PAGE, b"\0")


def lock(file: int, path: str, *, exclusive: bool) -> None:
    """Lock an open file until it is closed; file systems that know no locks are left without.

    Raises
    ------
    TrajectoryFileError
        If a run is writing the file, or another program reads it that is to be written.
    """
    try:
        fcntl.flock(file, (fcntl.LOCK_EX if exclusive else fcntl.LOCK_SH) | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno in _NO_LOCKS:
            return
        if error.errno not in (errno.EWOULDBLOCK, errno.EACCES):
            raise
        what = f"{_LOCKED}, or open in another program" if exclusive else f"{_LOCKED}: wait for its end or stop it"
        raise TrajectoryFileError(f"{path} is {what}") from error


def reason(error: OSError) -> str:
    """Return in words why a file cannot be written."""
    return _REASONS.get(error.errno or 0, error.strerror or str(error))


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Put off what Python does on signals: an exception from a handler must not arise within HDF5."""
    arrived: dict[int, FrameType | None] = {}
    handlers: dict[int, Any] = {}
    if threading.current_thread() is threading.main_thread():
        handlers = {s: h for s in _DEFERRED if callable(h := signal.getsignal(s))}
    for number in handlers:
        signal.signal(number, arrived.__setitem__)
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
        for number, frame in arrived.items():
            handlers[number](number, frame)


def _write(file: int, data: memoryview, offset: int) -> None:
    while len(data):
        written = os.pwrite(file, data, offset)
        if not written:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        data, offset = data[written:], offset + written

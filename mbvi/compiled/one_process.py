"""Locks for all processes of a user that compile kernels: each kernel is compiled once, and the others read it."""

from __future__ import annotations

import logging
import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path

_logger = logging.getLogger(__name__)

try:
    import fcntl
except ImportError:
    # no such locks on this platform: processes may compile the same
    fcntl = None  # type: ignore[assignment]

_POLL = 0.05
_threads = threading.RLock()
# one file of each folder stays open: closing it would release all locks of this process
_files: dict[Path, int] = {}
# said once a process
_said = False


@contextmanager
def one_process(folder: Path, name: str, wait: bool = True) -> Iterator[bool]:
    """Wait until no other process is in such a block with the same folder and name, and keep them out until the end.

    A process that ends, in whatever way, keeps nobody out. Where the folder cannot be written to, nobody waits.

    Yields
    ------
    bool
        Whether no other process is in such a block, as far as that is known; always, where this one waits for it.
    """
    with _threads:
        file = _lock_file(folder)
        # a byte of the file for each name
        place = int(sha256(name.encode()).hexdigest()[:12], 16)
        locked = None if file is None else _locked(file, place, wait)
        try:
            yield locked is not False
        finally:
            if file is not None and locked:
                fcntl.lockf(file, fcntl.LOCK_UN, 1, place)


def _lock_file(folder: Path) -> int | None:
    """Return the file of the locks, or None where there are none."""
    if fcntl is None:
        return None
    if folder not in _files:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            _files[folder] = os.open(folder / "lock", os.O_RDWR | os.O_CREAT, 0o666)
        except OSError:
            return None
    return _files[folder]


def _locked(file: int, place: int, wait: bool) -> bool | None:
    """Take a lock; return whether this process has it, False if another one has, None if the file system has none."""
    global _said
    while True:
        try:
            fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, place)
            return True
        except (BlockingIOError, PermissionError):
            if not wait:
                return False
            if not _said:
                _logger.warning("another process compiles kernels: waiting for it ...")
            _said = True
            time.sleep(_POLL)
        except OSError:
            return None

"""One lock for all processes of a user that compile kernels: each kernel is compiled once, and the others read it."""

from __future__ import annotations

import logging
import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_logger = logging.getLogger(__name__)

try:
    import fcntl
except ImportError:
    # no such locks on this platform: processes may compile the same
    fcntl = None  # type: ignore[assignment]

_POLL = 0.05
_threads = threading.RLock()
_depth = 0
# said once a process
_said = False


@contextmanager
def one_process(folder: Path) -> Iterator[None]:
    """Wait until no other process is in such a block with the same folder, and keep them out until the end.

    A process that ends, in whatever way, keeps nobody out. Where the folder cannot be written to, nobody waits.
    """
    global _depth
    with _threads:
        file = _lock_file(folder) if _depth == 0 else None
        _depth += 1
        try:
            yield
        finally:
            _depth -= 1
            if file is not None:
                # closing releases the lock
                os.close(file)


def _lock_file(folder: Path) -> int | None:
    """Return a file that this process holds locked, or None where there are no locks."""
    global _said
    if fcntl is None:
        return None
    try:
        folder.mkdir(parents=True, exist_ok=True)
        file = os.open(folder / "lock", os.O_RDWR | os.O_CREAT, 0o666)
    except OSError:
        return None
    try:
        while True:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                return file
            except BlockingIOError:
                if not _said:
                    _logger.warning("another process compiles kernels: waiting for it ...")
                _said = True
                time.sleep(_POLL)
            except OSError:
                # a file system without locks
                os.close(file)
                return None
    except BaseException:
        # interrupted
        os.close(file)
        raise

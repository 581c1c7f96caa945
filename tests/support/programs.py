"""Programs that tests start: they import this checkout and what is shared by tests, and may be killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import h5py

from support.paths import ROOT, TESTS

# seconds after which something hangs, however loaded the machine is
LIMIT = 600.0


def environment() -> dict[str, str]:
    """Return the variables of a process that imports `mbvi` of this checkout, and `support`."""
    paths = [str(ROOT), str(TESTS), *filter(None, [os.environ.get("PYTHONPATH")])]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}


@contextmanager
def interruptible() -> Iterator[None]:
    """Let this process, and those that begin here, end on Ctrl-C, which is ignored in the background of a script."""
    # elsewhere nobody may set a handler
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def started(command: Sequence[Any], **options: Any) -> Iterator[subprocess.Popen[str]]:
    """Start a program that can be interrupted, with its output as text; it ends with the block at the latest.

    Parameters
    ----------
    command : sequence
        The program and its arguments.
    **options
        As of `subprocess.Popen`; `start_new_session` ends all processes of its session.
    """
    with interruptible():
        child = subprocess.Popen(
            [str(word) for word in command],
            **{"env": environment(), "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, **options},
        )
    with child:
        try:
            yield child
        finally:
            child.kill()
            if options.get("start_new_session"):
                with suppress(ProcessLookupError):
                    os.killpg(child.pid, signal.SIGKILL)


def run(command: Sequence[Any], **options: Any) -> subprocess.CompletedProcess[str]:
    """Run a program that can be interrupted to its end, and return what it said; options as of `started`."""
    with started(command, **options) as child:
        said, errors = child.communicate(timeout=LIMIT)
    return subprocess.CompletedProcess(child.args, child.returncode, said, errors)


def wait_until(condition: Callable[[], object], message: str = "") -> None:
    """Wait until a condition holds."""
    end = time.monotonic() + LIMIT
    while not condition():
        assert time.monotonic() < end, message
        time.sleep(0.02)


def kill_writing(program: str, path: Path, states: int, impacts: int) -> list[float]:
    """Run a program that writes a run to a file; kill it once so much is there, and return when more was seen [s]."""
    seen, changes, deadline = (0, 0), [], time.monotonic() + LIMIT
    with started([sys.executable, "-c", program, path], stdout=None, stderr=None) as child:
        # between two pieces, not within one
        while seen[0] < states or seen[1] < impacts or time.monotonic() < changes[-1] + 0.2:
            assert child.poll() is None and time.monotonic() < deadline, f"states and impacts written: {seen}"
            time.sleep(0.02)
            found = _written(path)
            if found[0] > seen[0]:
                changes.append(time.monotonic())
                seen = found
    return changes


def _written(path: Path) -> tuple[int, int]:
    try:
        with h5py.File(path, "r", locking=False) as file:
            return len(file["t"]), len(file["impacts/time"])
    except (OSError, KeyError, RuntimeError):
        # it is not there yet, or just being written
        return 0, 0

"""Programs that tests start: they import this checkout and what is shared by tests, and may be killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py

from support.paths import ROOT, TESTS


def environment() -> dict[str, str]:
    """Return the variables of a process that imports `mbvi` of this checkout, and `support`."""
    paths = [str(ROOT), str(TESTS), *filter(None, [os.environ.get("PYTHONPATH")])]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}


def kill_writing(program: str, path: Path, states: int, impacts: int) -> list[float]:
    """Run a program that writes a run to a file; kill it once so much is there, and return when more was seen [s]."""
    child = subprocess.Popen([sys.executable, "-c", program, str(path)], env=environment())
    seen, changes, deadline = (0, 0), [], time.monotonic() + 60.0
    try:
        # between two pieces, not within one
        while seen[0] < states or seen[1] < impacts or time.monotonic() < changes[-1] + 0.2:
            assert child.poll() is None and time.monotonic() < deadline, f"states and impacts written: {seen}"
            time.sleep(0.02)
            found = _written(path)
            if found[0] > seen[0]:
                changes.append(time.monotonic())
                seen = found
    finally:
        child.send_signal(signal.SIGKILL)
        child.wait()
    return changes


def _written(path: Path) -> tuple[int, int]:
    try:
        with h5py.File(path, "r", locking=False) as file:
            return len(file["t"]), len(file["impacts/time"])
    except (OSError, KeyError, RuntimeError):
        # it is not there yet, or just being written
        return 0, 0

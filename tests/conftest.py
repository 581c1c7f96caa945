"""What several test modules share: deterministic random data, the project's robots, and real ones."""

from __future__ import annotations

import signal
import subprocess
import sys
import sysconfig
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import settings

from mbvi.compiled import compile_all

ROBOTS = Path(__file__).parents[1] / "robots"
REAL_ROBOTS = Path(sysconfig.get_path("purelib")) / "cmeel.prefix/share/example-robot-data/robots"

settings.register_profile("mbvi", derandomize=True, deadline=None, max_examples=60)
settings.load_profile("mbvi")


@pytest.fixture(scope="session", autouse=True)
def kernels():
    """Compile before the first test, so that what is said about it does not mix with what a test reads."""
    compile_all()


@pytest.fixture
def rng():
    return np.random.default_rng(20_000)


def kill_writing(program: str, path: Path, *arguments: str, states: int, impacts: int) -> list[float]:
    """Run a program that writes a run to a file; kill it once so much is there, and return when more was seen [s]."""
    child = subprocess.Popen([sys.executable, "-c", program, str(path), *arguments])
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


def real_robot(path: str) -> Path:
    file = REAL_ROBOTS / path
    assert file.is_file(), "example-robot-data is part of the test extra: pip install -e .[test]"
    return file

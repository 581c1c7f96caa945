"""What several test modules share: deterministic random data, the project's robots, and real ones."""

from __future__ import annotations

import sysconfig
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings

from mbvi.compiled import load

ROBOTS = Path(__file__).parents[1] / "robots"
REAL_ROBOTS = Path(sysconfig.get_path("purelib")) / "cmeel.prefix/share/example-robot-data/robots"

settings.register_profile("mbvi", derandomize=True, deadline=None, max_examples=60)
settings.load_profile("mbvi")


@pytest.fixture(scope="session", autouse=True)
def kernels():
    """Compile before the first test, so that what is said about it does not mix with what a test reads."""
    load()


@pytest.fixture
def rng():
    return np.random.default_rng(20_000)


def real_robot(path: str) -> Path:
    file = REAL_ROBOTS / path
    assert file.is_file(), "example-robot-data is part of the test extra: pip install -e .[test]"
    return file

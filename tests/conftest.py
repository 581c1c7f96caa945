"""Deterministic random data, and kernels compiled before the first test."""

from __future__ import annotations

import os

import numpy as np
import pytest
from hypothesis import settings
from hypothesis.internal.conjecture import providers

from mbvi.compiled import compile_all

# where helpers assert, what they compared is shown
pytest.register_assert_rewrite("support")

settings.register_profile("mbvi", derandomize=True, deadline=None, max_examples=60)
settings.load_profile("mbvi")
# numbers found in whatever modules are loaded would make the examples of a test depend on the tests before it
providers.HypothesisProvider._local_constants = providers.Constants()


def pytest_collection_modifyitems(items):
    """Let the longest tests start first, so that no worker is left with one at the end."""
    marks = ((item, item.get_closest_marker("slow")) for item in items)
    seconds = {item: mark.kwargs.get("seconds", 0) if mark else 0 for item, mark in marks}
    items.sort(key=lambda item: -seconds[item])


@pytest.fixture(scope="session", autouse=True)
def kernels():
    """Compile before the first test, so that what is said about it does not mix with what a test reads."""
    worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0")[2:])
    workers = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
    compile_all(worker, workers)


@pytest.fixture(scope="module")
def sweeps_in_a_thread():
    """Let sweeps run in a thread of this process, and return its client: processes would need seconds to start."""
    import distributed

    with distributed.Client(
        processes=False, n_workers=1, threads_per_worker=1, dashboard_address="127.0.0.1:0"
    ) as client:
        yield client


@pytest.fixture
def python_steps(monkeypatch):
    """Runs without the compiled loop."""
    from mbvi.run.fixed_steps import taking

    monkeypatch.setattr(taking, "compiled_loop", lambda *_: None)


@pytest.fixture
def command(capfd, tmp_path, monkeypatch):
    """Run the command line in an empty folder; returns exit code, stdout and stderr, those of C++ included."""
    from mbvi.cli.main import main

    monkeypatch.chdir(tmp_path)

    def call(*arguments):
        with pytest.raises(SystemExit) as leave:
            main([str(a) for a in arguments])
        text = capfd.readouterr()
        return leave.value.code, text.out, text.err

    return call


@pytest.fixture
def rng():
    return np.random.default_rng(20_000)

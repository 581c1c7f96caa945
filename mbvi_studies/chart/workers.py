"""Worker processes of one thread each for sweeps, one after the other."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from functools import lru_cache
from multiprocessing import get_context
from typing import Any

from mbvi.schemes import OwnStepsScheme, Scheme

from .records import Record
from .sweep import Case, sweep

_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")


@contextmanager
def worker(*, silent: bool = False) -> Iterator[Callable[..., Any]]:
    """Yield a function that calls another one in a new process of one thread and returns its result.

    Parameters
    ----------
    silent : bool
        Whether to drop what the process prints. Its exceptions are raised here in any case.
    """
    kept = {name: os.environ.get(name) for name in _THREADS}
    # numerical libraries read these variables when they are loaded
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    try:
        with ProcessPoolExecutor(1, get_context("spawn"), _silence if silent else None) as pool:
            yield lambda what, *arguments: pool.submit(what, *arguments).result()
    finally:
        for name, value in kept.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _silence() -> None:
    nowhere = os.open(os.devnull, os.O_WRONLY)
    # C++ does not print through Python's streams
    for stream in (1, 2):
        os.dup2(nowhere, stream)


@lru_cache(maxsize=1)
def made(make: Callable[[float], Case], e: float) -> Case:
    """Return the case; it is made once for all schemes."""
    return make(e)


def swept(make: Callable[[float], Case], e: float, scheme: Scheme | OwnStepsScheme) -> tuple[Record, ...]:
    """Make a case and sweep a scheme over it; called in a worker process."""
    return sweep(made(make, e), scheme)


def machine() -> str:
    """Return the platform, the number of cores and the version of Python."""
    return f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}"

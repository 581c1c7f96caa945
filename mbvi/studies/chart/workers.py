"""Sweeps in processes of their own, one thread each, one after the other."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from functools import lru_cache
from multiprocessing import get_context
from typing import Any

from ...schemes import EventDriven, Scheme
from .records import Record
from .sweep import Case, sweep

_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")


@contextmanager
def worker(*, silent: bool = False) -> Iterator[Callable[..., Any]]:
    """Give a function that calls another in a new process of one thread and waits for what it returns.

    Parameters
    ----------
    silent : bool
        Drop what is printed there; what is raised there is raised here all the same.
    """
    kept = {name: os.environ.get(name) for name in _THREADS}
    # the numerical libraries read them when they are loaded
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
    # C++ prints past Python's own streams
    for stream in (1, 2):
        os.dup2(nowhere, stream)


@lru_cache(maxsize=1)
def made(make: Callable[[float], Case], e: float) -> Case:
    """Return the case, made once for all schemes that are run on it."""
    return make(e)


def swept(make: Callable[[float], Case], e: float, scheme: Scheme | EventDriven) -> tuple[Record, ...]:
    """Make a case and sweep it: what a process is given to do."""
    return sweep(made(make, e), scheme)


def machine() -> str:
    """Return what is run on, in words."""
    return f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}"

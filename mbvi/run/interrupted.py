"""Attaches the run so far to exceptions that end a simulation, and saves interrupted runs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Any

from ..results.trajectory import Trajectory


@contextmanager
def run_so_far(trajectory: Callable[[], Trajectory]) -> Iterator[None]:
    """Set the attribute `run` of any exception that leaves the block, KeyboardInterrupt too, to the run so far."""
    try:
        yield
    except BaseException as error:
        ended: Any = error
        ended.run = trajectory()
        raise


def save_interrupted(run: Trajectory) -> Path:
    """Save a run in the working directory under an unused name, "interrupted.h5" first, and return the name.

    Raises
    ------
    TrajectoryFileError
        If it cannot be written.
    """
    names = (Path(f"interrupted{f'_{k}' if k else ''}.h5") for k in count())
    path = next(name for name in names if not name.exists())
    run.save(path)
    return path

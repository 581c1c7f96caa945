"""What goes on beside the steps of a scheme that chooses their lengths: its file, its progress, the run so far."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import perf_counter

from ...problem import Problem
from ...results.files.hdf5 import Recording, Writer
from ...results.trajectory import Trajectory
from ...schemes import OwnStepsScheme
from ..interrupted import run_so_far
from ..progress import Progress

# units of the progress bar
_TICKS = 1000


@contextmanager
def recorded(
    problem: Problem,
    scheme: OwnStepsScheme,
    duration: float,
    record: Recording,
    so_far: Callable[[], Trajectory],
    out: str | os.PathLike[str] | None,
    progress: bool | None,
) -> Iterator[Callable[[float], None]]:
    """Write the file of a run and show its progress within the block, which calls the returned function with the time.

    `so_far` returns the run so far, for exceptions that leave the block.
    """
    with (
        run_so_far(so_far),
        Writer(out, problem, scheme, 0.0, record) as writer,
        Progress(_TICKS, progress) as bar,
    ):
        next_poll = 0.0

        def poll(t: float) -> None:
            nonlocal next_poll
            if perf_counter() >= next_poll:
                done = _TICKS * (t - problem.t0) / duration
                next_poll = min(writer.poll(), bar.poll(max(int(done), 1)))

        yield poll

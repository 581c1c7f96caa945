"""`load` for users: a run read from a file that can be simulated again."""

from __future__ import annotations

from dataclasses import replace
from functools import wraps
from typing import Any

from ..results.error_estimate import repeatable
from ..results.files.reading import load as read
from ..results.trajectory import Trajectory
from .simulate import simulate


@wraps(read)
def load(*args: Any, **kwargs: Any) -> Trajectory:
    """See `results.files.reading.load`."""
    run = repeatable(read(*args, **kwargs), simulate)
    # a file cannot keep the function that switched connections
    return replace(run, record=replace(run.record, again=None)) if run.record.switches else run

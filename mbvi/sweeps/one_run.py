"""One run of a study: what goes wrong in it is its row."""

from __future__ import annotations

import time
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..compiled import seconds_compiling
from ..errors import DivergedError, InputError
from ..problem import Problem
from ..results.trajectory import Trajectory
from ..run.simulate import simulate
from ..scene import Scene
from .limit import Limit, OverBudget, stop_watching
from .machine import machine
from .points import takes_rng
from .rows import STATUS, Row, measured
from .study import Study

# characters of a message that are kept
_LONGEST = 500


def run_point(study: Study, index: int, point: Mapping[str, Any]) -> Trajectory:
    """Make the problem of a point and simulate it.

    Parameters
    ----------
    study : Study
        The study.
    index : int
        Number of the run; its random numbers depend on it and the seed alone.
    point : mapping
        Arguments of `make`.

    Raises
    ------
    InputError
        If `make` returns neither a Scene nor a Problem.
    """
    arguments = dict(point)
    if takes_rng(study.make):
        arguments["rng"] = np.random.default_rng(np.random.SeedSequence(study.seed, spawn_key=(index,)))
    made = study.make(**arguments)
    problem = made.build() if isinstance(made, Scene) else made
    if not isinstance(problem, Problem):
        raise InputError(f"make must return a Scene or a Problem; it returned {type(made).__name__}")
    return simulate(problem, progress=False, **study.options)


def row_of(study: Study, index: int, point: Mapping[str, Any], runs: Path, ends_process: bool = False) -> Row:
    """Run a point and return its row.

    Parameters
    ----------
    study : Study
        The study.
    index : int
        Number of the run.
    point : mapping
        Arguments of `make`.
    runs : Path
        Folder of the runs that are kept.
    ends_process : bool
        Whether a run over its budget that cannot be interrupted ends the process.
    """
    row: Row = {"run": index, "status": STATUS.ok, "message": "", "notes": "", "cpu": 0.0, "host": machine()}
    run: Trajectory | None = None
    begin = time.thread_time() - seconds_compiling().cpu
    try:
        # warnings are in the notes, too
        with Limit(study.budget, ends_process), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            run = run_point(study, index, point)
            row |= measured(study.measure(run), point) | {"notes": "\n".join(run.notes)}
    except OverBudget as error:
        # it may have left the limit before its end
        stop_watching()
        run = getattr(error, "run", run)
        row |= {"status": STATUS.over_budget, "message": f"more than {study.budget:g} s of CPU time"}
    except DivergedError as error:
        run = error.run or run
        row |= {"status": STATUS.diverged, "message": _message(error)}
    except (Exception, SystemExit) as error:
        # a user's functions may raise anything
        run = getattr(error, "run", None) or run
        row |= {"status": STATUS.failed, "message": _message(error)}
    row["cpu"] = time.thread_time() - seconds_compiling().cpu - begin
    if run is not None and (study.keep == "all" or (study.keep == "failed" and row["status"] != STATUS.ok)):
        row["message"] += keep(run, kept(runs, index))
    return row


def killed_row(index: int, deaths: int) -> Row:
    """Return the row of a run whose process ended each time."""
    message = f"the worker process ended in this run, {deaths} times"
    return {"run": index, "status": STATUS.killed, "message": message, "notes": "", "cpu": 0.0, "host": machine()}


def kept(runs: Path, index: int) -> Path:
    """Return the file of a run that is kept."""
    return runs / f"{index:08d}.h5"


def keep(run: Trajectory, path: Path) -> str:
    """Write a run, whole; return why a run that diverged has no energies and cannot be written, else nothing."""
    part = path.with_suffix(".part")
    try:
        run.save(part)
    except DivergedError as error:
        return f"; the run is not kept: {error}"
    part.replace(path)
    return ""


def _message(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}"[:_LONGEST]

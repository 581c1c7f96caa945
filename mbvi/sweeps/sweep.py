"""`sweep`: many runs of one question, on one machine or many."""

from __future__ import annotations

import inspect
import os
import sys
from collections import Counter
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arguments import choice, file_path, function, integer, optional, positive, shown
from ..errors import InputError, TrajectoryFileError
from ..run.simulate import simulate
from .cluster import check_client, check_packages, client_of
from .points import Points, points_of
from .study import Study, StudyFolder, written

if TYPE_CHECKING:
    import xarray as xr
    from distributed import Client

_KEEP = ("none", "failed", "all")


def sweep(
    make: Callable[..., Any],
    parameters: Any,
    *,
    measure: Callable[..., Any],
    out: str | os.PathLike[str],
    client: Client | None = None,
    seed: int = 0,
    keep: str = "none",
    budget: float | None = None,
    **simulate_options: Any,
) -> xr.Dataset:
    """Simulate a problem at many points, on all cores or on a Dask cluster, and collect what is measured.

    Parameters
    ----------
    make : callable
        `make(**point)` returns a Scene or a Problem. If it has an argument `rng`, that is a random generator which
        depends on the seed and the number of the run alone.
    parameters : mapping, DataFrame, array of shape (n, d), or list of mappings
        Points: all combinations of a mapping of names to values, the rows of a table, or a list of points. The columns
        of an array of samples are the first arguments of `make`.
    measure : callable
        `measure(run)` returns a mapping of names to numbers, texts or arrays of numbers.
    out : path
        Folder of the study. If it holds the same study, only the missing runs are made. All workers must see it.
    client : distributed.Client, optional
        By default the current client, else a cluster on this machine with one process for each core.
    seed : int
        Seed of the random generators.
    keep : "none", "failed" or "all"
        Which runs are written to `out/runs`, for `mbvi.replay`.
    budget : float, optional
        CPU time after which a run is ended [s], without that of compiling.
    **simulate_options
        Options of `simulate`: `duration`, `step`, `scheme` and the others but `out` and `progress`.

    Returns
    -------
    xarray.Dataset
        What was measured; on a grid the parameters are dimensions, otherwise coordinates along "run". Beside it
        `status` ("ok", "failed", "diverged", "over budget" or "killed"), `message`, `notes`, `cpu` [s] and `host`.
        Runs without a result have nan; arrays of different shapes are filled up with nan.

    Raises
    ------
    InputError
        If an argument is wrong, packages are missing, `out` holds another study, or workers cannot begin.
    TrajectoryFileError
        If the folder cannot be written, or a file of rows is damaged.

    Notes
    -----
    A study that was interrupted or killed goes on where it was: finished runs of at most about a second are repeated.
    The table has the same bytes on equal processors, but for `cpu` and `host`. In a script, call it below
    `if __name__ == "__main__":`, because worker processes import the script.
    """
    check_packages()
    make, measure = _function(make, "make"), function(measure, "measure", "measure(run) -> dict")
    folder = StudyFolder(file_path(out, "out"))
    points = points_of(parameters, make)
    study = Study(
        make, measure, integer(seed, "seed", 0), choice(keep, "keep", _KEEP), optional(positive, budget, "budget"),
        _checked_options(simulate_options),
    )  # fmt: skip
    check_client(client)
    folder.open(study, points)
    return run_study(folder, study, points, client)


def run_study(
    folder: StudyFolder, study: Study, points: Points, client: Client | None = None, sizes: Any = None
) -> xr.Dataset:
    """Make the runs of a study that are missing, and return its table.

    Parameters
    ----------
    folder : StudyFolder
        The study, which is there.
    study, points : Study, Points
        What it holds.
    client : Client, optional
        See `sweep`.
    sizes : BatchSizes, optional
        Sizes of the batches.
    """
    from .outputs.dataset import dataset

    with folder.alone():
        missing = missing_runs(folder, len(points))
        if len(missing):
            _remove_marks(folder)
            with client_of(client) as (cluster, allowed):
                _run(cluster, allowed, folder, study, points, missing, sizes)
        return dataset(folder, points)


def missing_runs(folder: StudyFolder, count: int) -> np.ndarray:
    """Return the numbers of the runs that have no row."""
    from .rows import read_rows

    missing, there = np.ones(count, dtype=bool), read_rows(folder.rows, ["run"])["run"].to_numpy()
    if there.size and not 0 <= there[0] <= there[-1] < count:
        raise TrajectoryFileError(f"{folder.rows} holds rows of another study, of run {there[0]} to run {there[-1]}")
    missing[there] = False
    return np.flatnonzero(missing)


def _run(
    client: Client, allowed: int, folder: StudyFolder, study: Study, points: Points, missing: np.ndarray, sizes: Any
) -> None:
    from ..arguments.bar import Bar
    from .scheduling import Submission, run_missing

    name = getattr(study.make, "__name__", type(study.make).__name__).strip("<>")
    submission = Submission(client, folder, f"{folder.path.name}: {name}".replace("-", "_"), allowed)
    found: Counter[str] = Counter()
    with Bar(
        total=len(points),
        initial=len(points) - len(missing),
        unit="run",
        disable=not sys.stderr.isatty(),
        smoothing=0.1,
    ) as bar:

        def report(done: Any) -> None:
            found["failed"] += done.failed
            bar.set_postfix_str(f"{found['failed']} failed, {submission.workers} workers", refresh=False)
            bar.update(done.runs)

        run_missing(submission, points, missing, report, sizes)


def _function(given: Any, name: str) -> Any:
    """Return a function whose arguments can be seen."""
    if not callable(given) or isinstance(given, type):
        raise InputError(f"{name} must be a function of a point that returns a Scene or a Problem; got {shown(given)}")
    try:
        inspect.signature(given)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} must be a function whose arguments can be seen; got {shown(given)}") from error
    return given


def _checked_options(options: dict[str, Any]) -> dict[str, Any]:
    for name in ("problem", "out", "progress"):
        if name in options:
            raise InputError(
                f"{name} is no option of a sweep: runs are kept by keep=, and the sweep shows its progress"
            )
    try:
        inspect.signature(simulate).bind(None, **options)
    except TypeError as error:
        raise InputError(f"options of simulate: {error}") from error
    return options


def _remove_marks(folder: StudyFolder) -> None:
    """Remove what killed processes left beside the rows."""
    with written(folder.path):
        for pattern in ("*.running", "*.part"):
            for path in folder.rows.glob(pattern):
                path.unlink(missing_ok=True)

"""The replay of one run of a study."""

from __future__ import annotations

import os

from ...arguments import choice, file_path, integer, optional
from ...errors import InputError
from ...results.files.reading import load
from ...results.trajectory import Trajectory
from ..one_run import kept, run_point
from ..study import StudyFolder


def replay(
    study: str | os.PathLike[str],
    *,
    run: int | None = None,
    html: str | os.PathLike[str] | None = None,
    shapes: str = "visual",
) -> Trajectory:
    """Play a run of a study in the browser, or write its page; a run that was not kept is simulated again.

    Parameters
    ----------
    study : path
        Folder of the study.
    run : int
        Number of the run, as in the variable "run" of the table.
    html : path, optional
        Write a page that plays the run, instead of playing it.
    shapes : "visual" or "collision"
        See `Trajectory.replay_html`.

    Returns
    -------
    Trajectory
        The run.

    Raises
    ------
    InputError
        If the folder holds no study or no such run, its functions cannot be loaded, or the run has no scene to show.
    TrajectoryFileError
        If the page cannot be written.

    Notes
    -----
    For a run that was not kept the functions in the folder are executed: do that with studies you trust. If the run
    fails again, its error is raised.
    """
    if isinstance(study, Trajectory):
        raise InputError("study must be the folder of a study; a run is played by run.replay()")
    if run is None:
        raise InputError("run must be the number of a run of the study; it is missing")
    folder = StudyFolder(file_path(study, "study"))
    count = folder.about()["runs"]
    number = integer(run, "run", 0)
    page = optional(file_path, html, "html")
    shown = choice(shapes, "shapes", ("visual", "collision"))
    if number >= count:
        raise InputError(f"the study has runs 0 to {count - 1}; got run={number}")
    path = kept(folder.runs, number)
    if path.exists():
        found = load(path)
    else:
        made, points = folder.load()
        found = run_point(made, number, points[number])
    if page is None:
        found.replay(shapes=shown)
    else:
        found.replay_html(page, shapes=shown)
    return found

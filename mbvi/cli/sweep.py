"""`mbvi sweep`: many runs of a file that defines make, parameters and measure."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..errors import InputError
from .python_file import imported

if TYPE_CHECKING:
    import xarray as xr
    from distributed import Client

_Study = Annotated[
    Path | None, typer.Argument(metavar="[STUDY.py]", help="Defines make, parameters and measure.", show_default=False)
]


def sweep(
    study: _Study = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Folder of the study; the name of the file by default.")
    ] = None,
    workers: Annotated[
        int | None, typer.Option(help="Processes on this machine.", show_default="one for each core", min=1)
    ] = None,
    resume: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Make the missing runs of a study.", show_default=False)
    ] = None,
    status: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Print what a study has done so far.", show_default=False)
    ] = None,
) -> None:
    """Simulate a problem at many points.

    A study that was interrupted goes on where it was.
    The file may define options = dict(duration=..., ...), seed, keep and budget too, as of mbvi.sweep.
    """
    from ..sweeps.cluster import check_packages
    from ..sweeps.status import status as text_of
    from ..sweeps.study import StudyFolder
    from ..sweeps.sweep import run_study
    from ..sweeps.sweep import sweep as run_sweep

    if [study, resume, status].count(None) != 2:
        raise InputError("give STUDY.py, or --resume FOLDER, or --status FOLDER")
    check_packages()
    if status is not None:
        print(text_of(StudyFolder(status)))
        return
    if resume is not None:
        folder = StudyFolder(resume)
        made, points = folder.load()
        with _cluster(workers) as client:
            _print(run_study(folder, made, points, client), folder)
        return
    assert study is not None
    given = _definitions(study)
    folder = StudyFolder(Path(study.stem) if out is None else out)
    with _cluster(workers) as client:
        _print(run_sweep(**given, out=folder.path, client=client), folder)


def _cluster(workers: int | None) -> AbstractContextManager[Client | None]:
    from ..sweeps.cluster import local_client

    return nullcontext() if workers is None else local_client(workers)


def _definitions(path: Path) -> dict[str, Any]:
    """Return the arguments of `mbvi.sweep` that a file defines."""
    module = imported(path)
    missing = [name for name in ("make", "parameters", "measure", "options") if not hasattr(module, name)]
    if missing:
        raise InputError(f"{path} must define {', '.join(missing)}")
    given = {name: getattr(module, name) for name in ("make", "parameters", "measure")}
    given |= {name: getattr(module, name) for name in ("seed", "keep", "budget") if hasattr(module, name)}
    clashing = given.keys() & dict(module.options)
    if clashing:
        raise InputError(f"options must be those of simulate; {', '.join(clashing)} stands in the file itself")
    return given | dict(module.options)


def _print(table: xr.Dataset, folder: Any) -> None:
    from ..sweeps.status import status

    print(table)
    print()
    print(status(folder))

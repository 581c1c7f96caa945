"""`mbvi demo`: a run of a second, without a file to give."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..errors import TrajectoryFileError
from .running import Request, check_targets, print_problem, run_and_print


def demo(
    out_dir: Annotated[Path, typer.Option(metavar="FOLDER", help="Folder of the run and its replay.")] = Path("out"),
) -> None:
    """Drop a quadruped on the floor and hit it with a ball. Write the replay."""
    from ..shipped import demo_problem

    try:
        out_dir.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise TrajectoryFileError(f"the folder {out_dir} cannot be made: {error.strerror}") from error
    out, page = out_dir / "demo.h5", out_dir / "demo.html"
    check_targets(out, page)
    problem = demo_problem()
    print_problem(problem)
    run_and_print(problem, Request(None, 2.0, 1e-3, out=out, page=page))

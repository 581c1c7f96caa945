"""`mbvi replay`: play a run, or write a page that plays it."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Annotated

import typer

from ..errors import MbviWarning
from .replay import Shapes, page_name, play, write_page
from .running import ShapesOption, check_targets


def replay(
    run: Annotated[Path, typer.Argument(metavar="RUN.h5", help="A file that `simulate --out` wrote.")],
    html: Annotated[
        Path | None, typer.Option(metavar="PAGE.html", callback=page_name, help="Write a page instead of playing.")
    ] = None,
    shapes: ShapesOption = Shapes.visual,
) -> None:
    """Play a run in the browser."""
    from ..results import load

    check_targets(run, html)
    with warnings.catch_warnings():
        # a replay needs none of the functions that the file could not keep
        warnings.simplefilter("ignore", MbviWarning)
        trajectory = load(run)
    if not trajectory.complete:
        print(f"this run is incomplete: it ends at t = {trajectory.t[-1]:g} s")
    if html is None:
        play(trajectory, shapes)
    else:
        write_page(trajectory, html, shapes)

"""The file of a sweep: its cells, the bounds of its scenes, the machine and the limit of CPU time."""

from __future__ import annotations

import json
import platform
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from mbvi.errors import InputError

from .scene import StressScene
from .scenes import SCENES
from .sweep import Cell


def write_cells(cells: Sequence[Cell], budget: float, path: Path) -> None:
    """Write cells to a JSON file; infinite numbers are null, because JSON has none."""
    names = {cell.scene for cell in cells}
    about = [
        {"name": s.name, "number": s.number, "held": s.held, "failed": s.failed, "duration": s.duration}
        for s in SCENES
        if s.name in names
    ]
    rows = [asdict(cell) | {"value": cell.value if cell.value < float("inf") else None} for cell in cells]
    machine = f"{platform.machine()}, Python {platform.python_version()}"
    contents = {"machine": machine, "budget": budget, "scenes": about, "cells": rows}
    path.write_text(json.dumps(contents, indent=1))


def read_cells(path: Path, budget: float) -> list[Cell]:
    """Return the cells of a file that `write_cells` wrote.

    Raises
    ------
    InputError
        If there is no such file, or its runs had another limit of CPU time.
    """
    try:
        contents = json.loads(path.read_text())
        cells = [
            Cell(**row | {"value": float("inf") if row["value"] is None else row["value"]}) for row in contents["cells"]
        ]
        before = contents["budget"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path} is no file of `mbvi stress`: {error}") from error
    if before != budget:
        raise InputError(f"the runs of {path} had {before:g} s each: give --budget {before:g}")
    return cells


def replaced(cells: Sequence[Cell], scenes: Sequence[StressScene], new: Sequence[Cell]) -> list[Cell]:
    """Return cells with those of some scenes replaced by new ones, columns and scenes in the order of a sweep.

    Cells of engines that were not run again stay.
    """
    again, engines_run = {scene.name for scene in scenes}, {cell.scheme for cell in new}
    found = [c for c in cells if c.scene not in again or not (c.own or c.scheme in engines_run)] + [*new]
    place = {scene.name: k for k, scene in enumerate(SCENES)}
    engines = {name: k for k, name in enumerate(dict.fromkeys(cell.scheme for cell in found if not cell.own))}
    return sorted(
        (cell for cell in found if cell.scene in place),
        key=lambda cell: (engines.get(cell.scheme, -1), place[cell.scene]),
    )

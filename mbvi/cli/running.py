"""Runs a problem on the command line: what is printed before and after, and the files that are written."""

from __future__ import annotations

import math
import os
import time
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from ..arguments import positive
from ..errors import InputError, MbviWarning, TrajectoryFileError
from .names.schemes import SchemeName
from .names.solvers import SolverName
from .replay import Shapes, page_name, write_page

if TYPE_CHECKING:
    from ..problem import Problem
    from ..schemes import OwnStepsScheme, Scheme


def positive_option(option: typer.CallbackParam, value: float | None) -> float | None:
    """Refuse a number before the problem is built and printed."""
    return None if value is None else positive(value, str(option.name))


SchemeOption = Annotated[
    SchemeName | None, typer.Option(help="Scheme.", show_default="chosen for the problem, with the reason as a note")
]
StepOption = Annotated[
    float | None,
    typer.Option(
        callback=positive_option,
        help="Time step [s].",
        show_default="from the time scales of the problem; 1e-3 with --scheme",
    ),
]
ToleranceOption = Annotated[
    float | None,
    typer.Option(callback=positive_option, help="Error bound of event-driven and adaptive, instead of a step."),
]
DurationOption = Annotated[float, typer.Option(callback=positive_option, help="Simulated time [s].")]
SolverOption = Annotated[
    SolverName | None,
    typer.Option(
        help="Solver of all projections.", show_default="several in order, until one residual is small enough"
    ),
]
EveryOption = Annotated[int, typer.Option(help="Record every n-th step; impacts are always recorded.")]
OutOption = Annotated[
    Path | None, typer.Option(metavar="RUN.h5", help="File that the run is written to while it goes on.")
]
ReplayOption = Annotated[
    Path | None, typer.Option(metavar="PAGE.html", callback=page_name, help="Write a page that plays the run.")
]
ShapesOption = Annotated[Shapes, typer.Option(help="Which shapes of robots the replay shows.")]


class Request(NamedTuple):
    """How to run a problem.

    Attributes
    ----------
    scheme : Scheme, OwnStepsScheme or None
        None is the default one.
    duration : float
        Simulated time [s].
    step : float or None
        Time step [s].
    every : int
        Record every n-th step.
    out, page : Path or None
        Files of the run and of its replay.
    shapes : Shapes
        What the replay shows.
    more : mapping
        Further arguments of `simulate`.
    """

    scheme: Scheme | OwnStepsScheme | None
    duration: float
    step: float | None = None
    every: int = 1
    out: Path | None = None
    page: Path | None = None
    shapes: Shapes = Shapes.visual
    more: Mapping[str, Any] = MappingProxyType({})


def check_targets(source: Path, *targets: Path | None) -> None:
    """Raise before the run if a file cannot be written after it."""
    files = [t for t in targets if t is not None]
    if len({os.path.realpath(p) for p in (source, *files)}) <= len(files):
        raise InputError("input and output files must be different")
    for target in files:
        folder = target.parent
        if not folder.is_dir():
            raise TrajectoryFileError(f"{target} cannot be written: there is no folder {folder}")
        if target.is_dir():
            raise TrajectoryFileError(f"{target} cannot be written: it is a folder")
        if not os.access(target if target.exists() else folder, os.W_OK):
            raise TrajectoryFileError(f"{target} cannot be written: permission denied")
        if not target.exists():
            _make_and_remove(target)


def _make_and_remove(target: Path) -> None:
    """Raise if a file cannot be made, which some folders only say when one is."""
    try:
        target.open("xb").close()
        target.unlink()
    except OSError as error:
        raise TrajectoryFileError(f"{target} cannot be written: {error.strerror}") from error


def print_problem(problem: Problem, named_by: str = "problem.report()") -> None:
    """Print what is modelled; `named_by` is the command or the call that lists what is left out."""
    modelled, _, _ = problem.report().partition("\nLeft out")
    print(modelled)
    if problem.scene is None:
        print(flush=True)
        return
    left_out = len(problem.scene.omitted)
    if left_out:
        print(f"Left out: {left_out} item{'s' * (left_out > 1)}, which `{named_by}` lists")
    if problem.scene.items.robots and not any(placed.body for placed in problem.scene.shapes):
        print("no link has a collision shape: the robot touches nothing")
    print(flush=True)


def chosen_scheme(name: SchemeName | None, tolerance: float | None) -> Scheme | OwnStepsScheme | None:
    """Return the scheme of a name, or None; a tolerance alone selects EventDriven."""
    if tolerance is None:
        return None if name is None else name.make()
    if name not in (None, SchemeName.event_driven, SchemeName.adaptive):
        raise InputError(f"--tolerance is an option of event-driven and adaptive; {name} needs --step")
    from ..schemes import Adaptive, EventDriven

    return Adaptive(tolerance) if name is SchemeName.adaptive else EventDriven(tolerance)


def run_and_print(problem: Problem, request: Request) -> None:
    """Run a problem; print its impacts, energy, penetration and notes, and write its files."""
    from ..compiled import seconds_compiling
    from ..results.diagnosis.energies import energies
    from ..results.summary import limit_unit
    from ..run.interrupted import save_interrupted
    from ..run.simulate import simulate as run_problem

    scheme, duration, out = request.scheme, request.duration, request.out
    # the time of compiling kernels is left out
    begin = time.perf_counter() - seconds_compiling().wall
    with warnings.catch_warnings():
        # warnings are in the notes, too
        warnings.simplefilter("ignore", MbviWarning)
        try:
            run = run_problem(
                problem, scheme, step=request.step, duration=duration, every=request.every, out=out, **request.more
            )
        except KeyboardInterrupt as stop:
            so_far = getattr(stop, "run", None)
            if so_far is not None:
                kept = save_interrupted(so_far) if out is None else out
                print(f"run          {kept} (interrupted at t = {so_far.t[-1]:g} s)", flush=True)
            raise
    wall = time.perf_counter() - seconds_compiling().wall - begin
    ends = [0, -1]
    first, last = energies(problem, run.t[ends], run.q[ends], run.v[ends], run.step, run.record.timing.jump).sum(axis=1)
    # without fixed steps, the recorded states are counted
    steps = max(math.ceil(duration / run.step - 1e-9), 1) if run.step else len(run.t) - 1
    print(run.impact_table() if run.impacts else "no impact")
    print()
    print(f"energy       {first:.6g} J at the start, {last:.6g} J at the end")
    print(f"penetration  {run.penetration().max() + 0.0:.3g} m at most")
    if problem.constraints.limits:
        beyond, unit = run.limit_violation().max() + 0.0, limit_unit(problem)
        print(f"limits       violated by {beyond:.3g} {unit} at most")
    if len(problem.system.gaps(problem.q0)):
        print(f"loops        open by {run.loop_gap().max():.3g} m or rad at most")
    print(
        f"time         {wall:.2f} s for {steps} {'steps' if run.step else 'states'}, {1e3 * wall / steps:.3g} ms each"
    )
    print(f"scheme       {run.scheme}" + (f", h = {run.step:g} s" if run.step else ""))
    for note in _first_notes(run.notes):
        print(f"note         {note}")
    if out is not None:
        print(f"run          {out}")
    if request.page is not None:
        write_page(run, request.page, request.shapes)


def _first_notes(notes: Sequence[str], most: int = 3) -> Iterator[str]:
    yield from notes[:most]
    if len(notes) > most:
        yield f"and {len(notes) - most} more notes"

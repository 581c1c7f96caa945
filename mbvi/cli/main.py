"""The command line: `mbvi demo`, `simulate`, `inspect`, `replay`, `chart`, `stress` and `sweep`."""

from __future__ import annotations

import math
import os
import sys
import time
import warnings
from collections.abc import Collection, Iterator, Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

from ..errors import InadmissibleStartError, InputError, MbviError, MbviWarning, TrajectoryFileError
from ..run.interrupted import save_interrupted
from ..schemes import EventDriven, Scheme
from .chart import chart
from .replay import Shapes, play, write_page
from .scheme_names import SchemeName
from .solver_names import SolverName
from .stress import stress
from .sweep import sweep

if TYPE_CHECKING:
    from ..problem import Problem
    from ..projection import ChosenSolver

# height at which no robot reaches the floor; the distance of its lowest point is measured there [m]
_FAR_ABOVE = 1000.0
_DROP_HEIGHT, _RESTITUTION = 0.5, 0.5
# e and mu where none are given
_CONTACT = _RESTITUTION, 0.0

app = typer.Typer(
    help="Rigid multibody systems with impacts.",
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    add_completion=False,
)


class Base(StrEnum):
    """Whether the root link floats or is welded to the world."""

    free = "free"
    fixed = "fixed"


_Shapes = Annotated[Shapes, typer.Option(help="Which shapes of robots the replay shows.")]
_Robot = Annotated[Path, typer.Argument(metavar="ROBOT.urdf", help="The robot.", show_default=False)]
_Base = Annotated[Base, typer.Option(help="Whether the root link floats or is welded to the world.")]
_Srdf = Annotated[Path | None, typer.Option(metavar="FILE", help="Leave out the pairs that this SRDF disables.")]
_Height = Annotated[
    float | None,
    typer.Option(
        help="Clearance of a free robot's lowest point above the floor, or height of a fixed base [m].",
        show_default=f"{_DROP_HEIGHT:g} if free, 0 if fixed",
    ),
]
_Joints = Annotated[list[str] | None, typer.Option(metavar="NAME=VALUE", help="Initial position; repeatable.")]


@app.callback(invoke_without_command=True)
def _main(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Show the version and exit.")] = False,
) -> None:
    if version:
        from .. import __version__

        print(f"mbvi {__version__}")
    elif context.invoked_subcommand is None:
        print(context.get_help())


@app.command()
def simulate(
    robot: _Robot,
    base: _Base = Base.free,
    height: _Height = None,
    restitution: Annotated[
        float, typer.Option(help="Newton's e in [0, 1] of every contact and joint limit.")
    ] = _RESTITUTION,
    friction: Annotated[float, typer.Option(help="Coefficient of Coulomb friction of every contact.")] = 0.0,
    scheme: Annotated[
        SchemeName | None, typer.Option(help="Scheme.", show_default="chosen for the robot, with the reason as a note")
    ] = None,
    step: Annotated[
        float | None,
        typer.Option(help="Time step [s].", show_default="from the robot's own time scales; 1e-3 with --scheme"),
    ] = None,
    tolerance: Annotated[float | None, typer.Option(help="Error bound of event-driven, instead of a step.")] = None,
    solver: Annotated[
        SolverName | None,
        typer.Option(
            help="Solver of all projections.", show_default="several in order, until one residual is small enough"
        ),
    ] = None,
    duration: Annotated[float, typer.Option(help="Simulated time [s].")] = 2.0,
    joint: _Joints = None,
    srdf: _Srdf = None,
    every: Annotated[int, typer.Option(help="Record every n-th step; impacts are always recorded.")] = 1,
    out: Annotated[
        Path | None, typer.Option(metavar="RUN.h5", help="File that the run is written to while it goes on.")
    ] = None,
    replay: Annotated[Path | None, typer.Option(metavar="PAGE.html", help="Write a page that plays the run.")] = None,
    shapes: _Shapes = Shapes.visual,
) -> None:
    """Drop a robot on the floor z = 0 and print its impacts, energy and penetration."""
    _check_targets(robot, out, replay)
    chosen = _scheme(scheme, tolerance)
    problem = _problem_on_floor(robot, base, height, (restitution, friction), _joint_positions(joint or []), srdf)
    _print_problem(problem)
    _run(problem, chosen, step, duration, every, out, replay, shapes, None if solver is None else solver.solver)


@app.command()
def inspect(robot: _Robot, base: _Base = Base.free, srdf: _Srdf = None) -> None:
    """Print joints, shapes and constraints of a robot on a floor, and what is left out, with reasons."""
    from .tables import joint_table, shape_table

    try:
        problem = _problem_on_floor(robot, base, None, _CONTACT, {}, srdf)
    except InadmissibleStartError as error:
        if base is Base.free:
            raise
        problem = _robot_problem(robot, base, _FAR_ABOVE, _CONTACT, {}, srdf)
        print(f"as `mbvi simulate` would start it, {error}\n")
    print("\n\n".join((joint_table(problem), shape_table(problem), problem.report())))


@app.command()
def replay(
    run: Annotated[Path, typer.Argument(metavar="RUN.h5", help="A file that `simulate --out` wrote.")],
    html: Annotated[Path | None, typer.Option(metavar="PAGE.html", help="Write a page instead of playing.")] = None,
    shapes: _Shapes = Shapes.visual,
) -> None:
    """Play a run in the browser."""
    from ..results import load

    _check_targets(run, html)
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


@app.command()
def demo(
    out_dir: Annotated[Path, typer.Option(metavar="FOLDER", help="Folder of the run and its replay.")] = Path("out"),
) -> None:
    """Drop a quadruped on sprung legs, hit it with a ball, and write the replay."""
    from ..studies.shipped import demo_problem

    try:
        out_dir.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise TrajectoryFileError(f"the folder {out_dir} cannot be made: {error.strerror}") from error
    out, page = out_dir / "demo.h5", out_dir / "demo.html"
    _check_targets(out, page)
    problem = demo_problem()
    _print_problem(problem, named_by=None)
    _run(problem, None, 1e-3, 2.0, 1, out, page)


app.command()(chart)
app.command()(stress)
app.command()(sweep)


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run the command line and exit: with 0, or with 2 and one line on stderr for errors that the user can correct.

    Parameters
    ----------
    arguments : sequence of str, optional
        By default those of the process.
    """
    # UsageError of the click that typer uses, its own copy or the installed one
    usage: Any = typer.BadParameter.__base__
    try:
        code = app(args=None if arguments is None else list(arguments), prog_name="mbvi", standalone_mode=False)
    except usage as error:
        _fail(f"{error.format_message()} (see: mbvi --help)")
    except MbviError as error:
        _fail(str(error))
    except typer.Abort:
        code = 130
    except MemoryError as error:
        _fail(f"not enough memory: {error}; record less with --every, or simulate a shorter time")
    except OSError as error:
        _fail(f"{error.strerror or error}" + (f": {error.filename}" if error.filename else ""))
    # some versions of typer raise on Ctrl-C, others return the shell's code for it
    if code == 130:
        _fail("interrupted", 130)
    sys.exit(code if isinstance(code, int) else 0)


def _fail(message: str, code: int = 2) -> NoReturn:
    print("mbvi:", " ".join(message.split()), file=sys.stderr)
    sys.exit(code)


def _check_targets(source: Path, *targets: Path | None) -> None:
    """Raise before the run if a file cannot be written after it."""
    files = [t for t in targets if t is not None]
    if len({p.resolve() for p in (source, *files)}) <= len(files):
        raise InputError("input and output files must be different")
    for target in files:
        folder = target.parent
        if not folder.is_dir():
            raise TrajectoryFileError(f"{target} cannot be written: there is no folder {folder}")
        if target.is_dir():
            raise TrajectoryFileError(f"{target} cannot be written: it is a folder")
        if not os.access(target if target.exists() else folder, os.W_OK):
            raise TrajectoryFileError(f"{target} cannot be written: permission denied")


def _joint_positions(given: Sequence[str]) -> dict[str, float]:
    positions = {}
    for text in given:
        name, _, value = text.rpartition("=")
        try:
            positions[name] = float(value)
        except ValueError:
            name = ""
        if not name:
            raise InputError(f"--joint must be NAME=VALUE with a number; got {text!r}")
    return positions


def _robot_problem(
    robot: Path,
    base: Base,
    z: float,
    contact: tuple[float, float],
    joints: dict[str, float],
    srdf: Path | None,
    reduce: Collection[str] | None = None,
) -> Problem:
    from ..scene import Scene
    from ..scene.reductions import DEFAULT_REDUCTIONS

    scene = Scene(restitution=contact[0], friction=contact[1])
    scene.add_halfspace((0.0, 0.0, 1.0), name="floor")
    scene.add_urdf(
        robot, base=base.value, position=(0.0, 0.0, z), joints=joints, srdf=None if srdf is None else str(srdf)
    )
    return scene.build(DEFAULT_REDUCTIONS if reduce is None else reduce)


def _problem_on_floor(
    robot: Path,
    base: Base,
    height: float | None,
    contact: tuple[float, float],
    joints: dict[str, float],
    srdf: Path | None,
) -> Problem:
    """Return the problem of a robot above the floor z = 0; the lowest point of a free robot is at `height`.

    `contact` is e and mu.
    """
    if base is Base.fixed:
        try:
            return _robot_problem(robot, base, height or 0.0, contact, joints, srdf)
        except InadmissibleStartError as error:
            raise InadmissibleStartError(f"{error}; --height raises the base, --joint bends a joint") from error
    height = _DROP_HEIGHT if height is None else height
    problem = _robot_problem(robot, base, _FAR_ABOVE, contact, joints, srdf, ())
    floors = [family for family in problem.constraints.families if family.name(0).endswith(" | floor")]
    lowest = [_FAR_ABOVE - float(family.gap(problem.t0, problem.q0).min()) for family in floors]
    return _robot_problem(robot, base, height + min(lowest, default=0.0), contact, joints, srdf)


def _print_problem(problem: Problem, named_by: str | None = "mbvi inspect") -> None:
    modelled, _, _ = problem.report().partition("\nLeft out")
    print(modelled)
    assert problem.scene is not None
    left_out = len(problem.scene.omitted)
    if left_out:
        print(f"{left_out} reductions" + (f": `{named_by}` lists them" if named_by else ""))
    if not any(placed.body for placed in problem.scene.shapes):
        print("no link has a collision shape: the robot touches nothing")
    print(flush=True)


def _scheme(name: SchemeName | None, tolerance: float | None) -> Scheme | EventDriven | None:
    """Return the scheme of a name, or None; a tolerance alone selects EventDriven."""
    if tolerance is None:
        return None if name is None else name.make()
    if name not in (None, SchemeName.event_driven):
        raise InputError(f"--tolerance is an option of event-driven; {name} needs --step")
    return EventDriven(tolerance)


def _run(
    problem: Problem,
    scheme: Scheme | EventDriven | None,
    step: float | None,
    duration: float,
    every: int,
    out: Path | None,
    page: Path | None,
    shapes: Shapes = Shapes.visual,
    solver: ChosenSolver | None = None,
) -> None:
    from ..compiled import seconds_compiling
    from ..results.energies import energies
    from ..run.simulate import simulate as run_problem

    # the time of compiling kernels is left out
    begin = time.perf_counter() - seconds_compiling()
    with warnings.catch_warnings():
        # warnings are in the notes, too
        warnings.simplefilter("ignore", MbviWarning)
        try:
            run = run_problem(problem, scheme, step=step, duration=duration, every=every, out=out, solver=solver)
        except KeyboardInterrupt as stop:
            so_far = getattr(stop, "run", None)
            if so_far is not None:
                kept = save_interrupted(so_far) if out is None else out
                print(f"run          {kept} (interrupted at t = {so_far.t[-1]:g} s)", flush=True)
            raise
    wall = time.perf_counter() - seconds_compiling() - begin
    ends = [0, -1]
    first, last = energies(problem, run.t[ends], run.q[ends], run.v[ends], run.step, run.record.timing.jump).sum(axis=1)
    # without fixed steps, the recorded states are counted
    steps = max(math.ceil(duration / run.step - 1e-9), 1) if run.step else len(run.t) - 1
    print(run.impact_table() if run.impacts else "no impact")
    print()
    print(f"energy       {first:.6g} J at the start, {last:.6g} J at the end")
    print(f"penetration  {run.penetration().max() + 0.0:.3g} m at most (rad at a joint limit)")
    print(
        f"time         {wall:.2f} s for {steps} {'steps' if run.step else 'states'}, {1e3 * wall / steps:.3g} ms each"
    )
    print(f"scheme       {run.scheme}" + (f", h = {run.step:g} s" if run.step else ""))
    for note in _first_notes(run.notes):
        print(f"note         {note}")
    if out is not None:
        print(f"run          {out}")
    if page is not None:
        write_page(run, page, shapes)


def _first_notes(notes: Sequence[str], most: int = 3) -> Iterator[str]:
    yield from notes[:most]
    if len(notes) > most:
        yield f"and {len(notes) - most} more notes"

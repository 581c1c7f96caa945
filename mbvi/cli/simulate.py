"""`mbvi simulate` and `mbvi inspect`: a robot on a floor."""

from __future__ import annotations

from typing import Annotated

import typer

from ..errors import InadmissibleStartError
from .on_floor import DROP_HEIGHT, Base, BaseOption, RobotArgument, RobotOnFloor, SrdfOption, joint_positions
from .replay import Shapes, warnings_as_notes
from .running import (
    DurationOption,
    EveryOption,
    OutOption,
    ReplayOption,
    Request,
    SchemeOption,
    ShapesOption,
    SolverOption,
    StepOption,
    ToleranceOption,
    check_targets,
    chosen_scheme,
    print_problem,
    run_and_print,
)

_Height = Annotated[
    float | None,
    typer.Option(
        help="Clearance of a free robot's lowest point above the floor, or height of a fixed base [m].",
        show_default=f"{DROP_HEIGHT:g} if free, 0 if fixed",
    ),
]
_Joints = Annotated[list[str] | None, typer.Option(metavar="NAME=VALUE", help="Initial position; repeatable.")]


def simulate(
    robot: RobotArgument,
    base: BaseOption = None,
    height: _Height = None,
    restitution: Annotated[float, typer.Option(help="Newton's e in [0, 1] of every contact and joint limit.")] = 0.5,
    friction: Annotated[float, typer.Option(help="Coefficient of Coulomb friction of every contact.")] = 0.0,
    scheme: SchemeOption = None,
    step: StepOption = None,
    tolerance: ToleranceOption = None,
    solver: SolverOption = None,
    duration: DurationOption = 2.0,
    joint: _Joints = None,
    srdf: SrdfOption = None,
    every: EveryOption = 1,
    out: OutOption = None,
    replay: ReplayOption = None,
    shapes: ShapesOption = Shapes.visual,
) -> None:
    """Drop a robot on the floor z = 0. Print its impacts, energy and penetration."""
    check_targets(robot, out, replay)
    chosen = chosen_scheme(scheme, tolerance)
    placed = RobotOnFloor(robot, base, restitution, friction, joint_positions(joint or []), srdf)
    with warnings_as_notes():
        problem = placed.problem(height)
    print_problem(problem, named_by="mbvi inspect")
    more = {} if solver is None else {"solver": solver.solver}
    run_and_print(problem, Request(chosen, duration, step, every, out, replay, shapes, more))


def inspect(robot: RobotArgument, base: BaseOption = None, srdf: SrdfOption = None) -> None:
    """Print joints, shapes and constraints of a robot. Print also what is left out, and why."""
    from .tables import joint_table, shape_table

    placed = RobotOnFloor(robot, base, srdf=srdf)
    try:
        with warnings_as_notes():
            problem = placed.problem(None, lowered=False)
    except InadmissibleStartError as error:
        if base is not Base.fixed:
            raise
        problem = placed.problem(None, far_above=True)
        print(f"as `mbvi simulate` would start it, {error}\n")
    print("\n\n".join((joint_table(problem), shape_table(problem), problem.report())))

"""`mbvi run`: one run of a file that defines make; see `mbvi sweep`."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from ..errors import InputError, MbviError
from .python_file import imported
from .replay import Shapes
from .running import (
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
    positive_option,
    print_problem,
    run_and_print,
)

if TYPE_CHECKING:
    from ..problem import Problem

# what `mbvi run` passes on by options of its own
_OWN = ("scheme", "step", "duration", "every", "out", "progress")
_DURATION = 2.0
_WORDS = {"true": True, "false": False, "none": None}


def run(
    scene: Annotated[Path, typer.Argument(metavar="SCENE.py", help="Defines make(...) -> Scene or Problem.")],
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="NAME=VALUE", help="An argument of make; repeatable.", show_default=False),
    ] = None,
    scheme: SchemeOption = None,
    step: StepOption = None,
    tolerance: ToleranceOption = None,
    solver: SolverOption = None,
    duration: Annotated[
        float | None,
        typer.Option(
            callback=positive_option, help="Simulated time [s].", show_default=f"that of the file, or {_DURATION:g}"
        ),
    ] = None,
    every: EveryOption = 1,
    out: OutOption = None,
    replay: ReplayOption = None,
    shapes: ShapesOption = Shapes.visual,
) -> None:
    """Run the scene of a Python file. Print its impacts, energy and penetration.

    The file defines make, which returns a Scene or a Problem, and may define options = dict(duration=..., step=...),
    which are those of mbvi.simulate; a file of mbvi sweep is one. A value is a number, true, false, none, or anything
    that Python writes so, such as [1, 2]; other values are texts.
    """
    check_targets(scene, out, replay)
    chosen = chosen_scheme(scheme, tolerance)
    module = imported(scene)
    options = _options(module, scene)
    if solver is not None:
        options["solver"] = solver.solver
    problem = _made(module, scene, _values(settings or []))
    print_problem(problem)
    request = Request(
        options.pop("scheme", None) if chosen is None else chosen,
        options.pop("duration", _DURATION) if duration is None else duration,
        options.pop("step", None) if step is None else step,
        options.pop("every", 1) if every == 1 else every,
        out,
        replay,
        shapes,
        {name: value for name, value in options.items() if name not in _OWN},
    )
    run_and_print(problem, request)


def _options(module: ModuleType, path: Path) -> dict[str, Any]:
    from ..run.simulate import simulate

    given = getattr(module, "options", {})
    if not isinstance(given, dict):
        raise InputError(f"{path}: options must be a dict of arguments of mbvi.simulate")
    unknown = sorted(set(map(str, given)) - set(inspect.signature(simulate).parameters))
    if unknown:
        raise InputError(f"{path}: mbvi.simulate has no argument {', '.join(unknown)}, which options give")
    return dict(given)


def _values(texts: Sequence[str]) -> dict[str, Any]:
    """Return what texts NAME=VALUE set."""
    values: dict[str, Any] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not (equals and name.isidentifier()):
            raise InputError(f"--set must be NAME=VALUE; got {text!r}")
        try:
            values[name] = _WORDS[value.lower()] if value.lower() in _WORDS else ast.literal_eval(value)
        except (ValueError, SyntaxError, MemoryError, RecursionError):
            values[name] = value
    return values


def _made(module: ModuleType, path: Path, values: dict[str, Any]) -> Problem:
    """Return the problem that the file makes."""
    from ..problem import Problem
    from ..scene import Scene
    from ..sweeps.points import takes_rng

    make = getattr(module, "make", None)
    if not callable(make):
        raise InputError(f"{path} must define make(...) -> Scene or Problem")
    rng = {"rng": np.random.default_rng(getattr(module, "seed", 0))} if takes_rng(make) else {}
    try:
        inspect.signature(make).bind(**values, **rng)
    except TypeError as error:
        known = ", ".join(name for name in inspect.signature(make).parameters if name != "rng")
        raise InputError(f"{path}: make: {error}; set its arguments by --set, which are {known or 'none'}") from error
    try:
        made = make(**values, **rng)
    except MbviError:
        raise
    except Exception as error:
        raise InputError(f"{path}: make raises {type(error).__name__}: {error}") from error
    problem = made.build() if isinstance(made, Scene) else made
    if not isinstance(problem, Problem):
        raise InputError(f"{path}: make must return a Scene or a Problem; got {type(made).__name__}")
    return problem

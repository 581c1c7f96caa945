"""Time of one step of published robots, beside MuJoCo with the same hulls in the same run.

    python benchmarks/real_robots.py         # print "Published robots" of docs/benchmarks/performance.md
    python benchmarks/real_robots.py --write        # and write it there
    python benchmarks/real_robots.py --robot solo12 --repeats 1

Each robot falls for 1 s from 2 cm above a floor, e = 0; the Panda, whose base is fixed, falls along its joints. Then
each robot with legs glides over the floor for 1 s on its feet, held by a PD control written in Python. MuJoCo gets the
same mechanism, shapes, pairs, limits, start and control, no friction, its Euler integrator, its default solver.

A time is that of a run less that of its first step. It is CPU time without the build; those of the engines alternate,
times are medians over the repeats, and a ratio is the median of the ratios of runs next to each other. Rows, searches,
projections and shares are those of a run of its own, for counting slows a step: a search is a call of the admissible
set that asks for contacts, a projection one of the projector. BLAS
runs on one thread unless OPENBLAS_NUM_THREADS says otherwise. The robots come with example-robot-data and MuJoCo with
mujoco (`pip install mbvi[test]`).
"""

from __future__ import annotations

import os

# read once, when numpy is imported
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

import argparse  # noqa: E402
import time  # noqa: E402
from collections.abc import Callable, Iterator  # noqa: E402
from contextlib import ExitStack, contextmanager  # noqa: E402
from itertools import islice  # noqa: E402
from typing import Any, NamedTuple  # noqa: E402
from unittest import mock  # noqa: E402

import numpy as np  # noqa: E402
from robot_cases import again  # noqa: E402
from standing_robots import PD, STANCES, standing  # noqa: E402
from turns import (  # noqa: E402
    DURATION,
    HEADS,
    PAGE,
    SCHEMES,
    STEP,
    machine,
    run_time,
    simulated,
    table,
    times,
    timing_cells,
    write_section,
)

import mbvi  # noqa: E402
from mbvi.compiled import compile_all  # noqa: E402
from mbvi.constraints import AdmissibleSet  # noqa: E402
from mbvi.projection import Projector  # noqa: E402
from mbvi.run.fixed_steps import taking  # noqa: E402
from mbvi_studies.engines.robot_in_mujoco import MuJoCoRobot  # noqa: E402
from mbvi_studies.published_robots import PUBLISHED, published_robot  # noqa: E402

TITLE = "## Published robots"
HEIGHT = 0.02


class Counted:
    """Number of calls of some methods and the time in them; calls from within another one are part of it."""

    def __init__(self) -> None:
        self.calls, self.seconds, self._depth = 0, 0.0, 0

    def wrap(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return the function, counted."""

        def counted(*args: Any, **kwargs: Any) -> Any:
            self._depth += 1
            start = time.perf_counter()
            try:
                return function(*args, **kwargs)
            finally:
                self._depth -= 1
                if not self._depth:
                    self.calls += 1
                    self.seconds += time.perf_counter() - start

        return counted


class Counts(NamedTuple):
    """Means of a run: active rows, searches and projections a step, their parts of the time, the depth [m, rad]."""

    rows: float
    searches: float
    projections: float
    search_part: float
    projection_part: float
    depth: float


@contextmanager
def counting() -> Iterator[tuple[Counted, Counted]]:
    """Count contact searches and projections while the context lasts; all steps are Python's."""
    found = Counted(), Counted()
    methods = ((AdmissibleSet, ("active",)), (Projector, ("law", "project")))
    with ExitStack() as stack:
        stack.enter_context(mock.patch.object(taking, "compiled_loop", lambda *_: None))
        for counted, (owner, names) in zip(found, methods, strict=True):
            for name in names:
                if hasattr(owner, name):
                    wrapped = counted.wrap(getattr(owner, name))
                    stack.enter_context(mock.patch.object(owner, name, wrapped))
        yield found


def counts(problem: mbvi.Problem, scheme: mbvi.schemes.Scheme | None) -> Counts:
    """Return rows, searches and projections of a run at the fixed step."""
    n = round(DURATION / STEP)
    rows = np.mean([step.active.gap.size for step in islice(mbvi.steps(again(problem), scheme, step=STEP), n)])
    problem = again(problem)
    with counting() as (searches, projections):
        start = time.perf_counter()
        run = simulated(problem, scheme, DURATION, STEP)
        spent = time.perf_counter() - start
    parts = searches.seconds / spent, projections.seconds / spent
    return Counts(
        float(rows),
        searches.calls / n,
        projections.calls / n,
        *parts,
        float(np.maximum(run.penetration(), run.limit_violation()).max()),
    )


def chosen(problem: mbvi.Problem, repeats: int) -> tuple[float, str]:
    """Return the CPU time of a simulated second where no step is named [s], and the scheme and step chosen."""
    run = simulated(again(problem), None, DURATION, None)
    spent = float(np.median([run_time(problem, None, DURATION, None) for _ in range(repeats)]))
    lifts = ", positions projected" if getattr(run.record.scheme, "project_positions", False) else ""
    return spent / DURATION, run.scheme + lifts + (f", h = {run.step:.2g} s" if run.step else "")


def falling_lines(name: str, repeats: int) -> tuple[str, list[str], str]:
    """Return a falling robot's line of times, its lines of counts, and what costs it."""
    problem, title = published_robot(name, HEIGHT), PUBLISHED[name].title
    peer = MuJoCoRobot(problem, np.zeros(problem.system.nv), STEP)
    spent, choice = chosen(problem, repeats)
    line = f"| {title} | {timing_cells(times(problem, peer.time, repeats))} | {spent:.2f} | {choice} |"
    theirs, lines, parts = peer.rows(round(DURATION / STEP)), [], {}
    for scheme, given in SCHEMES.items():
        parts[scheme] = c = counts(problem, given)
        number = f"{c.rows:.1f} / {theirs:.1f} | {c.searches:.1f} | {c.projections:.1f}"
        lines.append(f"| {title} | {scheme} | {number} | {1e3 * c.depth:.2g} |")
    return line, lines, costs(title, problem, parts)


def costs(title: str, problem: mbvi.Problem, parts: dict[str, Counts]) -> str:
    """Return a sentence on where the time of a step goes."""
    shapes = [s.shape for s in problem.scene.shapes] if problem.scene is not None else []
    vertices = sum(len(s.vertices) for s in shapes if isinstance(s, mbvi.geometry.shapes.shapes.Hull))
    shares = [
        f"{100 * c.search_part:.0f} % of a step of {'the ' * (name == 'default')}{name} are contact searches and "
        f"{100 * c.projection_part:.0f} % projections"
        for name, c in parts.items()
    ]
    return f"- **{title}**, hulls of {vertices} vertices in all: {'; '.join(shares)}."


def standing_line(name: str, repeats: int) -> str:
    """Return a standing robot's line."""
    problem, control = standing(name, STEP)
    peer = MuJoCoRobot(problem, np.zeros(problem.system.nv), STEP)
    found = times(problem, lambda count: peer.time_controlled(control, count), repeats)
    c = counts(problem, None)
    fallen = abs(simulated(again(problem), None, DURATION, STEP).q[-1, 2] - problem.q0[2])
    number = f"{c.rows:.1f} | {c.searches:.1f} | {c.projections:.1f} | {1e3 * c.depth:.2g} | {1e3 * fallen:.2g}"
    return f"| {PUBLISHED[name].title} | {timing_cells(found)} | {number} |"


def control_cost(control: PD) -> float:
    """Return the time of one call of a control [s]."""
    q, v, count = np.zeros(7 + len(control.angle)), np.zeros(6 + len(control.angle)), 10_000
    start = time.process_time()
    for _ in range(count):
        control(0.0, q, v)
    return (time.process_time() - start) / count


def section(names: list[str], repeats: int) -> str:
    """Return the section of the page."""
    falling = [falling_lines(name, repeats) for name in names]
    stood = [name for name in names if name in STANCES]
    settings = {
        "motion": f"falling for {DURATION:g} s from {1e3 * HEIGHT:g} mm above a floor, e = 0; the Panda is fixed",
        "Paoli, default": f"`simulate` with `Paoli()` and with no scheme at h = {STEP:g} s, recording included",
        "no step": "`simulate` with neither scheme nor step",
        "MuJoCo": "`mj_step` on the same hulls, pairs and limits; condim 1, no friction, Euler, default solver",
        "time": f"CPU time without the build, medians of {repeats} repeats, the engines in turns",
        "machine": machine(),
    }
    parts = [
        TITLE,
        "    python benchmarks/real_robots.py --write    # measures, and writes this section",
        "Robots of example-robot-data with the hulls of their own meshes, reduced as `add_urdf` does by default.",
        table("setting | value", [f"| {key} | {value} |" for key, value in settings.items()]),
        table(f"falling robot | {HEADS} | no step [s CPU per s] | its choice", [one[0] for one in falling]),
        "Active rows, contact searches (queries of the admissible set) and projections are means over all steps.\n"
        "The depth is the deepest of the run, of contacts and limits.",
        table(
            "falling robot | scheme | rows, mbvi / MuJoCo | searches | projections | depth [mm, mrad]",
            [line for one in falling for line in one[1]],
        ),
        "Parts of a step, which include the time that counting costs:",
        "\n".join(one[2] for one in falling),
    ]
    if stood:
        cost = 1e6 * control_cost(standing(stood[0], STEP)[1])
        heads = f"standing robot | {HEADS} | rows | searches | projections | depth [mm, mrad] | sunk [mm]"
        parts += [
            "The same robots gliding on their feet under a PD control written in Python, which both engines call at\n"
            f"every step; a call costs {cost:.1f} us. Counts, and how far the base sinks in the run, are those of the\n"
            "default.",
            table(heads, [standing_line(name, repeats) for name in stood]),
        ]
    return "\n\n".join(parts) + "\n"


def main() -> None:
    """Print the section and, with --write, put it into the page."""
    parser = argparse.ArgumentParser(description="Time steps of published robots beside MuJoCo.")
    parser.add_argument("--repeats", type=int, default=5, help="runs of each engine per robot")
    parser.add_argument("--robot", action="append", choices=list(PUBLISHED), help="only this robot; repeatable")
    parser.add_argument("--write", action="store_true", help=f"replace the section in docs/benchmarks/{PAGE.name}")
    arguments = parser.parse_args()
    if arguments.repeats < 1:
        parser.error("at least 1 repeat is asked for")
    if arguments.write and arguments.robot:
        parser.error("the page has all robots: leave --robot out")
    compile_all()
    text = section(arguments.robot or list(PUBLISHED), arguments.repeats)
    print(text)
    if arguments.write:
        write_section(TITLE, text)


if __name__ == "__main__":
    main()

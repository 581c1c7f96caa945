"""Time of one step of a robot, beside MuJoCo on the same robot in the same run.

The robots step at h = 1e-3 s through `mbvi.simulate` with `Paoli()` and with the default scheme at a given step,
recording included, and through MuJoCo's batched `mj_step`, which records nothing. They take turns, so that a busy
machine slows all.

    python benchmarks/robot_step.py                 # the table
    python benchmarks/robot_step.py --profile       # and mbvi's time by layer
    python benchmarks/robot_step.py --case feet     # only cases whose name contains it
    python benchmarks/robot_step.py --friction      # a quadruped with friction and without
    python benchmarks/robot_step.py --write         # the same, and writes the section of docs/benchmarks/performance.md

The cases are in `robot_cases.py`. Robots that stand are held by constant torques that balance gravity, and glide over
the floor at 0.1 m/s: a robot at rest would repeat the same q, and caches per q would answer. MuJoCo gets the same
mechanism (its mass matrix and gravity at the start are compared with Pinocchio's), shapes, half-spaces, joint limits,
start, torques and pairs; no friction, its Euler integrator, its default solver.

"rows" are the active constraints of a step, contacts and joint limits, averaged over the run in an untimed pass. The
two differ where bodies strike: mbvi's impact is over within a step, MuJoCo's spring, damped to the same e, needs about
thirteen. A stand under constant torques is unstable. It holds in mbvi; in MuJoCo the floor gives way a little and sets
it moving, on two feet so far that the joints fly by the end, while the rows stay as they are. Talos stands on eight
dependent rows (of rank six), the kneeling quadruped on eight independent ones.

With --friction the quadruped stands on four feet under a PD control, with and without friction: `mbvi.PDControl`, and
springs and dampers of MuJoCo's joints. It is pushed: with friction it sways on its feet, without it glides. MuJoCo has
its elliptic cone.

A time is (n steps - 1 step) / (n - 1), which removes set-up and first call. It is CPU time, because on a busy machine
the longer run would wait more often. Times are medians over the repeats; the ratio is that of runs next to each other.
Each case runs once untimed before. Times of layers are wall-clock times of the fastest run. BLAS runs on one thread
unless OPENBLAS_NUM_THREADS says otherwise. The Panda and Talos come with example-robot-data (`pip install mbvi[test]`).
MuJoCo (`pip install mbvi[studies]`) is optional: without it mbvi's columns stand alone.
"""

from __future__ import annotations

import os

# read once, when numpy is imported
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

import argparse  # noqa: E402
import platform  # noqa: E402
import time  # noqa: E402
from collections.abc import Callable  # noqa: E402
from functools import partial  # noqa: E402
from importlib.metadata import version  # noqa: E402
from itertools import islice  # noqa: E402

import numpy as np  # noqa: E402
from layers import LAYERS, layers  # noqa: E402
from robot_cases import CASES, DAMPING, STIFFNESS, Case, again, pushed  # noqa: E402
from turns import (  # noqa: E402
    DURATION,
    HEADS,
    PAGE,
    SCHEMES,
    STEP,
    machine,
    simulated,
    table,
    times,
    timing_cells,
    write_section,
)

import mbvi  # noqa: E402
from mbvi.compiled import compile_all  # noqa: E402

try:
    import mujoco
except ImportError:
    mujoco = None
else:
    from mbvi_studies.engines.robot_in_mujoco import MuJoCoRobot

Array = np.ndarray

TITLE, FRICTION = "## Friction", 0.7


def mbvi_rows(case: Case, count: int) -> float:
    """Return the mean number of active rows over `count` steps, the first excluded."""
    walk = mbvi.steps(again(case.problem), mbvi.Paoli(), step=STEP)
    return float(np.mean([step.active.gap.size for step in islice(walk, 1, count)]))


def mbvi_times(case: Case, count: int, repeats: int, between: Callable[[], None] = lambda: None) -> Array:
    """Return the times of one step of `count` by both schemes, without set-up, shape (2, repeats) [s].

    `between` is called after each repeat.
    """
    schemes = list(SCHEMES.values())
    one, many = np.empty((2, repeats)), np.empty((2, repeats))
    for k in range(repeats):
        for s, scheme in enumerate(schemes):
            one[s, k], many[s, k] = (run_time(again(case.problem), n, scheme=scheme) for n in (1, count))
        between()
    # the median of the set-up, which is longer than many steps; its scatter would hide them
    return (many - np.median(one, axis=1)[:, None]) / (count - 1)


def run_time(
    problem: mbvi.Problem,
    count: int,
    clock: Callable[[], float] = time.process_time,
    scheme: mbvi.schemes.Scheme | None = SCHEMES["Paoli"],
) -> float:
    """Return the time of a run, including set-up [s]."""
    start = clock()
    mbvi.simulate(problem, scheme, step=STEP, duration=count * STEP, progress=False)
    return clock() - start


def line(case: Case, count: int, repeats: int) -> str:
    """Time one case, alternating between the engines, and return its line of the table."""
    # compiling and loading at first use is not timed
    for scheme in SCHEMES.values():
        run_time(again(case.problem), count, scheme=scheme)
    rows = mbvi_rows(case, count)
    if mujoco is None:
        mine = 1e6 * np.median(mbvi_times(case, count, repeats), axis=1)
        cells = "".join(f"{each:12.1f}{'-':>7}" for each in mine)
        return f"{case.name:34}{'-':>16}{cells}{rows:11.2f}{'-':>13}"
    peer, others = MuJoCoRobot(case.problem, case.torque, STEP), []
    peer.time(count)
    times = mbvi_times(case, count, repeats, between=lambda: others.append(peer.time(count)))
    mine, ratios = 1e6 * np.median(times, axis=1), np.median(times / others, axis=1)
    cells = "".join(f"{each:12.1f}{ratio:7.2f}" for each, ratio in zip(mine, ratios, strict=True))
    return f"{case.name:34}{1e6 * np.median(others):16.1f}{cells}{rows:11.2f}{peer.rows(count):13.2f}"


def profile(case: Case, count: int, repeats: int) -> str:
    """Return one line of the table of layers: microseconds and percent of each, and their sum."""
    run = partial(run_time, clock=time.perf_counter)
    spent = 1e6 * layers(partial(again, case.problem), run, count, repeats)
    shares = "".join(f"{value:9.1f}{100.0 * value / spent.sum():5.0f} %" for value in spent)
    return f"{case.name:34}{shares}{spent.sum():9.1f}"


def friction_section(repeats: int) -> str:
    """Return the section of the page on friction."""
    lines = []
    for mu in (0.0, FRICTION):
        problem, torque = pushed(mu)
        peer = MuJoCoRobot(problem, torque, STEP)
        peer.hold_joints(problem.q0, STIFFNESS, DAMPING)
        found = times(problem, peer.time, repeats)
        fallen = abs(simulated(again(problem), None, DURATION, STEP).q[-1, 2] - problem.q0[2])
        lines.append(f"| {f'mu = {mu:g}' if mu else 'none'} | {timing_cells(found)} | {1e3 * fallen:.2g} |")
    settings = {
        "motion": "a quadruped (18 dof) stands on four feet and is pushed: it sways with friction, and glides without",
        "control": "PD control of the joints: `mbvi.PDControl`, and springs and dampers of MuJoCo's joints",
        "mbvi": f"`simulate` of {DURATION:g} s at h = {STEP:g} s, recording included",
        "MuJoCo": "elliptic cone, Euler, default solver",
        "time": f"CPU time, medians of {repeats} repeats, the engines in turns",
        "machine": machine(),
    }
    parts = [
        TITLE,
        "    python benchmarks/robot_step.py --write    # measures, and writes this section",
        table("setting | value", [f"| {key} | {value} |" for key, value in settings.items()]),
        table(f"friction | {HEADS} | sunk [mm]", lines),
    ]
    return "\n\n".join(parts) + "\n"


def header(count: int, repeats: int) -> str:
    """Return machine and versions."""
    peer = f"mujoco {mujoco.__version__}" if mujoco is not None else "no mujoco"
    load = f", load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    numerics = ", ".join(f"{name} {version(name)}" for name in ("pin", "coal", "numpy", "scipy", "numba"))
    return (
        f"{os.cpu_count()} CPUs{load}, {platform.machine()} {platform.system()}, Python {platform.python_version()}\n"
        f"mbvi {mbvi.__version__}, {numerics}, {peer}\n"
        f"BLAS threads {os.environ['OPENBLAS_NUM_THREADS']}, h = {STEP:g} s, {count} steps, median of {repeats} repeats"
    )


def main() -> None:
    """Print the table and, with --profile, the layers."""
    parser = argparse.ArgumentParser(description="Time one step of robots beside MuJoCo.")
    parser.add_argument("--steps", type=int, default=150, help="steps per run; standing robots fall in longer runs")
    parser.add_argument("--repeats", type=int, default=21, help="runs of each engine per case")
    parser.add_argument("--case", default="", metavar="TEXT", help="only the cases whose name contains this")
    parser.add_argument("--profile", action="store_true", help="print mbvi's time by layer")
    parser.add_argument("--friction", action="store_true", help="time a quadruped with friction and without")
    parser.add_argument("--write", action="store_true", help=f"the same, and write it to docs/benchmarks/{PAGE.name}")
    arguments = parser.parse_args()
    count, repeats = arguments.steps, arguments.repeats
    if count < 2 or repeats < 1:
        parser.error("at least 2 steps and 1 repeat are asked for")
    if arguments.friction or arguments.write:
        if mujoco is None:
            parser.error("MuJoCo is not installed: pip install mujoco")
        compile_all()
        text = friction_section(repeats)
        print(text)
        if arguments.write:
            write_section(TITLE, text)
        return
    names = [name for name in CASES if arguments.case.lower() in name.lower()]
    if not names:
        parser.error(f"no case has {arguments.case!r} in its name; there are {', '.join(CASES)}")
    print(header(count, repeats), end="\n\n")
    columns = (("MuJoCo us/step", 16), ("Paoli", 12), ("ratio", 7), ("default", 12), ("ratio", 7))
    columns += (("rows mbvi", 11), ("rows MuJoCo", 13))
    print(f"{'case':34}" + "".join(f"{title:>{width}}" for title, width in columns))
    chosen = [Case(name, *CASES[name]()) for name in names]
    for case in chosen:
        print(line(case, count, repeats), flush=True)
    if arguments.profile:
        print(f"\n{'layers [us per step]':34}" + "".join(f"{name:>16}" for name in LAYERS) + f"{'sum':>9}")
        for case in chosen:
            print(profile(case, count, repeats), flush=True)


if __name__ == "__main__":
    main()

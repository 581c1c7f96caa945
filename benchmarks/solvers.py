"""Time and residual of every projection solver on the projections of robots, stacks and piles.

    python benchmarks/solvers.py                # the table of docs/developer/solvers.md
    python benchmarks/solvers.py --case pile    # only cases whose name has it

Each case is a run by default solvers whose projections are kept: the last ones that violate a row, up to eight. Every
solver then solves each of them from zero, in turns. A time is that of one projection, scaling included, the median over
all of the fastest of several repeats. A residual is the largest over all projections, relative to the largest speed.
"-" stands where a solver did not reach the residual 1e-6, and for dense solvers on more than 250 rows.
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
from itertools import islice  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import Any  # noqa: E402
from unittest import mock  # noqa: E402

import numpy as np  # noqa: E402

import mbvi  # noqa: E402
from mbvi.errors import ProjectionError  # noqa: E402
from mbvi.projection import ChosenSolver, Metric, Projector  # noqa: E402
from mbvi.projection.dense.scaled_qp import ScaledQP  # noqa: E402
from mbvi_studies.chart.piles import spheres  # noqa: E402

SOLVERS: dict[str, ChosenSolver | None] = {
    "default": None,
    "ProxQP": mbvi.ProxQP(),
    "DualActiveSet": mbvi.DualActiveSet(),
    "SparsePCG": mbvi.SparsePCG(),
}
ROBOTS = Path(__file__).parents[1] / "robots"
RESIDUAL, STEP, KEPT, MOST_DENSE = 1e-6, 1e-3, 8, 250

Problem = tuple[np.ndarray, Metric, Any, np.ndarray]


def robot(name: str, height: float) -> mbvi.Problem:
    """Return a robot above the floor."""
    scene = mbvi.Scene(restitution=0.0)
    scene.add_halfspace((0.0, 0.0, 1.0))
    scene.add_urdf(ROBOTS / name / f"{name}.urdf", position=(0.0, 0.0, height))
    return scene.build()


def stack(count: int, columns: int = 1) -> mbvi.Problem:
    """Return columns of boxes, four contacts between two."""
    scene = mbvi.Scene(restitution=0.0)
    scene.add_halfspace((0.0, 0.0, 1.0))
    for column in range(columns):
        for k in range(count):
            scene.add_box((0.2, 0.2, 0.1), position=(0.3 * column + 0.003 * (k % 2), 0.0, 0.05 + 0.1 * k))
    return scene.build()


def pile(count: int) -> mbvi.Problem:
    """Return spheres that fall into a bin."""
    return spheres(count).problem()


def random_rows(count: int) -> list[Problem]:
    """Return problems of a quadruped's mass matrix and so many random rows, which some velocity meets."""
    problem, rng, made = robot("quadruped", 1.0), np.random.default_rng(count), []
    metric, n = problem.system.metric(problem.q0), len(problem.v0)
    for _ in range(KEPT):
        J = rng.normal(size=(count, n))
        v = rng.normal(size=n)
        made.append((v, metric, J, J @ rng.normal(size=n) - rng.random(count)))
    return made


def kept(problem: mbvi.Problem, scheme: Any, steps: int, step: float = STEP) -> list[Problem]:
    """Return the last projections of a run that violate a row."""
    found: list[Problem] = []
    solve = Projector._solve

    def note(self: Projector, x: Any, metric: Any, J: Any, lower: Any, *others: Any) -> Any:
        if not ScaledQP(x, metric, J, lower, RESIDUAL).satisfied:
            found.append((x.copy(), metric, J.copy(), lower.copy()))
        return solve(self, x, metric, J, lower, *others)

    # without the fused step every projection goes through _solve
    with mock.patch("mbvi.projection.projector.MOST_FUSED", -1), mock.patch.object(Projector, "_solve", note):
        for _ in islice(mbvi.steps(problem, scheme, step=step), steps):
            pass
    return found[-KEPT:]


CASES: dict[str, Callable[[], list[Problem]]] = {
    "hopper landing": lambda: kept(robot("hopper", 0.75), mbvi.Paoli(), 400),
    "biped on its feet": lambda: kept(robot("biped", 1.0), mbvi.Paoli(), 400),
    "quadruped lying": lambda: kept(robot("quadruped", 0.5), mbvi.Paoli(), 800),
    "quadruped, 8 random rows": lambda: random_rows(8),
    "quadruped, 16 random rows": lambda: random_rows(16),
    "quadruped, 32 random rows": lambda: random_rows(32),
    "stack of 5 boxes": lambda: kept(stack(5), mbvi.Paoli(), 60),
    "stack of 10 boxes": lambda: kept(stack(10), mbvi.Paoli(), 60),
    "25 stacks of 4 boxes": lambda: kept(stack(4, 25), mbvi.StewartTrinkle(), 40),
    "pile of 64 spheres": lambda: kept(pile(64), mbvi.StewartTrinkle(), 200, 2e-3),
    "pile of 1000 spheres": lambda: kept(pile(1000), mbvi.StewartTrinkle(), 200, 2e-3),
}


def measure(problem: Problem, solver: ChosenSolver | None, repeats: int) -> tuple[float, float]:
    """Return the fastest time [us] and the residual of one projection."""
    best, residual = np.inf, np.nan
    for _ in range(repeats):
        projector = Projector(RESIDUAL, solver)
        start = time.perf_counter()
        try:
            residual = projector.project(*problem).residual
        except ProjectionError:
            return np.nan, np.nan
        best = min(best, 1e6 * (time.perf_counter() - start))
    return best, residual


def line(name: str, problems: list[Problem], repeats: int) -> str:
    """Return one line of the table."""
    rows = int(np.median([len(lower) for *_, lower in problems]))
    cells = []
    for solver in SOLVERS.values():
        small = rows <= MOST_DENSE or solver in (None, mbvi.SparsePCG())
        if not small:
            cells.append("-")
            continue
        found = np.array([measure(problem, solver, repeats) for problem in problems])
        bad = not np.isfinite(found).all()
        cells.append("-" if bad else f"{np.median(found[:, 0]):.0f} ({found[:, 1].max():.0e})")
    return f"| {name} | {rows} | " + " | ".join(cells) + " |"


def processor() -> str:
    """Return the name of the processor."""
    for text in Path("/proc/cpuinfo").read_text().splitlines() if Path("/proc/cpuinfo").exists() else []:
        if text.startswith("model name"):
            return text.partition(": ")[2]
    return platform.processor()


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="Time the projection solvers.")
    parser.add_argument("--case", default="", metavar="TEXT", help="only the cases whose name has this in it")
    parser.add_argument("--repeats", type=int, default=7, help="runs of each projection")
    arguments = parser.parse_args()
    print(f"{processor()}, one thread, Python {platform.python_version()}: us (residual)\n")
    print("| case | rows | " + " | ".join(SOLVERS) + " |")
    print("|---" * (2 + len(SOLVERS)) + "|")
    for name, make in CASES.items():
        if arguments.case in name:
            problems = make()
            print(line(name, problems, arguments.repeats) if problems else f"| {name} | no projection |", flush=True)


if __name__ == "__main__":
    main()

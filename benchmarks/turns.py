"""Times of mbvi and MuJoCo measured in turns, and the sections of docs/benchmarks/performance.md that hold them."""

from __future__ import annotations

import os
import platform
import time
import warnings
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

import numpy as np
from robot_cases import again

import mbvi

PAGE = Path(__file__).parents[1] / "docs/benchmarks/performance.md"
STEP, DURATION = 1e-3, 1.0
HEADS = "MuJoCo [us per step] | Paoli [us per step] | ratio | default [us per step] | ratio"
# no scheme named is the default at a given step
SCHEMES: dict[str, mbvi.schemes.Scheme | None] = {"Paoli": mbvi.Paoli(), "default": None}


class Times(NamedTuple):
    """Times of one step of MuJoCo and of each scheme [s], and the ratios to MuJoCo."""

    mujoco: float
    schemes: dict[str, float]
    ratios: dict[str, float]


def simulated(
    problem: mbvi.Problem, scheme: mbvi.schemes.Scheme | None, duration: float, step: float | None
) -> mbvi.Trajectory:
    """Return a run without its warnings, which are in its notes."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mbvi.MbviWarning)
        return mbvi.simulate(problem, scheme, step=step, duration=duration, progress=False)


def run_time(problem: mbvi.Problem, scheme: mbvi.schemes.Scheme | None, duration: float, step: float | None) -> float:
    """Return the CPU time of a run of a fresh problem [s]."""
    problem = again(problem)
    start = time.process_time()
    simulated(problem, scheme, duration, step)
    return time.process_time() - start


def times(problem: mbvi.Problem, peer: Callable[[int], float], repeats: int) -> Times:
    """Time MuJoCo and each scheme in turns."""
    count = round(DURATION / STEP)
    # what is compiled or loaded at first use is not timed
    peer(count)
    for scheme in SCHEMES.values():
        run_time(problem, scheme, 0.1, STEP)
    theirs, ours = np.empty(repeats), {name: np.empty((repeats, 2)) for name in SCHEMES}
    for k in range(repeats):
        theirs[k] = peer(count)
        for name, scheme in SCHEMES.items():
            ours[name][k] = [run_time(problem, scheme, duration, STEP) for duration in (STEP, DURATION)]
    # the median of the set-up, whose scatter would hide steps
    steps = {name: (t[:, 1] - np.median(t[:, 0])) / (count - 1) for name, t in ours.items()}
    return Times(
        float(np.median(theirs)),
        {name: float(np.median(t)) for name, t in steps.items()},
        {name: float(np.median(t / theirs)) for name, t in steps.items()},
    )


def timing_cells(found: Times) -> str:
    """Return the cells of one line that compare the engines."""
    ours = " | ".join(f"{1e6 * found.schemes[name]:.0f} | {found.ratios[name]:.1f}" for name in SCHEMES)
    return f"{1e6 * found.mujoco:.0f} | {ours}"


def machine() -> str:
    """Return processor and versions."""
    info, name = Path("/proc/cpuinfo"), platform.machine()
    lines = info.read_text().splitlines() if info.is_file() else []
    name += "".join([", " + line.partition(":")[2].strip() for line in lines if line.startswith("model name")][:1])
    numerics = ", ".join(f"{package} {version(package)}" for package in ("pin", "coal", "numpy", "numba", "mujoco"))
    return f"{name}, {os.cpu_count()} cores, Python {platform.python_version()}, {numerics}"


def table(heads: str, lines: list[str]) -> str:
    """Return a Markdown table."""
    return "\n".join([f"| {heads} |", "|" + "---|" * (heads.count(" | ") + 1), *lines])


def write_section(title: str, text: str) -> None:
    """Replace a section of the page, which begins with its title.

    Raises
    ------
    SystemExit
        If the page has no such section.
    """
    before, found, rest = PAGE.read_text().partition(title + "\n")
    if not found:
        raise SystemExit(f"{PAGE} has no section {title!r}")
    _, heading, after = rest.partition("\n## ")
    PAGE.write_text(before + text + heading + after)

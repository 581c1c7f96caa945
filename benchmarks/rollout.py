"""Time of many short runs of a standing quadruped by `mbvi.rollout`, beside `mujoco.rollout` in the same run.

    python benchmarks/rollout.py            # print the section "Rollouts" of docs/benchmarks/performance.md
    python benchmarks/rollout.py --write    # and write it there

The quadruped of `robot_step.py` that stands on four feet begins each run at its start with other velocities. MuJoCo
gets the same robot, torques and velocities, and as many threads. A time is that of the whole call, states recorded by
both, divided by all steps; it is wall-clock time, since threads are compared. The engines alternate, times are medians
over the repeats, and a ratio is the median of the ratios of calls next to each other. BLAS runs on one thread.
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
from importlib.metadata import version  # noqa: E402
from pathlib import Path  # noqa: E402

import numpy as np  # noqa: E402
from robot_cases import CASES  # noqa: E402

import mbvi  # noqa: E402
from mbvi_studies.engines.robot_in_mujoco import MuJoCoRobot  # noqa: E402

PAGE, TITLE = Path(__file__).parents[1] / "docs/benchmarks/performance.md", "## Rollouts"
STEP, STEPS, SPREAD = 1e-3, 100, 0.05
# no scheme named is the default at a given step
SCHEMES: dict[str, mbvi.schemes.Scheme | None] = {"Paoli": mbvi.Paoli(), "default": None}


def wall(call: Callable[[], object]) -> float:
    """Return the wall-clock time of a call [s]."""
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def lines(count: int, repeats: int, most_threads: int) -> list[str]:
    """Return the lines of the table."""
    problem, torque = CASES["quadruped, four feet standing"]()
    nv = problem.system.nv
    v0 = problem.v0 + SPREAD * np.random.default_rng(0).normal(size=(count, nv))
    q0, peer = np.tile(problem.q0, (count, 1)), MuJoCoRobot(problem, torque, STEP)
    found = []
    for threads in range(1, most_threads + 1):
        other = peer.rollouts(v0, STEPS, threads)
        for name, scheme in SCHEMES.items():

            def mine(scheme: mbvi.schemes.Scheme | None = scheme, threads: int = threads) -> None:
                done = mbvi.rollout(problem, q0, v0, steps=STEPS, step=STEP, scheme=scheme, threads=threads)
                if done.status.any():
                    raise RuntimeError(f"{np.count_nonzero(done.status)} rollouts failed")

            mine()
            other()
            both = np.array([(wall(mine), wall(other)) for _ in range(repeats)])
            ours, theirs = 1e6 * np.median(both, axis=0) / (count * STEPS)
            ratio = float(np.median(both[:, 0] / both[:, 1]))
            found.append(f"| {name} | {threads} | {ours:.1f} | {theirs:.1f} | {ratio:.2f} |")
    return found


def section(count: int, repeats: int, threads: int) -> str:
    """Return the section of the page."""
    packages = ", ".join(f"{name} {version(name)}" for name in ("pin", "numpy", "numba", "mujoco"))
    machine = f"{os.cpu_count()} cores, {platform.machine()}, Python {platform.python_version()}"
    table = "\n".join(lines(count, repeats, threads))
    return f"""{TITLE}

    python benchmarks/rollout.py --write    # measures, and writes this section

{count} runs of {STEPS} steps of the quadruped that stands on four feet, with other initial velocities each, by
`mbvi.rollout` and by `mujoco.rollout`. Wall-clock time of the call over all steps, medians of {repeats} repeats, the
engines in turns; {machine}, {packages}.
MuJoCo has no friction, as in the first table.

| scheme | threads | mbvi [us per step] | MuJoCo [us per step] | ratio |
|---|---|---|---|---|
{table}
"""


def main() -> None:
    """Print the section and, with --write, put it into the page."""
    parser = argparse.ArgumentParser(description="Time rollouts of a robot beside MuJoCo.")
    parser.add_argument("--count", type=int, default=500, help="runs in one call")
    parser.add_argument("--repeats", type=int, default=11, help="calls of each engine")
    parser.add_argument("--threads", type=int, default=2, help="most threads")
    parser.add_argument("--write", action="store_true", help=f"replace the section in docs/benchmarks/{PAGE.name}")
    arguments = parser.parse_args()
    text = section(arguments.count, arguments.repeats, arguments.threads)
    print(text)
    if arguments.write:
        page = PAGE.read_text()
        before, there, after = page.partition(f"{TITLE}\n")
        _, mark, rest = after.partition("\n## ")
        PAGE.write_text(f"{before}{text}{mark}{rest}" if there else f"{page.rstrip()}\n\n{text}")


if __name__ == "__main__":
    main()

"""Time and depth of one step of a published robot on height fields, beside MuJoCo on the same heights.

    python benchmarks/terrain.py             # print "Robots on terrain" of docs/benchmarks/performance.md
    python benchmarks/terrain.py --write     # and write it there

The robot falls onto random stones, or onto stairs that it slides and tumbles down, e = 0, with friction. MuJoCo gets
the same mechanism, hulls, pairs, limits, start, heights and friction, its Euler integrator, its default solver. Times
are CPU times without the build and without the first step, the engines in turns, medians over the repeats.
"""

from __future__ import annotations

import os

# read once, when numpy is imported
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

import argparse  # noqa: E402
import time  # noqa: E402

import numpy as np  # noqa: E402
from turns import SCHEMES, STEP, simulated, table, write_section  # noqa: E402

import mbvi  # noqa: E402
from mbvi_studies.engines.robot_in_mujoco import MuJoCoRobot  # noqa: E402
from mbvi_studies.published_robots import PUBLISHED, robot_file  # noqa: E402

TITLE = "## Robots on terrain"
# heights of stones up to 4 cm on a square of 4 m
STONES, SIDE, FRICTION, DURATION = 0.04, 4.0, 0.6, 0.8
# stairs of such a rise [m], of so many columns of the field each
RISE, GOING = 0.12, 4
# where robots start above the ground [m]
CASES = {"go2": 0.45, "go2 on stairs": 0.45, "anymal": 0.75, "solo12": 0.40}

TEXT = f"""

    python benchmarks/terrain.py --write    # measures, and writes this section

Robots fall onto a height field of 64 x 64 random stones, up to {100 * STONES:.0f} cm high, on {SIDE:.0f} m x {SIDE:.0f} m, or onto stairs of a rise of
{100 * RISE:.0f} cm: mu = {FRICTION}, e = 0, h = 1 ms, {DURATION} s. MuJoCo has the same heights. Medians of {{repeats}} repeats in turns. The light legs of Solo12 swing at up to 16 m/s.

"""  # noqa: E501


def on_ground(case: str, points: int = 64) -> mbvi.Problem:
    """Return a robot above points x points stones, or above stairs that lead down along x."""
    scene, (name, _, ground) = mbvi.Scene(friction=FRICTION), case.partition(" on ")
    heights = STONES * np.random.default_rng(0).random((points, points))
    if ground == "stairs":
        heights = np.tile(RISE * ((points // 2 - np.arange(points)) // GOING), (points, 1))
    scene.add_heightfield(heights, size=(SIDE, SIDE), name="ground")
    scene.add_urdf(robot_file(name), "free", (0.03, 0.02, CASES[case]), name=name, mimic=False)
    return scene.build()


def line(case: str, repeats: int) -> str:
    """Return the line of one robot: time and depth of MuJoCo and of each scheme."""
    problem, count = on_ground(case), round(DURATION / STEP)
    peer = MuJoCoRobot(problem, np.zeros(problem.system.nv), STEP)
    theirs, ours, depth = np.empty(repeats), {s: np.empty((repeats, 2)) for s in SCHEMES}, {}
    for k in range(-1, repeats):
        # the first turn compiles and loads
        if k >= 0:
            theirs[k] = peer.time(count)
        for scheme, chosen in SCHEMES.items():
            for j, duration in enumerate((STEP, DURATION)):
                fresh = problem.at(problem.q0, problem.v0)
                start = time.process_time()
                run = simulated(fresh, chosen, duration, STEP)
                if k >= 0:
                    ours[scheme][k, j] = time.process_time() - start
            depth[scheme] = run.penetration().max()
    cells = [f"{1e6 * np.median(theirs):.0f} | {peer.deepest(count):.1e}"]
    for scheme, spent in ours.items():
        step = (spent[:, 1] - np.median(spent[:, 0])) / (count - 1)
        cells.append(f"{1e6 * np.median(step):.0f} | {np.median(step / theirs):.1f} | {depth[scheme]:.1e}")
    name, *ground = case.split()
    return f"| {' '.join([PUBLISHED[name].title, *ground])} | {' | '.join(cells)} |"


def main() -> None:
    """Measure and print; write with --write."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--write", action="store_true", help="write the section of the page")
    parser.add_argument("--case", action="append", choices=list(CASES), help="only these cases")
    parser.add_argument("--repeats", type=int, default=3)
    given = parser.parse_args()
    heads = "robot | MuJoCo [us per step] | depth [m]"
    for scheme in SCHEMES:
        heads += f" | {scheme} [us per step] | ratio | depth [m]"
    found = table(heads, [line(case, given.repeats) for case in given.case or CASES])
    print(found)
    if given.write:
        write_section(TITLE, TITLE + TEXT.format(repeats=given.repeats) + found + "\n")


if __name__ == "__main__":
    main()

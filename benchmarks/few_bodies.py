"""CPU time of a step of a few boxes and balls with friction, beside MuJoCo.

python benchmarks/few_bodies.py             # print "A few bodies" of docs/benchmarks/performance.md
python benchmarks/few_bodies.py --write     # and write it there
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from time import process_time

import mujoco
import numpy as np
from turns import HEADS, STEP, table, times, timing_cells, write_section

import mbvi

TITLE, MU, EDGE = "## A few bodies", 0.5, 0.2
TEXT = f"""

    python benchmarks/few_bodies.py --write    # measures, and writes this section

Boxes with edges of {EDGE} m and balls of the same width, 1 kg each, on a floor with mu = {MU}, e = 0, h = 1 ms, 1 s. `simulate` includes the recording of all
states; MuJoCo takes its steps in one call, with elliptic cones and its default solver. CPU times of steps, medians of {{repeats}} runs in turns;
the set-up of a run, 2 to 4 ms, is left out.

{{found}}

Runs of up to ten free bodies take these compiled steps, with friction up to twelve boxes, and up to some thirty bodies where few points can touch,
as of balls ([architecture](../developer/architecture.md#the-compiled-loop)). Where all bodies rest, they sleep. What costs time in heaps that
move is Coulomb's law: where boxes stand on boxes its rows depend on each other, and it is solved to a residual of 1e-9 at least.
"""  # noqa: E501
Body = tuple[str, tuple[float, float, float], tuple[float, ...]]

TURNING = (1.0, 0.0, 0.0, 1.0, 2.0, 3.0)
CASES: dict[str, list[Body]] = {
    "a box that slides": [("box", (0.0, 0.0, 0.1), (3.0, 0, 0, 0, 0, 0))],
    "a box that tumbles": [("box", (0.0, 0.0, 0.4), TURNING)],
    "a ball that rolls": [("ball", (0.0, 0.0, 0.1), (3.0, 0, 0, 0, 0, 0))],
    "three balls that roll": [("ball", (0.5 * k, 0.0, 0.1), (3.0, 0, 0, 0, 0, 0)) for k in range(3)],
    "three boxes that tumble": [("box", (0.3 * k, 0.0, 0.4), TURNING) for k in range(3)],
    "a tower of three boxes": [("box", (0.01 * (k % 2), 0.0, 0.1 + EDGE * k), (0.0,) * 6) for k in range(3)],
    "six boxes that fall onto each other": [
        ("box", (0.22 * (k % 2), 0.02 * k, 0.15 + 0.22 * (k // 2)), TURNING) for k in range(6)
    ],
    "twelve boxes that fall onto each other": [
        ("box", (0.22 * (k % 3), 0.22 * (k // 3 % 3) + 0.013 * (k // 9), 0.15 + 0.22 * (k // 9)), TURNING)
        for k in range(12)
    ],
    "six boxes at rest": [("box", (0.4 * k, 0.0, 0.1), (0.0,) * 6) for k in range(6)],
    "sixteen balls that fall and roll": [
        ("ball", (0.25 * (k % 4) + 0.02 * (k // 4), 0.01 * k, 0.15 + 0.22 * (k // 4)), (0.5, 0, 0, 0, 0, 0))
        for k in range(16)
    ],
}


def problem_of(bodies: list[Body]) -> mbvi.Problem:
    """Return bodies of 1 kg above a floor."""
    scene = mbvi.Scene(friction=MU)
    scene.add_halfspace((0, 0, 1), name="floor")
    for kind, position, velocity in bodies:
        if kind == "box":
            spin = velocity[3:]
            scene.add_box((EDGE,) * 3, position=position, velocity=velocity[:3], angular_velocity=spin)
        else:
            scene.add_sphere(0.5 * EDGE, position=position, velocity=velocity[:3])
    return scene.build()


def model_of(bodies: list[Body]) -> mujoco.MjModel:
    """Return the same for MuJoCo, with elliptic cones."""
    half, shapes = 0.5 * EDGE, {"box": "box", "ball": "sphere"}
    floor = f'<geom type="plane" size="0 0 1" friction="{MU}" condim="3"/>'
    links = "".join(
        f'<body pos="{x} {y} {z}"><freejoint/>'
        f'<geom type="{shapes[kind]}" size="{half} {half} {half}" mass="1" friction="{MU}" condim="3"/></body>'
        for kind, (x, y, z), _ in bodies
    )
    option = f'<option timestep="{STEP}" cone="elliptic"/>'
    return mujoco.MjModel.from_xml_string(f"<mujoco>{option}<worldbody>{floor}{links}</worldbody></mujoco>")


def by_mujoco(bodies: list[Body]) -> Callable[[int], float]:
    """Return what takes some steps by MuJoCo, and returns the CPU time of one [s]."""
    model = model_of(bodies)
    data = mujoco.MjData(model)

    def run(count: int) -> float:
        mujoco.mj_resetData(model, data)
        data.qvel[:] = np.concatenate([velocity for _, _, velocity in bodies])
        begin = process_time()
        mujoco.mj_step(model, data, nstep=count)
        return (process_time() - begin) / count

    return run


def line(case: str, repeats: int) -> str:
    """Return the line of one case."""
    bodies = CASES[case]
    return f"| {case} | {timing_cells(times(problem_of(bodies), by_mujoco(bodies), repeats))} |"


def main() -> None:
    """Measure and print; write with --write."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--write", action="store_true", help="write the section of the page")
    parser.add_argument("--repeats", type=int, default=7)
    given = parser.parse_args()
    found = table(f"case | {HEADS}", [line(case, given.repeats) for case in CASES])
    print(found)
    if given.write:
        write_section(TITLE, TITLE + TEXT.format(repeats=given.repeats, found=found))


if __name__ == "__main__":
    main()

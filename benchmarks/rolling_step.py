"""CPU time of a step of a standing quadruped with torsional and rolling friction: in Python and in the compiled loop.

python benchmarks/rolling_step.py
"""

from __future__ import annotations

from time import process_time

import numpy as np

import mbvi

LEGS = ("FL", "FR", "RL", "RR")
STANCE = np.tile([0.0, 0.6, -1.2], 4)
STEP, STEPS, REPEATS = 1e-3, 300, 7


def swaying(friction: float | tuple[float, float, float]) -> mbvi.Problem:
    """Return a quadruped that stands on four feet by a PD control and is pushed."""
    scene = mbvi.Scene(friction=friction)
    scene.add_halfspace((0, 0, 1), name="floor")
    names = [f"{leg}_{joint}_joint" for leg in LEGS for joint in ("hip", "thigh", "calf")]
    scene.add_urdf(
        "robot:quadruped",
        position=(0, 0, 0.354),
        base_velocity=(-0.3, -0.1, 0.0, -0.5, 0.0, 0.0),
        joints=dict(zip(names, STANCE.tolist(), strict=True)),
        control=mbvi.PDControl(STANCE, 60.0, 1.5),
    )
    return scene.build()


def in_python(problem: mbvi.Problem, scheme: mbvi.SchemeBase) -> float:
    """Return the CPU time of a step by the scheme's own method [us]."""
    begin = process_time()
    for _ in zip(range(STEPS), mbvi.steps(problem, scheme, step=STEP), strict=False):
        pass
    return 1e6 * (process_time() - begin) / STEPS


def in_the_loop(problem: mbvi.Problem, scheme: mbvi.SchemeBase) -> float:
    """Return the CPU time of a step of `simulate` [us]."""
    begin = process_time()
    mbvi.simulate(problem, scheme, step=STEP, duration=STEPS * STEP, progress=False)
    return 1e6 * (process_time() - begin) / STEPS


def main() -> None:
    """Print the table."""
    print("| friction | scheme | Python [us per step] | loop [us per step] | ratio |")
    print("|---|---|---|---|---|")
    for friction in (0.7, (0.7, 0.01, 0.002)):
        problem = swaying(friction)
        for scheme in (mbvi.Paoli(), mbvi.Centered(project_positions=True)):
            in_the_loop(problem, scheme)
            pairs = np.array([(in_python(problem, scheme), in_the_loop(problem, scheme)) for _ in range(REPEATS)])
            slow, fast = np.median(pairs, axis=0)
            ratio = np.median(pairs[:, 0] / pairs[:, 1])
            print(f"| {friction} | {scheme} | {slow:.0f} | {fast:.0f} | {ratio:.0f} |")


if __name__ == "__main__":
    main()

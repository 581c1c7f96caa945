"""CPU time of a step of a few boxes and balls with friction, beside MuJoCo: python benchmarks/few_bodies.py."""

from __future__ import annotations

from collections.abc import Callable
from time import process_time

import mujoco
import numpy as np

import mbvi

STEP, STEPS, REPEATS, MU = 1e-3, 1000, 7, 0.5
EDGE = 0.2
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


def by_mujoco(model: mujoco.MjModel, bodies: list[Body]) -> Callable[[], object]:
    """Return a run by MuJoCo."""
    data = mujoco.MjData(model)

    def run() -> None:
        mujoco.mj_resetData(model, data)
        data.qvel[:] = np.concatenate([velocity for _, _, velocity in bodies])
        mujoco.mj_step(model, data, nstep=STEPS)

    return run


def by_mbvi(problem: mbvi.Problem, scheme: mbvi.Scheme | None) -> Callable[[], object]:
    """Return a run by `simulate`."""
    return lambda: mbvi.simulate(problem, scheme, step=STEP, duration=STEPS * STEP, progress=False)


def seconds(run: Callable[[], object]) -> float:
    """Return the CPU time of a run [s]."""
    begin = process_time()
    run()
    return process_time() - begin


def main() -> None:
    """Print the table."""
    print("| case | MuJoCo [us per step] | Paoli [us per step] | ratio | default [us per step] | ratio |")
    print("|---|---|---|---|---|---|")
    for case, bodies in CASES.items():
        problem = problem_of(bodies)
        runs = [by_mujoco(model_of(bodies), bodies), by_mbvi(problem, mbvi.Paoli()), by_mbvi(problem, None)]
        for run in runs:
            run()
        times = np.array([[seconds(run) for run in runs] for _ in range(REPEATS)])
        theirs, paoli, default = 1e6 * np.median(times, axis=0) / STEPS
        ratios = np.median(times[:, 1:] / times[:, :1], axis=0)
        print(f"| {case} | {theirs:.1f} | {paoli:.1f} | {ratios[0]:.2f} | {default:.1f} | {ratios[1]:.2f} |")


if __name__ == "__main__":
    main()

"""Cost of a step of boxes on walls that move, beside that on the same walls at rest.

Five boxes land in a container and stay on its floor, without and with friction, at h = 1e-3 s. The container stands,
slides, or shakes. The motion is one of `mbvi.motion`, which the compiled loop knows, or the same as an object of a
class of this file, whose steps are Python's. Times are CPU times of `mbvi.simulate` without those of the first ten
steps, per step, medians over the repeats, in turns.

    python benchmarks/moving_walls.py
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

import mbvi

STEP, STEPS, REPEATS = 1e-3, 500, 5
SCHEMES: dict[str, mbvi.Scheme] = {
    "`Paoli()`": mbvi.Paoli(),
    "`StewartTrinkle()`": mbvi.StewartTrinkle(),
    "default": mbvi.Centered(project_positions=True),
}
SLIDES = mbvi.motion.Translation((0.3, 0.1, 0.0))
SHAKES = mbvi.motion.Oscillation((0.001, 0.002, 0.004), frequency=8.0)


class Given:
    """A motion of a user's own class."""

    def __init__(self, motion: Any) -> None:
        self.pose, self.twist = motion.pose, motion.twist


CASES = {"at rest": None, "slides": SLIDES, "shakes": SHAKES, "slides, own class": Given(SLIDES)}
CASES["shakes, own class"] = Given(SHAKES)


def boxes(motion: Any, friction: float) -> mbvi.Problem:
    """Return five boxes above the floor of a container."""
    scene = mbvi.Scene(friction=friction)
    scene.add_container((-0.5, -0.4, 0.0), (0.5, 0.4), motion=motion)
    for k in range(5):
        scene.add_box((0.1, 0.08, 0.06), 0.2 + 0.1 * k, position=(-0.3 + 0.15 * k, 0.02 * k, 0.06 + 0.01 * k))
    return scene.build()


def seconds(problem: mbvi.Problem, scheme: mbvi.Scheme, steps: int) -> float:
    """Return the CPU time of a run of so many steps [s]."""
    begin = time.process_time()
    mbvi.simulate(problem, scheme, step=STEP, duration=steps * STEP, progress=False)
    return time.process_time() - begin


def main() -> None:
    """Print the table."""
    print("| friction | scheme | " + " | ".join(f"{name} [us]" for name in CASES) + " |")
    print("|---" * (2 + len(CASES)) + "|")
    for friction in (0.0, 0.5):
        problems = {name: boxes(motion, friction) for name, motion in CASES.items()}
        for label, scheme in SCHEMES.items():
            for problem in problems.values():
                seconds(problem, scheme, 10)
            times = np.array(
                [
                    [seconds(problem, scheme, STEPS) - seconds(problem, scheme, 10) for problem in problems.values()]
                    for _ in range(REPEATS)
                ]
            )
            per_step = 1e6 * np.median(times, axis=0) / (STEPS - 10)
            print(f"| {friction:g} | {label} | " + " | ".join(f"{one:.0f}" for one in per_step) + " |", flush=True)


if __name__ == "__main__":
    main()

"""Schemes of fixed steps on published robots: error against CPU time, and the step that is chosen without one.

Prints two Markdown tables. Robots of example-robot-data fall from 2 cm onto a floor at e = 0. The first table has the
largest error of q at any of the times 0.01, 0.02, ... s against `MoreauJean` at h = 2e-5 s, CPU time per step, and the
deepest penetration. The second has the step of the default scheme, its reason, and CPU time per simulated second.

    python benchmarks/robot_schemes.py [robot ...]
"""

from __future__ import annotations

import sys
import sysconfig
import warnings
from pathlib import Path
from time import process_time

import numpy as np

import mbvi
from mbvi.run.default_scheme import time_step, time_stepping

ROBOTS = Path(sysconfig.get_path("purelib")) / "cmeel.prefix/share/example-robot-data/robots"
# URDF, and whether the base is free
FILES = {
    "go2": ("go2_description/urdf/go2.urdf", True),
    "g1": ("g1_description/urdf/g1_29dof_rev_1_0.urdf", True),
    "talos": ("talos_data/robots/talos_reduced.urdf", True),
    "panda": ("panda_description/urdf/panda.urdf", False),
    "solo12": ("solo_description/robots/solo12.urdf", True),
    "anymal": ("anymal_b_simple_description/robots/anymal.urdf", True),
}
SCHEMES = (
    mbvi.Paoli(),
    mbvi.MoreauJean(),
    mbvi.MoreauJean(project_positions=True),
    mbvi.Centered(),
    mbvi.Centered(project_positions=True),
    mbvi.StewartTrinkle(),
)
DURATION, FINE, STEPS = 0.12, 2e-5, (1e-3, 2.5e-4)


def robot(name: str) -> mbvi.Problem:
    """Return a published robot 2 cm above a floor, or with its base fixed to it."""
    file, free = FILES[name]

    def scene(height: float) -> mbvi.Problem:
        scene = mbvi.Scene(restitution=0.0)
        scene.add_halfspace((0, 0, 1))
        scene.add_urdf(ROBOTS / file, name=name, **({"position": (0, 0, height)} if free else {"base": "fixed"}))
        return scene.build()

    if not free:
        return scene(0.0)
    high = scene(5.0)
    lowest = min(f.gap(0.0, high.q0).min() for f in high.constraints.families if "HalfSpace" in type(f).__name__)
    return scene(5.0 - float(lowest) + 0.02)


def timed(problem: mbvi.Problem, scheme: object, h: float, duration: float) -> tuple[float, mbvi.Trajectory]:
    """Return CPU time per step [us] and the run."""
    begin = process_time()
    run = mbvi.simulate(problem, scheme, step=h, duration=duration, progress=False)
    return 1e6 * (process_time() - begin) / (len(run.t) - 1), run


def error(problem: mbvi.Problem, run: mbvi.Trajectory, reference: mbvi.Trajectory) -> float:
    """Return the largest difference of q at multiples of 0.01 s [m, rad]."""
    largest = 0.0
    for t in np.arange(0.01, DURATION + 1e-9, 0.01):
        a, b = (one.q[np.searchsorted(one.t, t - 1e-9)] for one in (run, reference))
        largest = max(largest, float(np.abs(problem.system.difference(a, b)).max()))
    return largest


def main() -> None:
    """Print both tables."""
    warnings.simplefilter("ignore")
    names = sys.argv[1:] or list(FILES)
    chosen = []
    print("| robot | h [s] | scheme | us per step | error of q | deepest penetration |")
    print("|---|---|---|---|---|---|")
    for name in names:
        problem = robot(name)
        _, reference = timed(problem, mbvi.MoreauJean(), FINE, DURATION)
        for h in STEPS:
            for scheme in SCHEMES:
                timed(problem, scheme, h, 10 * h)
                time, run = timed(problem, scheme, h, DURATION)
                depth = run.penetration().max()
                cells = f"{scheme!r} | {time:.0f} | {error(problem, run, reference):.1e} | {depth:.1e}"
                print(f"| {name} | {h:g} | {cells} |", flush=True)
        h, scale = time_step(problem, 1.0)
        scheme, words = time_stepping(problem)
        time, run = timed(problem, scheme, h, 0.2)
        chosen.append(f"| {name} | {words} | {h:g} | {scale} | {1e-6 * time / h:.2f} |")
    print("\n| robot | scheme | h [s] | what bounds the step | CPU [s] per simulated second |")
    print("|---|---|---|---|---|")
    print("\n".join(chosen))


if __name__ == "__main__":
    main()

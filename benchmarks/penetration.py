"""Penetration and CPU time per step of each fixed-step scheme, as a Markdown table.

A hopper dropped on a floor and three boxes on each other, at h = 1e-3 s; sliding inside a disc at h = 1e-2 s, where the
penetration of the steps adds up.
"""

from __future__ import annotations

from pathlib import Path
from time import process_time

import numpy as np

import mbvi
from mbvi import reference
from mbvi.compiled import compile_all

HOPPER = Path(__file__).parents[1] / "robots/hopper/hopper.urdf"
REPEATS = 3
SCHEMES: tuple[mbvi.schemes.Scheme, ...] = (
    mbvi.Paoli(),
    mbvi.Paoli(project_positions=True),
    mbvi.MoreauJean(),
    mbvi.MoreauJean(project_positions=True),
    mbvi.Centered(),
    mbvi.Centered(project_positions=True),
    mbvi.SchatzmanPaoli(),
)


def hopper() -> mbvi.Problem:
    """Return a robot that falls, bounces and comes to rest."""
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1))
    scene.add_urdf(HOPPER, position=(0, 0, 1), joints={"knee": 0.4})
    return scene.build()


def tower() -> mbvi.Problem:
    """Return three boxes that fall on each other and rest."""
    scene = mbvi.Scene(restitution=0.2)
    scene.add_halfspace((0, 0, 1))
    for k in range(3):
        scene.add_box((0.3, 0.3, 0.2), position=(0.01 * k, 0, 0.15 + 0.3 * k))
    return scene.build()


def measured(problem: mbvi.Problem, scheme: mbvi.schemes.Scheme, step: float, duration: float) -> str:
    """Return the largest and the final penetration [mm] and the CPU time of a step [us]."""
    times = []
    for _ in range(REPEATS):
        begin = process_time()
        run = mbvi.simulate(problem, scheme, step=step, duration=duration)
        times.append(1e6 * (process_time() - begin) * step / duration)
    depth = 1e3 * np.maximum(run.penetration(), run.limit_violation())
    return f"{depth.max():.2g} | {depth[-1]:.2g} | {np.median(times):.0f}"


def main() -> None:
    """Print the table."""
    compile_all()
    print(
        "| problem | scheme | deepest penetration [mm, mrad] | penetration at the end [mm, mrad] | time per step [us] |"
    )
    print("|---|---|---|---|---|")
    disc = reference.sliding_in_disc(0.5, duration=50.0).problem
    cases = (("hopper", hopper(), 1e-3, 2.0), ("three boxes", tower(), 1e-3, 2.0), ("disc", disc, 1e-2, 50.0))
    for name, problem, step, duration in cases:
        for scheme in SCHEMES:
            lifts = ", positions projected" if getattr(scheme, "project_positions", False) else ""
            cells = measured(problem, scheme, step, duration)
            print(f"| {name} | {type(scheme).__name__}{lifts} | {cells} |", flush=True)


if __name__ == "__main__":
    main()

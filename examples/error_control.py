"""The error of `Paoli` at h = 1e-3 s on a dropped robot, measured against `EventDriven` at a tolerance of 1e-8.

Writes out/error_control.png; needs matplotlib (the extra `charts`).
"""

from pathlib import Path

import numpy as np

import mbvi

DURATION = 0.35


def dropped_quadruped() -> mbvi.Problem:
    """Return a quadruped in the air above a floor."""
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace(normal=(0, 0, 1), name="floor")
    scene.add_urdf(mbvi.robot("quadruped"), position=(0, 0, 0.6))
    return scene.build()


def draw(exact: mbvi.Trajectory, paoli: mbvi.Trajectory, apart: list[float], path: Path) -> None:
    """Draw the kinetic energy of both runs, and the difference of their configurations."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 3.8), layout="constrained")
    left, right = figure.subplots(1, 2)
    fine = np.union1d(np.linspace(0, DURATION, 1001), exact.t)
    for run, style, name in ((exact, "C0-", "EventDriven(1e-8)"), (paoli, "C3--", "Paoli, h = 1e-3 s")):
        states = [run.at(t) for t in fine.tolist()]
        left.plot(fine, [run.problem.system.kinetic_energy(q, v) for q, v in states], style, label=name)
    left.set(xlabel="time [s]", ylabel="kinetic energy [J]", title="impacts of a dropped quadruped")
    left.legend(loc="upper left", fontsize="small")
    right.semilogy(paoli.t[1:], apart[1:], "C3-")
    for impact in exact.impacts:
        right.axvline(impact.time, color="0.8", zorder=0)
    right.set(xlabel="time [s]", ylabel="largest difference of q [m, rad]", title="error of Paoli at h = 1e-3 s")
    path.parent.mkdir(exist_ok=True)
    figure.savefig(path, dpi=130)


def main() -> float:
    """Return the time of the first impact [s]."""
    problem = dropped_quadruped()
    exact = mbvi.simulate(problem, mbvi.EventDriven(tolerance=1e-8), duration=DURATION)
    paoli = mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=DURATION)
    difference = problem.system.difference
    apart = [float(np.abs(difference(exact.at(t)[0], q)).max()) for t, q in zip(paoli.t.tolist(), paoli.q, strict=True)]
    print(exact.impact_table())
    print(f"error of Paoli at h = 1e-3 s: at most {max(apart):.2g}, at the end {apart[-1]:.2g}")
    draw(exact, paoli, apart, Path("out/error_control.png"))
    return exact.impacts[0].time


if __name__ == "__main__":
    print(f"first impact at {main():.9f} s, drawn in out/error_control.png")

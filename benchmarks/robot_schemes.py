"""Schemes of fixed steps on published robots: error against CPU time, and the step that is chosen without one.

Prints two Markdown tables, or a third one with `--steps`. Robots of example-robot-data fall from 2 cm onto a floor at
e = 0. The first table has the largest error of q at any of the times 0.01, 0.02, ... s against `MoreauJean` at
h = 2e-5 s, CPU time per step, and the deepest penetration. The second has the step of the default scheme, its reason,
and CPU time per simulated second.

The third has the errors of the default scheme over steps, for the fall and for robots that a PD control of their joints
holds in a stance from the fall on; the Panda is held while it moves at 0.5 rad/s. Gains are those of stances, no more
than a step of 1e-3 or 2e-4 s follows without overshoot, and 4 times the latter. Errors are against `EventDriven(1e-8)`
with exact hulls where it runs, else against the default scheme at h = 1e-5 s. A step at which the mode is unstable is
left out. Where the energy with that of the springs rises, the feet leave the floor in some steps and strike in others.

    python benchmarks/robot_schemes.py [--steps] [robot ...]
"""

from __future__ import annotations

import sys
import sysconfig
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from time import process_time
from typing import NamedTuple

import numpy as np
from standing_robots import STANCES, standing

import mbvi
from mbvi.run.default_scheme import force_slope, time_step, time_stepping

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
# of the table of steps: the steps, the duration under a control, the step of references, and the poses
ALL_STEPS, HELD, FINEST, POSES = (2e-3, 1e-3, 5e-4, 2e-4, 1e-4, 5e-5), 0.2, 1e-5, 12
# robots that `EventDriven` can follow
LOCATED = ("panda", "solo12", "anymal")
# an arm's joints [rad], most stiffness [N m/rad] and damping [N m s/rad] and first speed [rad/s]
ARM, ARM_GAINS, ARM_SPEED = {"panda_joint4": -1.5, "panda_joint6": 1.5}, (600.0, 30.0), 0.5


class PD(NamedTuple):
    """A control of joints, the last ones of a robot."""

    angle: np.ndarray
    torque: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray

    def __call__(self, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the torques, shape (nv,)."""
        n, out = len(self.angle), np.zeros(len(v))
        out[-n:] = self.torque - self.stiffness * (q[-n:] - self.angle) - self.damping * v[-n:]
        return out

    def energy(self, q: np.ndarray) -> np.ndarray:
        """Return the energies of springs and torques at configurations, shape (k,)."""
        x = q[:, -len(self.angle) :] - self.angle
        return 0.5 * x**2 @ self.stiffness - x @ self.torque


def robot(
    name: str, joints: Mapping[str, float] | None = None, control: PD | None = None, tolerance: float | None = None
) -> mbvi.Problem:
    """Return a published robot 2 cm above a floor, or with its base fixed to it."""
    file, free = FILES[name]

    def scene(height: float) -> mbvi.Problem:
        scene = mbvi.Scene(restitution=0.0)
        scene.add_halfspace((0, 0, 1))
        place = {"position": (0, 0, height)} if free else {"base": "fixed"}
        more = {"tolerance": tolerance, "mimic": False, **place}
        scene.add_urdf(ROBOTS / file, name=name, joints=joints, control=control, **more)
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
    times = np.arange(0.01, reference.t[-1] + 1e-9, 0.01)
    states = ([one.at(t)[0] for t in times] for one in (run, reference))
    return max(float(np.abs(problem.system.difference(a, b)).max()) for a, b in zip(*states, strict=True))


def motions(name: str) -> dict[str, Callable[[], tuple[mbvi.Problem, PD | None]]]:
    """Return the motions of the table of steps: a problem and its control each."""
    tolerance = 0.0 if name in LOCATED else None

    def held(step: float, factor: float) -> tuple[mbvi.Problem, PD]:
        joints, start = (STANCES[name][0], 0.0) if name in STANCES else (ARM, ARM_SPEED)
        if name in STANCES:
            gains = PD(*standing(name, step)[1])
        else:
            free = robot(name, joints, tolerance=tolerance)
            inertia = 1.0 / np.diag(np.linalg.inv(free.system.metric(free.q0).dense()))
            stiffness = np.minimum(ARM_GAINS[0], 0.1 * inertia / step**2)
            damping = np.minimum(ARM_GAINS[1], 0.3 * inertia / step)
            weight = free.system.force(0.0, free.q0, np.zeros(len(inertia)))
            gains = PD(free.q0, -weight, stiffness, damping)
        control = gains._replace(stiffness=factor * gains.stiffness, damping=factor * gains.damping)
        problem = robot(name, joints, control, tolerance)
        v0 = np.zeros(problem.system.nv)
        # the fingers are at their limits
        v0[: -2 if start else None] = start
        return problem.at(problem.q0, v0), control

    return {
        "falls": lambda: (robot(name, tolerance=tolerance), None),
        "held, gains for 1e-3 s": lambda: held(1e-3, 1.0),
        "held, gains for 2e-4 s": lambda: held(2e-4, 1.0),
        "held, 4 times these": lambda: held(2e-4, 4.0),
    }


def fastest_rate(problem: mbvi.Problem, q: np.ndarray) -> float:
    """Return the rate of the fastest mode at a configuration [1/s]."""
    n = problem.system.nv
    slope = force_slope(problem.system, problem.t0, q, problem.v0, problem.length)
    return float(np.abs(np.linalg.eigvals(np.block([[np.zeros((n, n)), np.eye(n)], [slope]]))).max())


def fastest_elsewhere(problem: mbvi.Problem, free: bool) -> float:
    """Return the largest rate in poses whose joints are up to 1 rad away [1/s]."""
    system, largest, rng = problem.system, 0.0, np.random.default_rng(0)
    for _ in range(POSES):
        shift = rng.uniform(-1.0, 1.0, system.nv)
        shift[: 6 if free else 0] = 0.0
        largest = max(largest, fastest_rate(problem, system.integrate(problem.q0, shift)))
    return largest


def row_of_steps(name: str, motion: str) -> str:
    """Return a row of the table of steps."""
    problem, control = motions(name)[motion]()
    duration = HELD if control else DURATION
    scheme, _ = time_stepping(problem)
    h, _ = time_step(problem, 1.0)
    rate = fastest_rate(problem, problem.q0)
    elsewhere = fastest_elsewhere(problem, FILES[name][1]) if control else rate
    best, fine = (mbvi.EventDriven(1e-8), None) if name in LOCATED else (scheme, min(FINEST, 0.1 / max(rate, 1.0)))
    reference = mbvi.simulate(problem, best, step=fine, duration=duration, progress=False)

    def run(step: float) -> mbvi.Trajectory:
        return mbvi.simulate(problem, scheme, step=step, duration=duration, progress=False)

    cells = ["-" if s * rate >= 2.0 else f"{error(problem, run(s), reference):.1e}" for s in ALL_STEPS]
    chosen = run(h)
    energy = chosen.energy() + (control.energy(chosen.q) if control else 0.0)
    raised = np.maximum(np.diff(energy), 0.0).sum() / np.ptp(energy)
    numbers = (
        error(problem, chosen, reference),
        np.maximum(chosen.penetration(), chosen.limit_violation()).max(),
        raised,
    )
    cells += [f"{h:g}", *(f"{x:.0e}" for x in numbers)]
    return f"| {name} | {motion} | {rate:.0f} | {elsewhere:.0f} | {' | '.join(cells)} |"


def table_of_steps(names: list[str]) -> None:
    """Print the errors of the default scheme over steps."""
    print(f"| robot | motion | fastest mode [1/s] | elsewhere | {' | '.join(f'{h:g}' for h in ALL_STEPS)} "
          "| chosen h [s] | error there | deepest penetration | energy raised, over its range |")  # fmt: skip
    print("|" + "---|" * (8 + len(ALL_STEPS)))
    for name in names:
        for motion in motions(name):
            print(row_of_steps(name, motion), flush=True)


def main() -> None:
    """Print the tables."""
    warnings.simplefilter("ignore")
    names = [name for name in sys.argv[1:] if name != "--steps"] or list(FILES)
    if "--steps" in sys.argv:
        table_of_steps(names)
        return
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
                depth = np.maximum(run.penetration(), run.limit_violation()).max()
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

"""Cost of EventDriven on robots: CPU time of smooth motion and of impacts, at one tolerance.

    python benchmarks/error_control.py [--tolerance 1e-8] [--repeats 9]

Medians of several runs in one process, what a run of no length costs (its start) taken off. The cost of an impact is
that of a run less what as much smooth motion of the same robot costs, the steps it cuts short included. UR5 and Panda
come with example-robot-data (`pip install mbvi[test]`). Set OMP_NUM_THREADS=1.
"""

import sysconfig
from pathlib import Path
from statistics import median
from time import process_time

import numpy as np
import typer

import mbvi

_REAL = Path(sysconfig.get_path("purelib")) / "cmeel.prefix/share/example-robot-data/robots"
_OWN = Path(__file__).parents[1] / "robots"


def ur5(floor: float | None) -> mbvi.Problem:
    """Return a UR5 that falls from nearly upright, its own links apart as its SRDF says."""
    scene = mbvi.Scene(restitution=0.5)
    if floor is not None:
        scene.add_halfspace((0, 0, 1), offset=floor, name="floor")
    folder = _REAL / "ur_description"
    scene.add_urdf(
        folder / "urdf/ur5_joint_limited_robot.urdf", base="fixed", srdf=folder / "srdf/ur5_joint_limited_robot.srdf",
        joints={"shoulder_lift_joint": -1.0, "elbow_joint": 0.3},
        velocity={"wrist_1_joint": 3.0, "wrist_3_joint": 4.0, "shoulder_pan_joint": 2.0},
    )  # fmt: skip
    return scene.build()


def panda(floor: float | None) -> mbvi.Problem:
    """Return a Panda that falls into its limits."""
    scene = mbvi.Scene(restitution=0.5)
    if floor is not None:
        scene.add_halfspace((0, 0, 1), offset=floor, name="floor")
    # the fingers on their own: their impacts accumulate
    scene.add_urdf(_REAL / "panda_description/urdf/panda.urdf", base="fixed", mimic=False)
    return scene.build()


def quadruped(height: float) -> mbvi.Problem:
    """Return a quadruped in the air, its legs moving."""
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1), name="floor")
    velocity = {
        f"{leg}_hip_joint": rate for leg, rate in zip(("FL", "FR", "RL", "RR"), (0.5, -0.3, 0.4, 0.2), strict=True)
    }
    scene.add_urdf(_OWN / "quadruped/quadruped.urdf", position=(0, 0, height), velocity=velocity)
    return scene.build()


# smooth motion of each robot comes first
CASES = {
    "UR5": {"swings": (ur5(None), 0.6), "onto floor and limits": (ur5(-0.1), 1.0)},
    "quadruped": {"flies": (quadruped(20.0), 1.0), "lands": (quadruped(0.6), 0.35)},
    "Panda": {"sags": (panda(None), 0.12), "onto floor and limits": (panda(-0.3), 0.5)},
}
INSTANT = 1e-9


def timed(problem: mbvi.Problem, tolerance: float, duration: float, repeats: int) -> tuple[float, mbvi.Trajectory]:
    """Return the median CPU time [s] and the run."""
    times = []
    for _ in range(repeats + 1):
        start = process_time()
        run = mbvi.simulate(problem, mbvi.EventDriven(tolerance), duration=duration, progress=False)
        times.append(process_time() - start)
    return median(times[1:]), run


def main(tolerance: float = 1e-8, repeats: int = 9) -> None:
    """Print the table."""
    print(f"tolerance {tolerance:g}, medians of {repeats} runs\n")
    print(
        "| robot | motion | simulated [s] | steps | impacts | start [ms] | CPU [ms per simulated s] | us a step "
        "| us an impact |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for name, motions in CASES.items():
        a_second = np.nan
        for motion, (problem, duration) in motions.items():
            start, _ = timed(problem, tolerance, INSTANT, repeats)
            cpu, run = timed(problem, tolerance, duration, repeats)
            cpu, impacts = cpu - start, len(run.impacts)
            # recorded states: the start, one after each step, one after each impact
            steps = len(run.t) - 1 - impacts
            if not impacts:
                a_second = cpu / duration
            an_impact = 1e6 * (cpu - a_second * duration) / impacts if impacts else np.nan
            print(
                f"| {name} | {motion} | {duration:g} | {steps} | {impacts} | {1e3 * start:.1f} "
                f"| {1e3 * cpu / duration:.2f} | {1e6 * cpu / steps:.0f} | {an_impact:.0f} |"
            )


if __name__ == "__main__":
    typer.run(main)

"""Time of one step of Cassie, whose legs have two loops each, beside MuJoCo with the same model.

    python benchmarks/closed_loops.py             # print "Closed loops" of docs/benchmarks/performance.md
    python benchmarks/closed_loops.py --write     # and write it there

Both engines read the MJCF of `examples/cassie_landing.py`: 32 velocities, four points that coincide (12 rows of rank
10), springs, damped joints, and servos that hold the stand. MuJoCo has these points as `connect`, its Euler integrator
and its default solver, elliptic cones with friction.

Times are CPU times without the build and without the first step, the engines in turns, medians over the repeats; a
ratio is the median of the ratios of runs next to each other. The gap is the largest distance by which a loop is open.
Needs example-robot-data and mujoco (`pip install mbvi[test]`).
"""

from __future__ import annotations

import os

# read once, when numpy is imported
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

import argparse  # noqa: E402
import sys  # noqa: E402
import tempfile  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import NamedTuple  # noqa: E402

import mujoco  # noqa: E402
import numpy as np  # noqa: E402
from robot_cases import again  # noqa: E402
from turns import HEADS, SCHEMES, STEP, Times, machine, run_time, simulated, table, timing_cells, write_section  # noqa: E402

import mbvi  # noqa: E402
from mbvi_studies.engines.robot_in_mujoco import time_of_steps  # noqa: E402

sys.path.append(str(Path(__file__).parents[1] / "examples"))

import cassie_landing as cassie  # noqa: E402

TITLE, GRAVITY = "## Closed loops", 9.81


class Case(NamedTuple):
    """Where the pelvis starts [m], the friction of the floor, and how long it falls [s]."""

    height: float
    mu: float
    duration: float


# at 0.85 m the feet touch the floor
CASES = {
    "in the air": Case(2.0, 0.0, 0.3),
    "landing on its feet, no friction": Case(0.87, 0.0, 1.0),
    f"landing on its feet, mu = {cassie.MU}": Case(0.87, cassie.MU, 1.0),
}


def cassie_at(case: Case, start: np.ndarray) -> mbvi.Problem:
    """Return Cassie at rest above a floor; `start`, shape (nq,), has its joints."""
    scene = mbvi.Scene(gravity=(0, 0, -GRAVITY), friction=case.mu)
    scene.add_halfspace((0, 0, 1), name="floor")
    with tempfile.TemporaryDirectory() as folder:
        file, stand = Path(folder, "cassie.xml"), cassie.both(cassie.STAND)
        file.write_text(cassie.Sdf().mjcf(GRAVITY))
        scene.add_mjcf(file, position=(0, 0, 2), joints=cassie.both(cassie.NEAR), ctrl=stand, name="cassie")
    problem, q = scene.build(), start.copy()
    q[2] = case.height
    return problem.at(q, np.zeros(problem.system.nv))


class CassieInMuJoCo:
    """The same in MuJoCo."""

    def __init__(self, case: Case, problem: mbvi.Problem) -> None:
        text = cassie.Sdf().mjcf(GRAVITY)
        floor = '<geom name="floor" type="plane" size="0 0 1" conaffinity="1"/>'
        text = text.replace("<worldbody>", "<worldbody>" + floor)
        text = text.replace("<option ", f'<option timestep="{STEP}" cone="elliptic" ')
        self.model = m = mujoco.MjModel.from_xml_string(text)
        m.geom_condim[:], m.geom_friction[:, 0] = 3 if case.mu else 1, case.mu
        self.data, self._q = mujoco.MjData(m), problem.q0.copy()
        free, ball = int(mujoco.mjtJoint.mjJNT_FREE), int(mujoco.mjtJoint.mjJNT_BALL)
        for kind, place in zip(m.jnt_type.tolist(), m.jnt_qposadr.tolist(), strict=True):
            if kind in (free, ball):
                k = place + (3 if kind == free else 0)
                self._q[k : k + 4] = self._q[[k + 3, k, k + 1, k + 2]]

    def reset(self) -> None:
        """Return to the start."""
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:] = self._q
        for name, angle in cassie.both(cassie.STAND).items():
            self.data.ctrl[self.model.actuator(name).id] = angle

    def time(self, count: int) -> float:
        """Return the time of one step among `count`, the first excluded [s]."""
        self.reset()
        return time_of_steps(self.model, self.data, count)

    def gap(self, count: int) -> float:
        """Return by how much a loop is open at most in `count` steps [m]."""
        self.reset()
        gap = 0.0
        for _ in range(count):
            mujoco.mj_step(self.model, self.data)
            ties = self.data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
            gap = max(gap, float(np.abs(self.data.efc_pos[ties]).max()))
        return gap


def times(case: Case, problem: mbvi.Problem, peer: CassieInMuJoCo, repeats: int) -> Times:
    """Time MuJoCo and each scheme in turns, MuJoCo before and after each."""
    count = round(case.duration / STEP)
    first = {name: np.median([run_time(problem, s, STEP, STEP) for _ in range(7)]) for name, s in SCHEMES.items()}
    theirs, ours = {name: np.empty(repeats) for name in SCHEMES}, {name: np.empty(repeats) for name in SCHEMES}
    for k in range(-1, repeats):
        for name, scheme in SCHEMES.items():
            before = peer.time(count)
            spent = (run_time(problem, scheme, case.duration, STEP) - first[name]) / (count - 1)
            # the first turn compiles and loads
            if k >= 0:
                theirs[name][k], ours[name][k] = 0.5 * (before + peer.time(count)), spent
    return Times(
        float(np.median(np.concatenate([*theirs.values()]))),
        {name: float(np.median(t)) for name, t in ours.items()},
        {name: float(np.median(t / theirs[name])) for name, t in ours.items()},
    )


def line(name: str, case: Case, start: np.ndarray, repeats: int) -> str:
    """Return the line of a case."""
    problem = cassie_at(case, start)
    peer = CassieInMuJoCo(case, problem)
    found = times(case, problem, peer, repeats)
    gap = max(simulated(again(problem), s, case.duration, STEP).loop_gap().max() for s in SCHEMES.values())
    return f"| {name} | {timing_cells(found)} | {gap:.0e} | {peer.gap(round(case.duration / STEP)):.0e} |"


def section(repeats: int) -> str:
    """Return the section of the page."""
    start = cassie.start()
    lines = [line(name, case, start, repeats) for name, case in CASES.items()]
    text = (
        "Cassie (32 velocities; two loops in each leg, 12 rows of rank 10) with the springs, damping and servos of\n"
        "`examples/cassie_landing.py`, h = 1 ms, e = 0. MuJoCo reads the same MJCF, whose loops are `connect`; Euler,\n"
        f"default solver. CPU times without the build, medians of {repeats} repeats in turns,\n{machine()}."
    )
    parts = [
        TITLE,
        "    python benchmarks/closed_loops.py --write    # measures, and writes this section",
        text,
        table(f"Cassie | {HEADS} | loops open, mbvi [m] | loops open, MuJoCo [m]", lines),
        "With friction Cassie stands in mbvi. MuJoCo's loops open where the legs bear load, so that it collapses:\n"
        "after the landing the engines compute different motions.",
    ]
    return "\n\n".join(parts) + "\n"


def main() -> None:
    """Print the section and, with --write, put it into the page."""
    parser = argparse.ArgumentParser(description="Time steps of a robot with closed loops beside MuJoCo.")
    parser.add_argument("--repeats", type=int, default=15, help="runs of each engine")
    parser.add_argument("--write", action="store_true", help="replace the section in docs/benchmarks/performance.md")
    arguments = parser.parse_args()
    if arguments.repeats < 1:
        parser.error("at least 1 repeat is asked for")
    text = section(arguments.repeats)
    print(text)
    if arguments.write:
        write_section(TITLE, text)


if __name__ == "__main__":
    main()

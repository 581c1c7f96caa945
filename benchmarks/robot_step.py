"""How long one step of a robot takes, beside MuJoCo on the same robot in the same run.

The twelve-joint quadruped of this repository steps at h = 1e-3 s and e = 0 through `mbvi.simulate`, recording included,
and through MuJoCo's batched `mj_step`, which records nothing. The two take turns, so that a busy machine slows both.

    python benchmarks/robot_step.py                 # the table
    python benchmarks/robot_step.py --profile       # and where mbvi's time goes, layer by layer

Cases: "free flight", legs swinging, nothing near; "four feet standing", the joints held by the constant torques that
balance gravity while the robot glides over the floor at 0.1 m/s (a robot at rest repeats the same q bit for bit and
would be served from what is kept per q); "legs folding", the same crouch with no torque. MuJoCo gets the same robot,
floor, start, torques and excluded pairs, no friction, its Euler integrator and its default solver.

A time is (n steps - 1 step) / (n - 1), which takes set-up and first call away, in CPU time, for on a busy machine the
longer run would wait more often than the shorter; medians over the repeats, the ratio that of neighbours. The layers
are taken by the wall clock, from the fastest run. "rows" are the active constraints of a step, averaged over
the run in an untimed pass. BLAS runs on one thread unless OPENBLAS_NUM_THREADS says otherwise. MuJoCo (`pip install
mbvi[peers]`) is optional: without it mbvi's columns stand alone.
"""

from __future__ import annotations

import os

# read once, when numpy is imported
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

import argparse  # noqa: E402
import platform  # noqa: E402
import time  # noqa: E402
from collections import defaultdict  # noqa: E402
from collections.abc import Callable, Iterator  # noqa: E402
from contextlib import ExitStack, contextmanager  # noqa: E402
from dataclasses import dataclass  # noqa: E402
from importlib import import_module  # noqa: E402
from importlib.metadata import version  # noqa: E402
from itertools import islice  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import Any  # noqa: E402
from unittest import mock  # noqa: E402

import numpy as np  # noqa: E402
import pinocchio as pin  # noqa: E402

import mbvi  # noqa: E402

try:
    import mujoco
except ImportError:
    mujoco = None

Array = np.ndarray

URDF = Path(__file__).resolve().parents[1] / "robots" / "quadruped" / "quadruped.urdf"
STEP = 1e-3
_LEGS = ("FL", "FR", "RL", "RR")
_CROUCH = {f"{leg}_{joint}_joint": angle for leg in _LEGS for joint, angle in (("thigh", 0.6), ("calf", -1.2))}
_SWING = {f"{leg}_{joint}_joint": rate for leg in _LEGS for joint, rate in (("hip", 0.3), ("thigh", 1), ("calf", -1))}
# two links of 0.2 m, the foot below the hip, on a ball of 23 mm
_HEIGHT = 0.4 * np.cos(0.6) + 0.023


@dataclass(frozen=True)
class Case:
    """One situation to step.

    Attributes
    ----------
    name : str
        Title of its line.
    problem : mbvi.Problem
        The robot, the floor and the start.
    torque : ndarray, shape (nv,)
        What the control returns at all times [N, N m].
    """

    name: str
    problem: mbvi.Problem
    torque: Array


def cases() -> list[Case]:
    """Return the situations, each with a quadruped of its own."""
    folding = _quadruped(_HEIGHT)
    none = np.zeros(folding.system.nv)
    torque = _balance(folding)
    standing = _quadruped(_HEIGHT, control=lambda t, q, v: torque)
    glide = np.array([0.1, *none[1:]])
    return [
        Case("free flight", _quadruped(1.5, velocity=_SWING), none),
        Case("four feet standing", _again(standing, glide), torque),
        Case("legs folding", folding, none),
    ]


def _quadruped(height: float, **options: Any) -> mbvi.Problem:
    scene = mbvi.Scene(restitution=0.0)
    scene.add_halfspace(normal=(0.0, 0.0, 1.0), offset=0.0)
    scene.add_urdf(URDF, base="free", position=(0.0, 0.0, height), joints=_CROUCH, **options)
    return scene.build()


def _again(problem: mbvi.Problem, v0: Array | None = None) -> mbvi.Problem:
    """Return the problem as newly built, with what it keeps about distances of the start, not of the last run's end."""
    v0 = problem.v0 if v0 is None else v0
    constraints, e = problem.constraints.constraints, problem.restitution
    return mbvi.Problem(problem.system, constraints, problem.q0, v0, restitution=e, length=problem.length)


def _balance(problem: mbvi.Problem) -> Array:
    """Return the joint torques, shape (nv,), that hold the robot still on its feet."""
    system = problem.system
    force = system.force(problem.t0, problem.q0, np.zeros(system.nv))
    # the floor's forces carry the six directions of the base, the motors the rest
    J = problem.constraints.active(problem.t0, problem.q0, 1e-6).jacobian
    support = np.linalg.lstsq(J[:, :6].T, -force[:6], rcond=None)[0]
    torque = -force - J.T @ support
    torque[:6] = 0.0
    return torque


def mbvi_rows(case: Case, count: int) -> float:
    """Return the mean number of active rows over `count` steps, the first left out."""
    walk = mbvi.steps(_again(case.problem), step=STEP)
    return float(np.mean([step.active.gap.size for step in islice(walk, 1, count)]))


def mbvi_times(case: Case, count: int, repeats: int, between: Callable[[], None] = lambda: None) -> Array:
    """Return the time of one step among `count`, set-up taken away, shape (repeats,) [s].

    `between` is called after each repeat.
    """
    one, many = np.empty(repeats), np.empty(repeats)
    for k in range(repeats):
        one[k], many[k] = (_run_time(_again(case.problem), n) for n in (1, count))
        between()
    # the set-up is longer than many steps: its median, for its own scatter would drown them
    return (many - np.median(one)) / (count - 1)


def _run_time(problem: mbvi.Problem, count: int, clock: Callable[[], float] = time.process_time) -> float:
    start = clock()
    mbvi.simulate(problem, step=STEP, duration=count * STEP, progress=False)
    return clock() - start


class Peer:
    """The same robot, floor, start and torques in MuJoCo.

    Parameters
    ----------
    case : Case
        What it stands beside.
    """

    def __init__(self, case: Case) -> None:
        spec = mujoco.MjSpec.from_file(str(URDF))
        spec.worldbody.first_body().add_freejoint()
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0.0, 0.0, 1.0])
        for geom in spec.geoms:
            # no friction: one row a contact
            geom.condim = 1
        spec.option.timestep = STEP
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        # mbvi leaves out the pairs of adjacent links, as MuJoCo does by itself: nothing to exclude
        self._start(case)

    def _start(self, case: Case) -> None:
        """Keep the start in MuJoCo's order of coordinates; the base of this robot starts upright."""
        problem, data = case.problem, self.data
        model = problem.system.model
        self._q, self._v, self._torque = data.qpos.copy(), data.qvel.copy(), data.qfrc_applied.copy()
        self._q[:7] = *problem.q0[:3], 1.0, 0.0, 0.0, 0.0
        self._v[:6] = problem.v0[:6]
        for joint in range(2, model.njoints):
            here, there = model.idx_qs[joint], model.idx_vs[joint]
            mine = self.model.joint(model.names[joint])
            q, v = int(mine.qposadr[0]), int(mine.dofadr[0])
            self._q[q], self._v[v], self._torque[v] = problem.q0[here], problem.v0[there], case.torque[there]

    def _reset(self) -> None:
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:], self.data.qvel[:], self.data.qfrc_applied[:] = self._q, self._v, self._torque

    def rows(self, count: int) -> float:
        """Return the mean number of active rows over `count` steps, the first left out."""
        self._reset()
        rows = []
        for _ in range(count):
            mujoco.mj_step(self.model, self.data)
            rows.append(self.data.nefc)
        return float(np.mean(rows[1:]))

    def time(self, count: int) -> float:
        """Return the time of one step among `count`, the first taken away [s]."""
        self._reset()
        mujoco.mj_step(self.model, self.data)
        start = time.process_time()
        mujoco.mj_step(self.model, self.data, nstep=count - 1)
        return (time.process_time() - start) / (count - 1)


def line(case: Case, count: int, repeats: int) -> str:
    """Time one case, the two engines taking turns, and return its line of the table."""
    rows = mbvi_rows(case, count)
    if mujoco is None:
        mine = np.median(mbvi_times(case, count, repeats))
        return f"{case.name:20}{1e6 * mine:12.1f}{'-':>16}{'-':>7}{rows:11.2f}{'-':>13}"
    peer, others = Peer(case), []
    times = mbvi_times(case, count, repeats, between=lambda: others.append(peer.time(count)))
    mine, other, ratio = 1e6 * np.median(times), 1e6 * np.median(others), np.median(times / others)
    return f"{case.name:20}{mine:12.1f}{other:16.1f}{ratio:7.1f}{rows:11.2f}{peer.rows(count):13.2f}"


class Stopwatch:
    """Time by function, without that of the timed functions it calls.

    What the timing itself costs is measured on a function that does nothing, and taken away.
    """

    def __init__(self) -> None:
        self.clear()
        self._inside = self._outside = 0.0
        # the least, as the layers are read from the fastest run
        self._inside, self._outside = np.min([self._cost() for _ in range(25)], axis=0)
        self.clear()

    def clear(self) -> None:
        """Forget what was timed."""
        self._spent: dict[str, float] = defaultdict(float)
        self.calls: dict[str, int] = defaultdict(int)
        self._called: dict[str, int] = defaultdict(int)
        self._open: list[list[float]] = []

    def wrap(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return the function, timed under a name."""

        def timed(*args: Any, **kwargs: Any) -> Any:
            inner = [0.0, 0]
            self._open.append(inner)
            start = time.perf_counter()
            try:
                return function(*args, **kwargs)
            finally:
                took = time.perf_counter() - start
                self._open.pop()
                self._spent[name] += took - inner[0]
                self.calls[name] += 1
                self._called[name] += int(inner[1])
                if self._open:
                    self._open[-1][0] += took
                    self._open[-1][1] += 1

        return timed

    def own(self, name: str) -> float:
        """Return the time spent in a function itself [s]."""
        return self._spent[name] - self.calls[name] * self._inside - self._called[name] * self._outside

    def total(self) -> float:
        """Return the time spent in all timed functions and in timing them [s]."""
        outside = sum(self.calls.values()) - sum(self._called.values())
        return sum(self._spent.values()) + outside * self._outside

    def _cost(self, count: int = 2000) -> tuple[float, float]:
        """Return what timing adds to a function, and to whoever calls it, a call [s]."""
        nothing = self.wrap("nothing", lambda: None)

        def seconds(function: Callable[[], Any]) -> float:
            start = time.perf_counter()
            for _ in range(count):
                function()
            return (time.perf_counter() - start) / count

        bare = seconds(lambda: None)
        self.clear()
        whole = seconds(nothing)
        # the call itself belongs to the function; of the rest, what lies between the two readings of the clock
        inside = max(self._spent["nothing"] / count - bare, 0.0)
        return inside, max(whole - bare - inside, 0.0)


@contextmanager
def timed_layers(problem: mbvi.Problem, watch: Stopwatch) -> Iterator[list[str]]:
    """Time the layers of a step while the context lasts; yields their names, in the order of a step."""
    from mbvi.projection import Projector
    from mbvi.recorder import Recorder

    metric = type(problem.system.metric(problem.q0))
    owners: list[tuple[Any, tuple[str, ...]]] = [
        (mbvi.Paoli, ("step",)),
        (pin, ("integrate", "difference", "crba", "nonLinearEffects", "aba")),
        (type(problem.system), ("integrate", "difference", "placements", "separation_rows")),
        (type(problem.constraints), ("active",)),
        *((kind, ("active", "contacts")) for kind in dict.fromkeys(map(type, problem.constraints.constraints))),
        (type(problem.system), ("metric", "force", "free_velocity")),
        (Projector, ("project",)),
        # inside the projection
        (metric, ("whiten", "unwhiten")),
        (import_module("mbvi.projection.project"), ("solve_on", "kkt_residual")),
        (Recorder, ("step",)),
    ]
    names = []
    with ExitStack() as stack:
        for owner, attributes in owners:
            for attribute in attributes:
                if hasattr(owner, attribute):
                    names.append(f"{owner.__name__.rpartition('.')[2]}.{attribute}")
                    timed = watch.wrap(names[-1], getattr(owner, attribute))
                    stack.enter_context(mock.patch.object(owner, attribute, timed))
        yield names


def profile(case: Case, count: int, repeats: int) -> str:
    """Return where the time of a step goes: microseconds and calls a step of each layer, its callees left out."""
    watch = Stopwatch()
    bare = 1e6 * np.median(mbvi_times(case, count, repeats))
    # the fastest run of each length: there nothing else had the processor
    best: dict[int, tuple[float, Array]] = {1: (np.inf, np.empty(0)), count: (np.inf, np.empty(0))}
    for _ in range(repeats):
        with timed_layers(case.problem, watch) as names:
            for steps in best:
                problem = _again(case.problem)
                watch.clear()
                whole = _run_time(problem, steps, time.perf_counter)
                spent = [*map(watch.own, names), whole - watch.total()]
                calls = [*(watch.calls[name] for name in names), steps]
                best[steps] = min(best[steps], (whole, np.array([spent, calls])), key=lambda run: run[0])
    # as for the whole step, set-up and first step are taken away
    spent, calls = (best[count][1] - best[1][1]) / (count - 1)
    spent *= 1e6
    total = spent.sum()
    lines = [f"{case.name}: {bare:.1f} us a step untimed; {total:.1f} with the layers timed, in the fastest run"]
    for name, value, often in zip([*names, "simulate"], spent, calls, strict=True):
        if often > 0.0:
            lines.append(f"    {name:36}{value:8.2f} us{100.0 * value / total:7.1f} %{often:8.2f} calls")
    return "\n".join(lines)


def header(count: int, repeats: int) -> str:
    """Return machine and versions."""
    peer = f"mujoco {mujoco.__version__}" if mujoco is not None else "no mujoco"
    load = f", load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    return (
        f"{os.cpu_count()} CPUs{load}, {platform.machine()} {platform.system()}, Python {platform.python_version()}\n"
        f"mbvi {mbvi.__version__}, pin {version('pin')}, numpy {np.__version__}, scipy {version('scipy')}, {peer}\n"
        f"BLAS threads {os.environ['OPENBLAS_NUM_THREADS']}, h = {STEP:g} s, {count} steps, median of {repeats} repeats"
    )


def main() -> None:
    """Print the table and, if asked for, the layers."""
    parser = argparse.ArgumentParser(description="Time one step of the quadruped beside MuJoCo.")
    parser.add_argument("--steps", type=int, default=150, help="steps a run; after some 200 MuJoCo's stand gives way")
    parser.add_argument("--repeats", type=int, default=31, help="runs of each engine a case")
    parser.add_argument("--profile", action="store_true", help="print mbvi's time by layer")
    arguments = parser.parse_args()
    count, repeats = arguments.steps, arguments.repeats
    if count < 2 or repeats < 1:
        parser.error("at least 2 steps and 1 repeat are asked for")
    print(header(count, repeats), end="\n\n")
    columns = (("mbvi us/step", 12), ("MuJoCo us/step", 16), ("ratio", 7), ("rows mbvi", 11), ("rows MuJoCo", 13))
    print(f"{'case':20}" + "".join(f"{title:>{width}}" for title, width in columns))
    chosen = cases()
    for case in chosen:
        print(line(case, count, repeats), flush=True)
    if arguments.profile:
        for case in chosen:
            print("\n" + profile(case, count, repeats), flush=True)


if __name__ == "__main__":
    main()

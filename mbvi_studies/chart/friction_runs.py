"""Timed runs of scenes with friction by mbvi and by other engines: CPU time per simulated second, and the error."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from time import process_time

import numpy as np
from scipy.spatial.transform import Rotation

from mbvi.compiled import compile_all
from mbvi.errors import MbviError
from mbvi.problem import Problem
from mbvi.run.simulate import simulate
from mbvi.scene import Scene
from mbvi.schemes import MoreauJean, Paoli, Scheme, StewartTrinkle

from ..engines.rig import State
from ..engines.variant import Variant
from .errors import Array
from .friction import ROUGH, Rough

# simulated time before a run of mbvi, so that caches are warm, as part of its duration and at most [s]
_WARM, _WARMEST = 0.05, 0.2
_OURS: dict[str, Scheme] = {
    "mbvi, Paoli": Paoli(),
    "mbvi, MoreauJean": MoreauJean(),
    "mbvi, StewartTrinkle": StewartTrinkle(),
}


@dataclass(frozen=True)
class FrictionRecord:
    """One point of a chart of friction.

    Attributes
    ----------
    scene, title : str
        The scene by its name on the command line, and the title of its panel.
    line, setting : str
        The engine with what is kept along its line, and its other settings.
    step : float
        Time step [s].
    duration : float
        Simulated time [s].
    cpu : float
        CPU time per simulated second [s / s].
    error : float
        The error of the scene, in the unit that `what` states.
    what, source : str
        The error in words, and what it is measured against.
    """

    scene: str
    title: str
    line: str
    setting: str
    step: float
    duration: float
    cpu: float
    error: float
    what: str
    source: str


def problem_of(rough: Rough) -> Problem:
    """Return the problem that mbvi solves."""
    scene = Scene(gravity=rough.gravity, friction=rough.mu)
    scene.add_halfspace((0.0, 0.0, 1.0), name="floor")
    start = rough.start

    def springs(t: float, q: Array, v: Array) -> Array:
        return np.concatenate([np.zeros(6), rough.torque(q[7:], v[6:])])

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "body.urdf"
        file.write_text(rough.urdf)
        scene.add_urdf(
            file,
            position=start.position,
            rotation=Rotation.from_quat(start.quaternion).as_matrix(),
            joints=dict(zip(rough.joints, start.angles.tolist(), strict=True)),
            base_velocity=np.concatenate([start.linear, start.angular]),
            control=springs if rough.stiffness else None,
        )
        return scene.build()


def run_ours(rough: Rough, scheme: Scheme, h: float) -> tuple[float, float]:
    """Return CPU time per simulated second, recording included, and the error."""
    compile_all()
    for duration in (min(_WARM * rough.duration, _WARMEST), rough.duration):
        problem, begin = problem_of(rough), process_time()
        run = simulate(problem, scheme, step=h, duration=duration, progress=False)
        spent = process_time() - begin
    states = [_state(run.q[int(np.argmin(np.abs(run.t - t)))]) for t in rough.sampled]
    return spent / rough.duration, rough.error(states)


def _state(q: Array) -> State:
    still = np.zeros(3)
    return State(q[:3], q[3:7], q[7:], still, still, np.zeros(len(q) - 7))


def run_other(rough: Rough, variant: Variant[Rough, State], h: float) -> tuple[float, float]:
    """Return CPU time per simulated second of the steps alone, torques included, and the error."""
    engine, taken, spent, states = variant.make(rough, h), 0, 0.0, []
    for t in rough.sampled:
        begin = process_time()
        while taken < round(t / h):
            engine.advance()
            taken += 1
        spent += process_time() - begin
        states.append(engine.read())
    error = rough.error(states)
    return spent / rough.duration, error if np.isfinite(error) else np.inf


def sweep_ours(scene: str, steps: Sequence[float], budget: float) -> tuple[FrictionRecord, ...]:
    """Run mbvi's schemes on a scene at each step; see `sweep_other`."""
    rough, found = ROUGH[scene](), []
    for line, scheme in _OURS.items():
        each = 0.0
        for h in steps:
            if each * rough.duration / h > budget:
                break
            cpu, error = run_ours(rough, scheme, h)
            each = cpu * h
            found.append(_record(scene, rough, line, repr(scheme), h, cpu, error))
    return tuple(found)


def sweep_other(module: str, scene: str, steps: Sequence[float], budget: float) -> tuple[FrictionRecord, ...]:
    """Run another engine on a scene in all its variants at each step; called in a worker process.

    Parameters
    ----------
    module : str
        Name of the adapter, such as "friction_in_mujoco". Its `VARIANTS` are how to set the engine, its `FAILURES` the
        errors with which it gives up; such a step is left out.
    scene : str
        Name in `ROUGH`.
    steps : sequence of float
        Time steps [s], the longest first.
    budget : float
        CPU time of a run: steps are left out from the first that would cost more, judged by the one before [s].

    Raises
    ------
    MbviError
        If no run stays finite.
    """
    rough, found = ROUGH[scene](), []
    engine = import_module(f"..engines.{module}", __package__)
    for variant in engine.VARIANTS:
        each = 0.0
        for h in steps:
            if each * rough.duration / h > budget:
                break
            try:
                cpu, error = run_other(rough, variant, h)
            except engine.FAILURES:
                continue
            each = cpu * h
            if np.isfinite(error):
                found.append(_record(scene, rough, variant.line, variant.setting, h, cpu, error))
    if not found:
        raise MbviError(f"it diverges on {rough.name} at all steps")
    return tuple(found)


def _record(scene: str, rough: Rough, line: str, setting: str, h: float, cpu: float, error: float) -> FrictionRecord:
    return FrictionRecord(
        scene, rough.name, line, setting, h, rough.duration, cpu, error, rough.what, rough.source
    )  # fmt: skip

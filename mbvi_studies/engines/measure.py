"""Cases in other engines: a check of the motion before the first impact, then errors and CPU times."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import import_module
from time import process_time
from types import ModuleType
from typing import Any

import numpy as np

from mbvi.errors import InputError, MbviError
from mbvi.problem import Problem
from mbvi.results.run_data import RunRecord
from mbvi.results.trajectory import Trajectory
from mbvi.schemes import Timing

from ..chart.errors import sampled_errors
from ..chart.records import NOT_MEASURED, Record
from ..chart.sweep import REPEATS, STEPS, Case, record
from ..chart.workers import made
from .rig import Array, Engine, Rig, rig

# part of the time to the first impact that is compared; coarse and fine step [s]
_FREE, _COARSE, _FINE = 0.9, 1e-3, 1e-4
# largest ratio of the errors at fine and coarse step (order one gives 0.1); error that is small enough in any case
_CONVERGED_RATIO, _NEGLIGIBLE = 0.15, 1e-7
# largest error of a quaternion's norm
_UNIT = 1e-3


class ModelError(MbviError):
    """Another engine's model of a case differs from mbvi's."""


def sweep_peer(
    module: str, make: Callable[[float], Case], e: float, steps: Sequence[float] = STEPS, repeats: int = REPEATS
) -> tuple[Record, ...]:
    """Run a case in an engine at several steps, as `mbvi_studies.chart.sweep` runs it in mbvi.

    Parameters
    ----------
    module : str
        Name of the adapter, such as "in_mujoco".
    make : callable
        e -> Case.
    e : float
        Restitution.
    steps : sequence of float
        Time steps [s].
    repeats : int
        Runs for each step. Times are those of the steps; a second run records the states.

    Raises
    ------
    ModelError
        If the engine's free motion differs from mbvi's.
    InputError
        If the case does not consist of rigid bodies.
    """
    case, engine = made(make, e), import_module(f".{module}", __package__)
    model = rig(case)
    if model is None or case.solution is None:
        raise InputError(f"{case.name} is not a problem of rigid bodies, so other engines cannot run it")
    check_free_motion(case, model, engine)
    return tuple(_point(case, model, engine, h, repeats) for h in steps)


def check_free_motion(case: Case, model: Rig, engine: ModuleType) -> tuple[float, float]:
    """Return the errors of an engine's motion before the first impact, at a coarse and a fine step.

    Raises
    ------
    ModelError
        If the error does not fall with the step.
    """
    off = [_free_error(case, model, engine, h) for h in (_COARSE, _FINE)]
    if not (off[1] <= _CONVERGED_RATIO * off[0] or off[1] <= _NEGLIGIBLE):
        raise ModelError(
            f"{engine.NAME} is not charted on {case.name}: before the first impact its error is {off[0]:.2g} at "
            f"h = {_COARSE:g} s and {off[1]:.2g} at {_FINE:g} s, which no integrator explains"
        )
    return off[0], off[1]


def _free_error(case: Case, model: Rig, engine: ModuleType, h: float) -> float:
    assert case.solution is not None
    first = case.solution.impacts[0] if len(case.solution.impacts) else case.duration
    peer, problem = engine.Peer(model, case.restitution, h), case.problem
    peer.start(model.state(problem.q0, problem.v0))
    count = int(_FREE * first / h)
    for _ in range(count):
        peer.advance()
    q, v = model.coordinates(peer.read())
    exact_q, exact_v = case.solution.at(problem.t0 + count * h)
    off = np.concatenate([problem.system.difference(exact_q, q), v - exact_v])
    return float(np.abs(off).max())


def _point(case: Case, model: Rig, engine: ModuleType, h: float, repeats: int) -> Record:
    peer, times, found = engine.Peer(model, case.restitution, h), [], []
    peer.start(model.state(case.problem.q0, case.problem.v0))
    _time(peer, int(case.duration / h))
    for k in range(repeats):
        problem = case.started(k * h / repeats)
        count = int((case.duration - k * h / repeats) / h * (1 + 1e-12))
        state = model.state(problem.q0, problem.v0)
        peer.start(state)
        times.append(_time(peer, count))
        peer.start(state)
        run = recorded(case.problem, case.name, model, peer, h, problem.t0, count)
        if hasattr(peer, "until"):
            peer.start(state)
            found.append(_judged_between(case, model, peer, run))
        else:
            found.append(_judged(case, run, peer.continuous))
    return record(case, engine.NAME, peer.settings, h, NOT_MEASURED, times, found)


def _judged(case: Case, run: Trajectory, continuous: bool) -> tuple[float, ...]:
    errors = case.judged(run)
    if not continuous:
        return errors
    # the motion is smooth between samples, and q and v belong to the same time
    assert case.solution is not None
    system = case.problem.system

    def at(t: float) -> tuple[Array, Array]:
        i = min(max(int(np.searchsorted(run.t, t, side="right")) - 1, 0), len(run.t) - 2)
        part = min((t - run.t[i]) / (run.t[i + 1] - run.t[i]), 1.0)
        q = system.integrate(run.q[i], part * system.difference(run.q[i], run.q[i + 1]))
        return q, run.v[i] + part * (run.v[i + 1] - run.v[i])

    return *sampled_errors(at, np.zeros(0), case.solution, len(run.t)), NOT_MEASURED, errors[-1]


def _judged_between(case: Case, model: Rig, peer: Any, run: Trajectory) -> tuple[float, ...]:
    """Return the errors of an engine that can stop at any time."""
    assert case.solution is not None
    solution, start = case.solution, float(run.t[0])

    def at(t: float) -> tuple[Array, Array]:
        # the start is on the solution
        if t <= start:
            return solution.at(t)
        peer.until(t - start)
        found: tuple[Array, Array] = model.coordinates(peer.read())
        return found

    # `sampled_errors` evaluates times in order
    return (
        *sampled_errors(at, np.zeros(0), solution),
        NOT_MEASURED,
        float(np.maximum(run.penetration(), run.limit_violation()).max(initial=0.0)),
    )


def _time(peer: Engine, count: int) -> float:
    many = getattr(peer, "many", None)
    # engines in a child process report its CPU time
    clock = getattr(peer, "clock", process_time)
    begin = clock()
    if many is not None:
        many(count)
    else:
        for _ in range(count):
            peer.advance()
    return float(clock() - begin)


def recorded(problem: Problem, name: str, model: Any, peer: Any, h: float, start: float, count: int) -> Trajectory:
    """Return the steps of an engine from its start as a trajectory.

    Parameters
    ----------
    problem : Problem
        The problem that the engine runs.
    name : str
        Its name.
    model : Rig or Bodies
        The map between coordinates.
    peer : Engine or BodiesEngine
        The engine, at its start.
    h, start : float
        Step and time of the start [s].
    count : int
        Number of steps.

    Raises
    ------
    ModelError
        If states are not finite.
    """

    def read() -> tuple[Array, Array]:
        state = peer.read()
        # a quaternion off the unit sphere is no rotation
        if not (np.abs(np.linalg.norm(state.quaternion, axis=-1) - 1.0) < _UNIT).all():
            raise ModelError(f"{name} diverges at h = {h:g} s")
        found: tuple[Array, Array] = model.coordinates(state)
        return found

    states = [read()]
    for _ in range(count):
        peer.advance()
        states.append(read())
    q, v = (np.array(x) for x in zip(*states, strict=True))
    if not (np.isfinite(q).all() and np.isfinite(v).all()):
        raise ModelError(f"{name} diverges at h = {h:g} s")
    t = start + h * np.arange(count + 1)
    depths = np.array([_depths(problem, float(ti), qi) for ti, qi in zip(t, q, strict=True)])
    # semi-implicit by default: the new velocity moves the configuration through the whole step
    kept = RunRecord(depths[:, 0], timing=Timing(jump=getattr(peer, "jump", 0.0)), limit_violation=depths[:, 1])
    return Trajectory(t, q, v, (), np.zeros(count + 1), "peer", h, problem=problem, record=kept)


def _depths(problem: Problem, t: float, q: Array) -> Array:
    active = problem.constraints.active(t, q, problem.tolerance)
    return problem.constraints.depths(active.constraint, active.gap)

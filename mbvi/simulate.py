"""The loop, and nothing else."""

from __future__ import annotations

import os
from collections.abc import Iterator
from time import perf_counter

import numpy as np

from .errors import DivergedError, InputError
from .located_run import run_located
from .problem import Problem
from .progress import Progress
from .projection import Projector, Push
from .recorder import Recorder
from .schemes import EventDriven, Paoli, Scheme, Step
from .schemes.step import law
from .trajectory import Trajectory
from .trajectory_file import Writer

_DEFAULT_STEP = 1e-3
_MOST_STEPS = 1e12
# [m/s, rad/s], squared and summed; beyond this no step means anything
_RUNAWAY = 1e16


def steps(problem: Problem, scheme: Scheme | None = None, *, step: float, residual: float = 1e-6) -> Iterator[Step]:
    """Step a problem by hand, without end.

    Parameters
    ----------
    problem : Problem
        What moves.
    scheme : Scheme, optional
        `Paoli()` by default.
    step : float
        Time step h [s].
    residual : float
        Relative KKT residual above which a projection raises.

    Returns
    -------
    iterator of Step
        The state after each step. If v0 is not in T_K(q0) the first is at t0, with the law (8) applied once.

    Raises
    ------
    InputError
        If h is not positive and finite.
    ProjectionError
        If a projection does not reach the residual.
    DivergedError
        If a step leaves numbers that are not finite.
    """
    h, chosen, projector = _positive(step, "step"), _scheme(scheme), Projector(_positive(residual, "residual"))
    if isinstance(chosen, EventDriven):
        raise InputError("EventDriven chooses its own steps: run it by simulate")
    return _walk(problem, chosen, h, projector)


def simulate(
    problem: Problem,
    scheme: Scheme | EventDriven | None = None,
    *,
    duration: float,
    step: float | None = None,
    every: int = 1,
    residual: float = 1e-6,
    out: str | os.PathLike[str] | None = None,
    progress: bool | None = None,
) -> Trajectory:
    """Simulate a problem.

    Parameters
    ----------
    problem : Problem
        What moves.
    scheme : Scheme, optional
        `Paoli()` by default.
    duration : float
        How long [s]; the last step is cut so that the run ends there.
    step : float, optional
        Time step h [s]; 1e-3 by default. Not for `EventDriven`.
    every : int
        Only every so many steps are recorded, and the last; impacts always are.
    residual : float
        Relative KKT residual above which a projection raises.
    out : path, optional
        HDF5 file written while the run goes on.
    progress : bool, optional
        Whether to show a bar; by default on a terminal, for long runs.

    Returns
    -------
    Trajectory
        States, impacts and how well each projection was solved.

    Raises
    ------
    InputError
        If duration, step, every or residual is not positive and finite, or `EventDriven` is to run moving walls.
    TrajectoryFileError
        If `out` cannot be written; before the first step.
    ProjectionError, DivergedError
        As `steps`.
    """
    duration, residual = _positive(duration, "duration"), _positive(residual, "residual")
    h = _DEFAULT_STEP if step is None else _positive(step, "step")
    if int(every) != every or every < 1:
        raise InputError(f"every must be a positive integer; got {every!r}")
    scheme = _scheme(scheme)
    if isinstance(scheme, EventDriven):
        if problem.constraints.moving:
            raise InputError("EventDriven does not know walls that move on their own yet: take Paoli or another scheme")
        if step is not None or every != 1:
            raise InputError("EventDriven chooses its own steps and keeps all of them: leave out step and every")
        return run_located(problem, scheme, duration, residual, out, progress)
    projector = Projector(residual)
    # whole steps, and what is left of the duration after them
    if duration / h > _MOST_STEPS:
        raise InputError(f"{duration / h:.1g} steps are more than any run can take: shorten it or lengthen the step")
    whole = int(duration / h * (1.0 + 1e-12))
    rest = duration - whole * h
    total = whole + (rest > 1e-9 * h)
    recorder = Recorder(problem, 1 + -(-total // int(every)), getattr(scheme, "jump", 1.0))
    with Writer(out, problem, scheme, h, recorder) as writer, Progress(total, progress) as bar:
        state = _start(problem, projector)
        recorder.step(state, True)
        look = 0.0
        for i in range(1, total + 1):
            t = problem.t0 + (i - 1) * h
            state = scheme.step(problem, t, state.q, state.v, h if i <= whole else rest, projector)
            # written so that a NaN is refused too
            if not state.v.dot(state.v) < _RUNAWAY:
                raise _diverged(state, h)
            recorder.step(state, i % every == 0 or i == total)
            if perf_counter() >= look:
                look = min(writer.poll(), bar.poll(i))
        # the sum of the steps is off by rounding
        recorder.t[-1] = problem.t0 + duration
    return recorder.trajectory(scheme, h)


def _walk(problem: Problem, scheme: Scheme, h: float, projector: Projector) -> Iterator[Step]:
    state = _start(problem, projector)
    if state.percussion.any():
        yield state
    i = 0
    while True:
        state = scheme.step(problem, problem.t0 + i * h, state.q, state.v, h, projector)
        if not state.v.dot(state.v) < _RUNAWAY:
            raise _diverged(state, h)
        i += 1
        yield state


def _diverged(state: Step, h: float) -> DivergedError:
    return DivergedError(
        f"the velocity runs away at t = {state.t:.6g} s, to {np.abs(state.v).max():.3g}: the forces change too fast "
        f"for h = {h:g} s; take a smaller step, or give light links damping or more inertia"
    )


def _start(problem: Problem, projector: Projector) -> Step:
    """Return the initial state, with the law (8) applied where v0 is not in T_K(q0)."""
    if hasattr(problem.system, "start"):
        problem.system.start()
    # the problem's own are not to be written to
    t, q, v = problem.t0, problem.q0.copy(), problem.v0.copy()
    active = problem.constraints.active(t, q, problem.tolerance)
    before = active.speeds(v)
    rounding = 1e-12 * (abs(active.jacobian) @ np.abs(v))
    if active.rate is not None:
        rounding += 1e-12 * np.abs(active.rate)
    if (before >= -rounding).all():
        return Step(t, q, v, active, np.array([np.zeros(len(before)), before, before, before]), 0.0)
    v, rates, residual = law(projector, v, Push(v, problem.system.metric(q)), active)
    return Step(t, q, v, active, rates, residual)


def _scheme(scheme: Scheme | EventDriven | None) -> Scheme | EventDriven:
    if scheme is None:
        return Paoli()
    if isinstance(scheme, type) or not (hasattr(scheme, "step") or isinstance(scheme, EventDriven)):
        raise InputError(f"scheme must be an object such as mbvi.Paoli(); got {scheme!r}")
    return scheme


def _positive(value: float, name: str) -> float:
    # written so that a NaN is refused too
    if not (isinstance(value, (int, float, np.number)) and value > 0.0 and np.isfinite(value)):
        raise InputError(f"{name} must be a positive, finite number; got {value!r}")
    return float(value)

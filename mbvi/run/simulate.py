"""The loop, and nothing else."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from functools import partial
from time import perf_counter

import numpy as np

from ..arguments import boolean, choice, file_path, integer, optional, positive, shown
from ..errors import InputError
from ..problem import Problem, check_kept
from ..projection import ChosenSolver, FreeMotion, Projector, checked_solver
from ..results.hdf5 import Writer
from ..results.trajectory import Trajectory
from ..scene import Scene
from ..schemes import EventDriven, Scheme, Step
from ..schemes.step import ended, law
from .default_scheme import default_scheme, time_stepping
from .event_loop import run_event_driven
from .interrupted import run_so_far
from .progress import Progress
from .recorder import ContactRecorder, Recorder
from .sleeping import Sleepers
from .tunnelling import TunnellingGuard

_DEFAULT_STEP = 1e-3
_MOST_STEPS = 1e12


def steps(
    problem: Problem,
    scheme: Scheme | None = None,
    *,
    step: float,
    residual: float = 1e-6,
    solver: ChosenSolver | None = None,
) -> Iterator[Step]:
    """Step a problem by hand, without end.

    Parameters
    ----------
    problem : Problem
        What moves.
    scheme : Scheme, optional
        By default `Centered(project_positions=True)`; for many free bodies at e = 0, `StewartTrinkle()`.
    step : float
        Time step h [s].
    residual : float
        Relative KKT residual above which a projection raises.
    solver : ProxQP, ActiveSet, DualActiveSet or SparsePCG, optional
        Solves every projection; by default several are tried in order.

    Returns
    -------
    iterator of Step
        The state after each step. If v0 is not in T_K(q0) the first is at t0, with the law (8) applied once.

    Raises
    ------
    InputError
        If h is not positive and finite, or the solver is none of those.
    UnsuitableError
        If the scheme is not made for the problem.
    ProjectionError
        If a projection does not reach the residual; where a solver was chosen the message names it.
    DivergedError
        If a step leaves numbers that are not finite, or a function of the user returns such.
    """
    _problem(problem)
    check_kept(problem)
    h, projector = positive(step, "step"), Projector(positive(residual, "residual"), checked_solver(solver))
    chosen = time_stepping(problem)[0] if scheme is None else _scheme(problem, scheme)
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
    solver: ChosenSolver | None = None,
    out: str | os.PathLike[str] | None = None,
    progress: bool | None = None,
    record: str | None = None,
) -> Trajectory:
    """Simulate a problem.

    Parameters
    ----------
    problem : Problem
        What moves.
    scheme : Scheme or EventDriven, optional
        By default chosen for the problem, which the run's first note says and why: `EventDriven(tolerance=1e-6)` for
        few constraints whose gradients are continuous; where there are many, or gradients jump, or a control or an
        external force acts, and wherever a step is given, `Centered(project_positions=True)`; for many free bodies at
        e = 0 `StewartTrinkle()`.
    duration : float
        How long [s]; the last step is cut so that the run ends there. `SchatzmanPaoli` takes whole steps only: its last
        state is read within one.
    step : float, optional
        Time step h [s], not for `EventDriven`. By default 1e-3 of a scheme that was named, else from the scene's own
        time scales.
    every : int
        Only every so many steps are recorded, and the last; impacts always are. `EventDriven` takes steps of its own,
        and keeps the states before and after each impact too; `run.at(t)` is then a cubic between what was kept.
    residual : float
        Relative KKT residual above which a projection raises.
    solver : ProxQP, ActiveSet, DualActiveSet or SparsePCG, optional
        Solves every projection of the run, which the notes say; by default several are tried in order, and the first
        answer that is good enough is taken.
    out : path, optional
        HDF5 file written while the run goes on.
    progress : bool, optional
        Whether to show a bar; by default on a terminal, for long runs.
    record : "contacts", optional
        What to record beside states and impacts: the percussions of all contacts, for `run.contacts(t)` and
        `run.contact_forces()`. With `every` those of the steps between two states are added up.

    Returns
    -------
    Trajectory
        States, impacts and how well each projection was solved.

    Raises
    ------
    InputError
        If duration, step, every or residual is not positive and finite, the solver is none of those, or record is
        another word.
    UnsuitableError
        If the scheme is not made for the problem: `EventDriven` for walls that move or too many bodies,
        `StewartTrinkle` for e > 0.
    TrajectoryFileError
        If `out` cannot be written: before the first step, or when the disk is full, and then `out` keeps what was
        written before. A file is read back and compared with the run before it is marked complete.
    ProjectionError, DivergedError
        As `steps`; `DivergedError` also where `EventDriven` makes no progress in time.

    Notes
    -----
    An error that ends the run half-way, and a KeyboardInterrupt, carries the run so far as its `run`, a `Trajectory`
    that is not `complete`.
    """
    _problem(problem)
    check_kept(problem)
    duration, residual, every = (
        positive(duration, "duration"),
        positive(residual, "residual"),
        integer(every, "every", 1),
    )
    h, out, progress = (
        optional(positive, step, "step"),
        optional(file_path, out, "out"),
        optional(boolean, progress, "progress"),
    )
    optional(choice, record, "record", ("contacts",))
    scheme, h, notes = _chosen(problem, scheme, h, duration)
    projector = Projector(residual, checked_solver(solver))
    if solver is not None:
        notes.append(f"every projection was solved by {solver!r}")
    if isinstance(scheme, EventDriven):
        return run_event_driven(problem, scheme, duration, every, projector, notes, out, progress, record is not None)
    assert h is not None
    # whole steps, and what is left of the duration after them
    if duration / h > _MOST_STEPS:
        raise InputError(f"{duration / h:.1g} steps are more than any run can take: shorten it or lengthen the step")
    whole = int(duration / h * (1.0 + 1e-12))
    rest = duration - whole * h
    total = whole + (rest > 1e-9 * h)
    kind = Recorder if record is None else ContactRecorder
    try:
        recorder = kind(problem, 1 + -(-total // every), getattr(scheme, "jump", 1.0), notes)
    except MemoryError as error:
        raise InputError(f"not enough memory for {total // every} states: record fewer of them by every=") from error
    guard = TunnellingGuard(problem, scheme, h)
    last = h if getattr(scheme, "whole_steps", False) else rest
    state = _start(problem, projector)
    recorder.step(state, True)
    with (
        run_so_far(partial(recorder.trajectory, scheme, h, complete=False)),
        Writer(out, problem, scheme, h, recorder) as writer,
        Progress(total, progress) as bar,
        Sleepers(problem, h) as sleepers,
    ):
        observe, look, swift, cut_steps, taken = _observed(guard, state), 0.0, True, 0, 0.0
        for i in range(1, total + 1):
            t, length = problem.t0 + (i - 1) * h, h if i <= whole else last
            if sleepers.any:
                *cuts, new = sleepers.stepped(partial(_advanced, guard, t, state, taken, length, projector), length)
            else:
                # as `guard.steps`, whose call alone is a fifteenth of the leanest step
                cuts = []
                new = scheme.step(problem, t, state.q, state.v, length, projector)
                # written so that a NaN is swift too
                was_swift, swift = swift, not new.v.dot(new.v) < guard.limit
                if swift or was_swift:
                    *cuts, new = guard.followed(t, state, new, length, projector)
            if i > whole and last > rest:
                cuts, new = ended(problem.system, state, [*cuts, new], problem.t0 + duration)
            for cut in cuts:
                recorder.step(cut, False)
            state, cut_steps = new, cut_steps + len(cuts)
            if observe is not None:
                taken = state.t - cuts[-1].t if cuts else length
                observe(state, taken)
            recorder.step(state, i % every == 0 or i == total)
            if perf_counter() >= look:
                look = min(writer.poll(), bar.poll(i))
        # the sum of the steps is off by rounding
        recorder.t[-1] = problem.t0 + duration
    if cut_steps:
        recorder.notes.append(f"{cut_steps} steps were cut where a body would have passed through another")
    return recorder.trajectory(scheme, h)


def _advanced(
    guard: TunnellingGuard, t: float, state: Step, taken: float, length: float, projector: Projector
) -> Iterator[Step]:
    """Return `guard.steps` from a state whose step took `taken` [s], which a control may look at the contacts of."""
    # a step that is taken again sees what it saw before
    if guard.observe is not None and taken > 0.0:
        guard.observe(state, taken)
    return guard.steps(t, state, length, projector)


def _observed(guard: TunnellingGuard, start: Step) -> Callable[[Step, float], None] | None:
    """Return what steps are shown to, if anything, after it was shown the initial state."""
    if guard.observe is not None and start.percussion.any():
        guard.observe(start, 0.0)
    return guard.observe


def _walk(problem: Problem, scheme: Scheme, h: float, projector: Projector) -> Iterator[Step]:
    state, guard, i = _start(problem, projector), TunnellingGuard(problem, scheme, h), 0
    observe = _observed(guard, state)
    if state.percussion.any():
        yield state
    while True:
        parts, taken = 0, h
        for new in guard.steps(problem.t0 + i * h, state, h, projector):
            yield new
            parts, taken, state = parts + 1, new.t - state.t, new
        if observe is not None:
            # the time of a whole step is rounded
            observe(state, h if parts == 1 else taken)
        i += 1


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
    v, rates, residual = law(projector, v, FreeMotion(v, problem.system.metric(q)), active)
    return Step(t, q, v, active, rates, residual)


def _chosen(
    problem: Problem, scheme: Scheme | EventDriven | None, h: float | None, duration: float
) -> tuple[Scheme | EventDriven, float | None, list[str]]:
    """Return the scheme, its step, and a note where the scheme was not named."""
    if scheme is None and h is None:
        scheme, h, reason = default_scheme(problem, duration)
        return scheme, h, [reason]
    if scheme is None:
        scheme, words = time_stepping(problem)
        return scheme, h, [f"{words} was chosen: the default at a given step"]
    scheme = _scheme(problem, scheme)
    if not isinstance(scheme, EventDriven):
        return scheme, _DEFAULT_STEP if h is None else h, []
    if h is not None:
        raise InputError("EventDriven chooses its own steps: leave out step")
    return scheme, None, []


def _scheme(problem: Problem, scheme: Scheme | EventDriven) -> Scheme | EventDriven:
    """Return the scheme if it is one and made for the problem."""
    if isinstance(scheme, type) or not (hasattr(scheme, "step") or isinstance(scheme, EventDriven)):
        raise InputError(f"scheme must be an object such as mbvi.Paoli(); got {shown(scheme)}")
    if hasattr(scheme, "check"):
        scheme.check(problem)
    return scheme


def _problem(problem: Problem) -> None:
    if isinstance(problem, Problem):
        return
    if isinstance(problem, Scene):
        raise InputError("problem must be a Problem, not a Scene: call scene.build() and give what it returns")
    raise InputError(f"problem must be a Problem: that of scene.build(), or mbvi.Problem(...); got {shown(problem)}")

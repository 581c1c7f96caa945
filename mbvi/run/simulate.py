"""`simulate` and `steps`: the loop over the steps of a scheme."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from functools import partial
from time import perf_counter

from ..arguments import boolean, choice, file_path, integer, optional, positive, shown
from ..errors import InputError, ProjectionError
from ..problem import Problem, check_kept
from ..projection import ChosenSolver, Projector, checked_solver
from ..results.error_estimate import repeatable
from ..results.files.hdf5 import Writer
from ..results.trajectory import Trajectory
from ..scene import Scene
from ..schemes import Adaptive, EventDriven, OwnStepsScheme, Scheme, Step
from ..schemes.step import end_at
from ..system.settings import Settings
from .accuracy import projector_of, residual_note
from .control_stability import failures_with_time, gain_notes
from .default_scheme import default_scheme, time_stepping
from .given_scheme import checked_scheme
from .interrupted import run_so_far
from .loop.compiled_loop import compiled_loop
from .own_steps.adaptive_loop import run_adaptive
from .own_steps.event_loop import run_event_driven
from .progress import Progress
from .recorder import Recorder
from .retaken import SolvedSteps
from .sleeping import Sleepers
from .start import initial_step
from .tunnelling import TunnellingGuard

_DEFAULT_STEP = 1e-3
_MOST_STEPS = 1e12


def steps(
    problem: Problem,
    scheme: Scheme | None = None,
    *,
    step: float,
    residual: float | None = None,
    depth: float | None = None,
    solver: ChosenSolver | None = None,
) -> Iterator[Step]:
    """Step a problem by hand, without end.

    Parameters
    ----------
    problem : Problem
        The problem to run.
    scheme : Scheme, optional
        By default `Centered(project_positions=True)`; for many free bodies `StewartTrinkle()`, unless every impact is
        elastic.
    step : float
        Time step h [s].
    residual : float, optional
        Relative KKT residual above which a projection raises; by default 1e-6, or that of the default depth.
    depth : float, optional
        Penetration that is accepted, relative to the size of the smallest free body: the radius of the largest ball
        within it, which is the radius of a sphere and half of the smallest edge of a box. The residual of each
        projection follows from it. For `StewartTrinkle`, with 1e-3 as default where rows are sparse (many bodies).
    solver : ProxQP, DualActiveSet or SparsePCG, optional
        Solves every projection; as of `simulate`. Not with friction, whose law has its own.

    Returns
    -------
    iterator of Step
        The state after each step. If v0 is not in T_K(q0) the first is at t0, with the law (8) applied once.

    Raises
    ------
    InputError
        If h, residual or depth is not positive and finite, both are given, or the solver is none of those.
    UnsuitableError
        If the scheme cannot run the problem, or does not take a depth.
    ProjectionError
        If a projection does not reach the residual; where a solver was chosen the message names it.
    DivergedError
        If a step or a function of the user returns numbers that are not finite.
    """
    check_problem(problem)
    check_kept(problem)
    h = positive(step, "step")
    chosen = time_stepping(problem)[0] if scheme is None else checked_for(problem, scheme)
    if isinstance(chosen, OwnStepsScheme):
        raise InputError(f"{chosen.name} chooses its own steps: run it by simulate")
    projector, _ = projector_of(problem, chosen, residual, depth, checked_solver(solver), h)
    return _steps(problem, chosen, h, projector)


def simulate(
    problem: Problem,
    scheme: Scheme | OwnStepsScheme | None = None,
    *,
    duration: float,
    step: float | None = None,
    every: int = 1,
    residual: float | None = None,
    depth: float | None = None,
    solver: ChosenSolver | None = None,
    out: str | os.PathLike[str] | None = None,
    progress: bool | None = None,
    record: str | None = None,
) -> Trajectory:
    """Simulate a problem.

    Parameters
    ----------
    problem : Problem
        The problem to run.
    scheme : Scheme, EventDriven or Adaptive, optional
        By default chosen for the problem; the run's first note gives the scheme and the reason.
        `EventDriven(tolerance=1e-6)` for few constraints with continuous gradients. `Centered(project_positions=True)`
        for many constraints, for gradients that jump, under a control or an external force, and wherever a step is
        given. `StewartTrinkle()` for many free bodies, unless every impact is elastic.
    duration : float
        Duration [s]; the last step is shortened so that the run ends there. `SchatzmanPaoli` takes whole steps only:
        the last state is interpolated.
    step : float, optional
        Time step h [s], not for `EventDriven` and `Adaptive`. By default 1e-3 if another scheme is named, else from the
        time scales of the scene.
    every : int
        One state in `every` steps is recorded, and the last one; impacts are always recorded. `EventDriven` and
        `Adaptive` choose their own steps, and record the states before and after each located impact too; `run.at(t)`
        is then a cubic between recorded states.
    residual : float, optional
        Relative KKT residual above which a projection raises; by default 1e-6, or that of the default depth.
    depth : float, optional
        Penetration that is accepted, relative to the size of the smallest free body: the radius of the largest ball
        within it, which is the radius of a sphere and half of the smallest edge of a box. The residual of each
        projection follows from it. For `StewartTrinkle`, with 1e-3 as default where rows are sparse (many bodies).
    solver : ProxQP, DualActiveSet or SparsePCG, optional
        Solves every projection of the run, and a note of the run says so. By default those that
        docs/developer/solvers.md lists.
    out : path, optional
        HDF5 file written while the run goes on.
    progress : bool, optional
        Whether to show a bar; by default on a terminal, for long runs.
    record : "contacts", optional
        Record the percussions of all contacts too, for `run.contacts(t)` and `run.contact_forces()`. With `every` those
        of the steps between two recorded states are added up.

    Returns
    -------
    Trajectory
        States, impacts and the residual of each projection.

    Raises
    ------
    InputError
        If duration, step, every, residual or depth is not positive and finite, residual and depth are both given, the
        solver is none of those, or record is another word.
    UnsuitableError
        If the scheme cannot run the problem: `EventDriven` with moving walls or too many bodies. If a depth is given to
        another scheme than `StewartTrinkle`.
    TrajectoryFileError
        If `out` cannot be written: before the first step, or when the disk is full; `out` then keeps the states written
        before. A file is read back and compared with the run before it is marked complete.
    ProjectionError, DivergedError
        As `steps`; `DivergedError` also where `EventDriven` makes no progress in time.

    Notes
    -----
    An error or a KeyboardInterrupt that ends the run has the run so far as its attribute `run`, a `Trajectory` that is
    not `complete`.
    """
    check_problem(problem)
    check_kept(problem)
    duration, every = positive(duration, "duration"), integer(every, "every", 1)
    h, out, progress = (
        optional(positive, step, "step"),
        optional(file_path, out, "out"),
        optional(boolean, progress, "progress"),
    )
    optional(choice, record, "record", ("contacts",))
    scheme, h, notes = _scheme_and_step(problem, scheme, h, duration)
    projector, accepted = projector_of(problem, scheme, residual, depth, checked_solver(solver), h)
    built = [] if problem.scene is None else problem.scene.notes(problem)
    notes += accepted + problem.system.notes() + built
    if solver is not None:
        notes.append(f"every projection was solved by {solver!r}")
    again, settings = partial(simulate, residual=residual, depth=depth, solver=solver), Settings(problem.system)
    if isinstance(scheme, EventDriven):
        run = run_event_driven(problem, scheme, duration, every, projector, notes, out, progress, record is not None)
        return repeatable(run, again, settings)
    if isinstance(scheme, Adaptive):
        run = run_adaptive(problem, scheme, duration, every, projector, notes, out, progress, record is not None)
        return repeatable(run, again, settings)
    assert h is not None and isinstance(scheme, Scheme)
    notes += gain_notes(problem, h)
    if duration / h > _MOST_STEPS:
        raise InputError(f"{duration / h:.1g} steps are more than any run can take: shorten it or lengthen the step")
    # the number of whole steps, the remaining time, and the number of all steps
    whole = int(duration / h * (1.0 + 1e-12))
    rest = duration - whole * h
    # a run that is shorter than rounding of a step has one too
    total = max(whole + (rest > 1e-9 * h), 1)
    try:
        recorder = Recorder(problem, 1 + -(-total // every), scheme.timing, notes, record is not None)
    except MemoryError as error:
        raise InputError(f"not enough memory for {total // every} states: record fewer of them by every=") from error
    guard = TunnellingGuard(problem, scheme, h)
    solved = SolvedSteps(problem, scheme, guard)
    last = h if scheme.timing.whole_steps else rest
    state = initial_step(problem, projector)
    solved.note_loose(problem.t0, projector)
    recorder.step(state, True)
    with (
        run_so_far(partial(recorder.trajectory, scheme, h, complete=False)),
        Writer(out, problem, scheme, h, recorder) as writer,
        Progress(total, progress) as bar,
        Sleepers(problem, h, projector) as sleepers,
        failures_with_time(problem, h, lambda: state),
    ):
        observe, next_poll, fast, shortened_steps, last_length = _observed(guard, state), 0.0, True, 0, 0.0
        loop = compiled_loop(problem, scheme, projector, recorder, guard, h, every, total)
        done = 0
        while done < total:
            if loop is not None and done < whole:
                state, done, complete = loop.run(state, done, whole)
                fast = not state.v.dot(state.v) < guard.limit
                if perf_counter() >= next_poll:
                    next_poll = min(writer.poll(), bar.poll(done))
                if complete:
                    continue
            i = done = done + 1
            t, length = problem.t0 + (i - 1) * h, h if i <= whole else last
            # bodies fall asleep only where the loop has left many steps in a row to Python
            if sleepers.any and (loop is None or loop.idle):
                *parts, new = sleepers.stepped(
                    partial(_advanced, solved, guard, t, state, last_length, length, projector), length
                )
            else:
                # `solved.steps`, written out: the call alone would cost a fifteenth of the cheapest step
                parts = []
                try:
                    new = scheme.step(problem, t, state.q, state.v, length, projector)
                    # the guard checks a step if the state before or after it is fast; a NaN counts as fast
                    was_fast, fast = fast, not new.v.dot(new.v) < guard.limit
                    if fast or was_fast:
                        *parts, new = guard.followed(t, state, new, length, projector)
                except ProjectionError as error:
                    *parts, new = solved.retake(t, state, length, projector, error)
            if i > whole and last > rest:
                parts, new = end_at(problem.system, state, [*parts, new], problem.t0 + duration)
            for part in parts:
                recorder.step(part, False)
            state, shortened_steps = new, shortened_steps + len(parts)
            if observe is not None:
                last_length = state.t - parts[-1].t if parts else length
                observe(state, last_length)
            recorder.step(state, i % every == 0 or i == total)
            if perf_counter() >= next_poll:
                next_poll = min(writer.poll(), bar.poll(i))
        # the sum of the steps has rounding errors
        recorder.t[-1] = problem.t0 + duration
    recorder.notes += residual_note(projector) + sleepers.note() + solved.notes()
    if shortened_steps > solved.parts:
        recorder.notes.append(
            f"{shortened_steps - solved.parts} steps were shortened where a body would have passed through another"
        )
    return repeatable(recorder.trajectory(scheme, h), again, settings)


def _advanced(
    solved: SolvedSteps, guard: TunnellingGuard, t: float, state: Step, last_length: float, length: float,
    projector: Projector,
) -> Iterator[Step]:  # fmt: skip
    """Return `solved.steps` from a state, after passing the contacts of the step that led there to the controls.

    `last_length` is the length of that step [s].
    """
    # the controls of a retried step must receive the same contacts as before
    if guard.observe is not None and last_length > 0.0:
        guard.observe(state, last_length)
    return solved.steps(t, state, length, projector)


def _observed(guard: TunnellingGuard, start: Step) -> Callable[[Step, float], None] | None:
    """Return the guard's observer, after passing it the contacts of the initial state."""
    if guard.observe is not None and start.percussion.any():
        guard.observe(start, 0.0)
    return guard.observe


def _steps(problem: Problem, scheme: Scheme, h: float, projector: Projector) -> Iterator[Step]:
    """Yield the states after steps without end; see `steps`."""
    state = initial_step(problem, projector)
    if state.percussion.any():
        yield state
    yield from steps_from(problem, scheme, h, projector, state)


def steps_from(problem: Problem, scheme: Scheme, h: float, projector: Projector, state: Step) -> Iterator[Step]:
    """Yield the states after steps from an initial state, without end."""
    guard, i = TunnellingGuard(problem, scheme, h), 0
    solved = SolvedSteps(problem, scheme, guard)
    observe = _observed(guard, state)
    with failures_with_time(problem, h, lambda: state):
        while True:
            parts, last_length = 0, h
            for new in solved.steps(problem.t0 + i * h, state, h, projector):
                yield new
                parts, last_length, state = parts + 1, new.t - state.t, new
            if observe is not None:
                # the difference of times has rounding errors, h has none
                observe(state, h if parts == 1 else last_length)
            i += 1


def _scheme_and_step(
    problem: Problem, scheme: Scheme | OwnStepsScheme | None, h: float | None, duration: float
) -> tuple[Scheme | OwnStepsScheme, float | None, list[str]]:
    """Return the scheme, its step, and a note where the scheme was not named."""
    if scheme is None and h is None:
        scheme, h, reason = default_scheme(problem, duration)
        return scheme, h, [reason]
    if scheme is None:
        scheme, words = time_stepping(problem)
        return scheme, h, [f"{words} was chosen: the default at a given step"]
    scheme = checked_for(problem, scheme)
    if isinstance(scheme, Scheme):
        return scheme, _DEFAULT_STEP if h is None else h, []
    if h is not None:
        raise InputError(f"{scheme.name} chooses its own steps: leave out step")
    return scheme, None, []


def checked_for(problem: Problem, given: Scheme | OwnStepsScheme) -> Scheme | OwnStepsScheme:
    """Return the scheme that a user gives if it is one and can run the problem."""
    scheme = checked_scheme(given)
    scheme.check(problem)
    return scheme


def check_problem(problem: Problem) -> None:
    """Raise `InputError` if a user gives something else than a problem."""
    if isinstance(problem, Problem):
        return
    if isinstance(problem, Scene):
        raise InputError("problem must be a Problem, not a Scene: call scene.build() and give what it returns")
    raise InputError(f"problem must be a Problem: that of scene.build(), or mbvi.Problem(...); got {shown(problem)}")

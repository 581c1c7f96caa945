"""`simulate` and `steps`: the loop over the steps of a scheme."""

from __future__ import annotations

import os
from collections.abc import Iterator
from functools import partial

from ..arguments import boolean, choice, file_path, integer, optional, positive, shown
from ..errors import InputError
from ..problem import Problem, check_kept
from ..projection import ChosenSolver, Projector, checked_solver
from ..results.error_estimate import repeatable
from ..results.files.hdf5 import Writer
from ..results.trajectory import Trajectory
from ..scene import Scene
from ..schemes import Adaptive, EventDriven, OwnStepsScheme, Scheme, Step
from ..system.settings import Settings
from .accuracy import projector_of
from .control_stability import failures_with_time, gain_notes
from .default_scheme import default_scheme, time_stepping
from .fixed_steps.retaken import SolvedSteps
from .fixed_steps.switching import SwitchedRecorder, SwitchFunction, Switching, switch_connections
from .fixed_steps.taking import FixedSteps, Plan, observed
from .given_scheme import checked_scheme
from .interrupted import run_so_far
from .own_steps.adaptive_loop import run_adaptive
from .own_steps.event_loop import run_event_driven
from .progress import Progress
from .recording.recorder import Recorder
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
    switch: SwitchFunction | None = None,
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
    switch : callable, optional
        switch(state) -> {connection: bool}: which connections and couplings of the scene are on from then on; the
        others, and all at None, stay as they are. It is asked at the start and after every step but the last, with
        `state` as `Scene.add_control` gives it. What is switched on holds bodies and joints as they are then; that is
        an impact, as `Simulator.switch`. Notes of the run say what was switched when. `EventDriven` and `Adaptive` ask
        at least every millisecond, find the first time at which the answer changes, and end a step there; switch must
        then depend on the state alone. One with a memory switches where it was asked first.

    Returns
    -------
    Trajectory
        States, impacts and the residual of each projection.

    Raises
    ------
    InputError
        If duration, step, every, residual or depth is not positive and finite, residual and depth are both given, the
        solver is none of those, record is another word, or switch is no function or returns what is no connection.
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
    switching = None if switch is None else Switching(problem, switch)
    scheme, h, notes = _scheme_and_step(problem, scheme, h, duration, switching is not None)
    chosen = checked_solver(solver)

    def projector_for(problem: Problem) -> Projector:
        return projector_of(problem, scheme, residual, depth, chosen, h)[0]

    projector, accepted = projector_of(problem, scheme, residual, depth, chosen, h)
    built = [] if problem.scene is None else problem.scene.notes(problem)
    notes += accepted + problem.system.notes() + built
    if solver is not None:
        notes.append(f"every projection was solved by {solver!r}")
    again = partial(simulate, residual=residual, depth=depth, solver=solver, switch=switch)
    settings = Settings(problem.system)
    if isinstance(scheme, EventDriven):
        run = run_event_driven(
            problem, scheme, duration, every, projector, notes, out, progress, record is not None,
            switching=switching, projector_for=projector_for,
        )  # fmt: skip
        return repeatable(run, again, settings)
    if isinstance(scheme, Adaptive):
        run = run_adaptive(
            problem, scheme, duration, every, projector, notes, out, progress, record is not None, switching,
            projector_for,
        )  # fmt: skip
        return repeatable(run, again, settings)
    assert h is not None and isinstance(scheme, Scheme)
    notes += gain_notes(problem, h)
    if duration / h > _MOST_STEPS:
        raise InputError(f"{duration / h:.1g} steps are more than any run can take: shorten it or lengthen the step")
    plan = Plan.of(problem.t0, duration, h, every)
    states, kept = 1 + -(-plan.total // every), record is not None
    try:
        if switching is None:
            recorder = Recorder(problem, states, scheme.timing, notes, kept)
        else:
            recorder = SwitchedRecorder(problem, states, scheme.timing, notes, kept)
    except MemoryError as error:
        raise InputError(f"not enough memory for {states - 1} states: record fewer of them by every=") from error
    state = initial_step(problem, projector)
    recorder.step(state, True)
    with (
        run_so_far(partial(recorder.trajectory, scheme, h, complete=False)),
        Writer(out, problem, scheme, h, recorder) as writer,
        Progress(plan.total, progress) as bar,
    ):
        steps = FixedSteps(plan, scheme, recorder, writer, bar, switching)
        connected, done = problem, 0
        switched = {} if switching is None else switching.asked(problem, state, 0.0)
        while True:
            if switched:
                assert isinstance(recorder, SwitchedRecorder)
                if done % every:
                    recorder.add_state(state)
                t = problem.t0 + done * h
                connected, projector, state = switch_connections(
                    connected, switched, t, state, scheme, projector_for, recorder
                )
            state, done, switched = steps.take(connected, projector, state, done)
            if not switched:
                break
        # the sum of the steps has rounding errors
        recorder.t[recorder.count - 1] = plan.end
    recorder.notes += steps.notes
    if steps.shortened > steps.retaken:
        recorder.notes.append(
            f"{steps.shortened - steps.retaken} steps were shortened where a body would have passed through another"
        )
    return repeatable(recorder.trajectory(scheme, h), again, settings)


def _steps(problem: Problem, scheme: Scheme, h: float, projector: Projector) -> Iterator[Step]:
    """Yield the states after steps without end; see `steps`."""
    state = initial_step(problem, projector)
    if state.percussion.any():
        yield state
    yield from steps_from(problem, scheme, h, projector, state)


def steps_from(
    problem: Problem, scheme: Scheme, h: float, projector: Projector, state: Step, done: int = 0
) -> Iterator[Step]:
    """Yield the states after steps from the state after `done` steps, without end."""
    guard, i = TunnellingGuard(problem, scheme, h), done
    solved = SolvedSteps(problem, scheme, guard)
    observe = observed(guard, state)
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
    problem: Problem, scheme: Scheme | OwnStepsScheme | None, h: float | None, duration: float, switching: bool
) -> tuple[Scheme | OwnStepsScheme, float | None, list[str]]:
    """Return the scheme, its step, and a note where the scheme was not named."""
    if scheme is None and h is None:
        scheme, h, reason = default_scheme(problem, duration, switching)
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

"""The loop over steps of one length, for as long as the connections of the problem stay what they are."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from time import perf_counter
from typing import NamedTuple

from ...errors import ProjectionError
from ...problem import Problem
from ...projection import Projector
from ...results.files.hdf5 import Writer
from ...schemes import Scheme, Step
from ...schemes.step import end_at
from ..accuracy import residual_note
from ..control_stability import failures_with_time
from ..loop.compiled_loop import compiled_loop
from ..progress import Progress
from ..recording.recorder import Recorder
from ..sleeping import Sleepers
from ..tunnelling import TunnellingGuard
from .retaken import SolvedSteps
from .switching import Switching

# steps of the loop after which it is looked whether all bodies rest
_WATCHED = 128


class Plan(NamedTuple):
    """The steps of a run.

    Attributes
    ----------
    h : float
        Length of a step [s].
    every : int
        One state in `every` is recorded.
    whole, total : int
        The number of whole steps, and of all.
    rest : float
        The time that remains after the whole steps [s].
    end : float
        When the run ends [s].
    """

    h: float
    every: int
    whole: int
    total: int
    rest: float
    end: float

    @classmethod
    def of(cls, t0: float, duration: float, h: float, every: int) -> Plan:
        """Return the steps from t0 on."""
        whole = int(duration / h * (1.0 + 1e-12))
        rest = duration - whole * h
        # a run that is shorter than rounding of a step has one too
        return cls(h, every, whole, max(whole + (rest > 1e-9 * h), 1), rest, t0 + duration)


class FixedSteps:
    """Takes and records steps of one length.

    Parameters
    ----------
    plan, scheme, recorder, writer, bar
        Those of the run.
    switching : Switching or None
        The connections that are switched.

    Attributes
    ----------
    shortened, retaken : int
        How many steps were added where steps were shortened or retaken, and in how many parts more these were retaken.
    notes : list of str
        What a run shall note about its steps.
    """

    def __init__(
        self, plan: Plan, scheme: Scheme, recorder: Recorder, writer: Writer, bar: Progress, switching: Switching | None
    ) -> None:
        self._plan, self._scheme, self._recorder = plan, scheme, recorder
        self._writer, self._bar, self._switching = writer, bar, switching
        self.shortened, self.retaken, self.notes = 0, 0, list[str]()

    def take(self, problem: Problem, projector: Projector, state: Step, done: int) -> tuple[Step, int, dict[str, bool]]:
        """Take steps after `done` ones until connections are switched, or all.

        Parameters
        ----------
        problem : Problem
            Whose steps are taken; its time t0 is that before the first step of the run.
        projector : Projector
            Solves the projections.
        state : Step
            The state after `done` steps.

        Returns
        -------
        state : Step
            The last state.
        done : int
            How many steps are taken.
        switched : dict of str to bool
            The connections to switch; empty at the end of the run.
        """
        h, every, whole, total, rest, end = self._plan
        scheme, recorder, writer, bar, switching = (
            self._scheme, self._recorder, self._writer, self._bar, self._switching
        )  # fmt: skip
        guard = TunnellingGuard(problem, scheme, h)
        solved = SolvedSteps(problem, scheme, guard)
        solved.note_loose(state.t, projector)
        last, switched = h if scheme.timing.whole_steps else rest, dict[str, bool]()
        with Sleepers(problem, h, projector) as sleepers, failures_with_time(problem, h, lambda: state):
            observe, next_poll, fast, last_length = observed(guard, state), 0.0, True, 0.0
            loop = compiled_loop(problem, scheme, projector, recorder, guard, h, every, total)
            watched, resting = loop is not None and sleepers.watched, False
            while done < total:
                complete = False
                if loop is not None and done < whole and not resting:
                    # a function of the user is asked after every step
                    most = 1 if switching is not None else _WATCHED if watched else whole
                    state, done, complete = loop.run(state, done, min(whole, done + most))
                    fast = not state.v.dot(state.v) < guard.limit
                if not complete:
                    i = done = done + 1
                    t, length = problem.t0 + (i - 1) * h, h if i <= whole else last
                    # bodies fall asleep only where the loop has left many steps in a row to Python
                    if sleepers.undisturbed and length == h:
                        parts, new = [], state._replace(t=t + h)
                    elif sleepers.any and (loop is None or loop.idle or resting):
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
                        parts, new = end_at(problem.system, state, [*parts, new], end)
                    for part in parts:
                        recorder.step(part, False)
                    state, self.shortened = new, self.shortened + len(parts)
                    if observe is not None:
                        last_length = state.t - parts[-1].t if parts else length
                        observe(state, last_length)
                    recorder.step(state, i % every == 0 or i == total)
                if watched and not sleepers.undisturbed:
                    resting = bool(sleepers.all_still(state.v))
                    if not resting:
                        sleepers.wake()
                if switching is not None and done < total:
                    switched = switching.asked(problem, state, h)
                    if switched:
                        break
                if perf_counter() >= next_poll:
                    next_poll = min(writer.poll(), bar.poll(done))
        self.retaken += solved.parts
        for note in [*residual_note(projector), *sleepers.note(), *solved.notes()]:
            if note not in self.notes:
                self.notes.append(note)
        return state, done, switched


def observed(guard: TunnellingGuard, start: Step) -> Callable[[Step, float], None] | None:
    """Return the guard's observer, after passing it the contacts of the initial state."""
    if guard.observe is not None and start.percussion.any():
        guard.observe(start, 0.0)
    return guard.observe


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

"""The compiled loop: steps of a mechanism in one kernel, up to a step that Python takes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from functools import cached_property, partial
from itertools import pairwise

import numpy as np

from ...compiled import held
from ...constraints import Rows
from ...constraints.carried import Place
from ...constraints.contact import Contact
from ...constraints.mechanism.state import MechanismState
from ...constraints.tangents import Tangents
from ...problem import Problem
from ...projection import Projector
from ...results.contacts import ContactLog
from ...schemes import Scheme, Step
from ...schemes.contact_friction import friction_of
from ...schemes.kernels.records import DONE
from ...schemes.observer import contacts_of_step
from ...schemes.step import NO_RATES, STILL
from ...system.mechanisms.mechanism import Mechanism
from ..recording.carried_rows import place_of_rows
from ..recording.recorder import RECENT, Recorder
from ..tunnelling import TunnellingGuard
from .callbacks import python_callbacks
from .loop_record import ROUGH, TURNING, LoopRecord
from .loop_scope import is_compiled, loop_of
from .made_records import CHUNK, loop_record, mechanism_step
from .moving_walls import InLoop, in_loop
from .step_loop import FULL, Loop

Array = np.ndarray

# place of its percussion in a row of the log
_PERCUSSION = 8
# after so many attempts in a row that took no step, so many steps are Python's without one
_ATTEMPTS, _WAIT = 3, 7
_NOTHING = np.zeros(0)


class CompiledLoop:
    """Steps of mechanisms and free bodies in kernels, which call functions of the user where these act.

    Parameters
    ----------
    problem, scheme, projector, recorder
        Those of a run of which `is_compiled` is true.
    own : InLoop
        What of the problem steps.
    mechanism : Mechanism
        Its system's, with a `pin.Data` of its own.
    loop : Loop
        See `loop_of`.
    guard : TunnellingGuard
        Of the run.
    h : float
        Length of a step [s].
    every, total : int
        One state in `every` is recorded, and that of step number `total`.

    Attributes
    ----------
    codes : ndarray of int, shape (8,)
        How many calls of the kernel ended with each code.
    idle : bool
        Whether the last call of `run` was not an attempt.
    """

    def __init__(
        self, problem: Problem, own: InLoop, mechanism: Mechanism, loop: Loop, scheme: Scheme, projector: Projector,
        recorder: Recorder, guard: TunnellingGuard, h: float, every: int, total: int,
    ) -> None:  # fmt: skip
        self._problem, self._own, self._projector, self._recorder = problem, own, projector, recorder
        self._loop, self._limit, self._h, self._every, self._total = loop, guard.limit_with_walls, h, every, total
        self._state = MechanismState(own.constraints)
        self._callbacks = python_callbacks(problem, self._state)
        self._step = mechanism_step(problem, scheme, projector.residual, mechanism, self._state, self._callbacks, own)
        self._memory = self._step.memory
        states = recorder.t, recorder.q, recorder.v, recorder.penetration, recorder.limit_violation, recorder.residual
        self._log = loop_record(problem, scheme, guard, *states, own)
        self._held = held(self._step), held(self._log)
        self._patience, self.idle = Patience(), False
        self.codes = np.zeros(8, np.int64)

    def run(self, state: Step, done: int, whole: int) -> tuple[Step, int, bool]:
        """Take steps after `done` ones, up to `whole`, and record them.

        Returns
        -------
        state : Step
            The last state.
        done : int
            How many steps are taken.
        complete : bool
            Whether none of them was left to Python.
        """
        self.idle = self._patience.waits() or not self._state.enter()
        if self.idle:
            return state, done, False
        problem, recorder, memory = self._problem, self._recorder, self._memory
        if self._own.numbers is None:
            self._projector.lend(memory.percussion, memory.start, memory.size)
        q, v = self._own.with_prescribed(state.q), self._own.with_prescribed(state.v)
        end, count = min(whole, done + CHUNK) + 1, recorder.count
        with nullcontext() if self._callbacks is None else self._with_contacts():
            following, count, code = self._loop(
                *self._held, q, v, problem.t0, self._h, done + 1, end, self._total, self._every,
                count, self._limit, STILL * problem.length,
            )  # fmt: skip
        self.codes[code] += 1
        self._state.leave()
        if self._own.numbers is None:
            # else its rows are in another order
            self._projector.take_back(memory.percussion, memory.start, memory.size)
        taken = following - 1 - done
        self._patience.took(taken)
        self._log.q_before[taken], self._log.v_before[taken] = q, v
        self._own.name_rows(self._log, taken)
        if recorder.contacts is not None:
            # before the states, so that an interrupt leaves no state without its contacts
            self._record_contacts(recorder.contacts, done, taken)
        recorder.count = count
        if taken:
            self._replay(done, taken)
            state = self._logged(done, taken - 1)
            recorder.follow(self._state_before(done, taken - 1), state)
        if self._callbacks is not None:
            if taken:
                self._pass_contacts(taken - 1)
            self._callbacks.check()
        return state, done + taken, code in (DONE, FULL)

    @contextmanager
    def _with_contacts(self) -> Iterator[None]:
        """Let the kernel call functions of the user, and pass them the contacts of each step that it has taken."""
        assert self._callbacks is not None
        passed, taken = 0, self._log.taken

        def pass_contacts() -> None:
            nonlocal passed
            if taken[0] > passed:
                passed = taken.item(0)
                self._pass_contacts(passed - 1)

        taken[0] = 0
        if self._problem.system.observe is not None:
            self._callbacks.before = pass_contacts
        with self._callbacks.interruptible():
            yield

    def _pass_contacts(self, j: int) -> None:
        """Pass the contacts of step j of this call to the controls, for which they are looked up when these ask."""
        observe, constraints = self._problem.system.observe, self._problem.constraints
        if observe is None:
            return
        part = slice(*self._log.begin[j : j + 2].tolist())
        # copies, because a control may keep its state and look at contacts later
        number, rows = self._log.number[part].copy(), self._log.rows[part].copy()

        def contacts() -> tuple[Contact, ...]:
            step = step_of_rows(number, rows, 0.0, constraints.empty.jacobian)
            return contacts_of_step(step, self._h, constraints.name)

        observe(contacts)

    def _record_contacts(self, contacts: ContactLog, done: int, taken: int) -> None:
        """Record the contacts of the steps of the last call."""
        ends = self._log.begin[: taken + 1].tolist()
        all_rows = logged_rows(self._log, slice(0, ends[-1]), 0.0, self._problem.constraints.empty.jacobian)
        rows, friction = all_rows.active, friction_of(all_rows)
        # of one step between states nothing is compared
        places = self._places_of_rows(done, taken) if self._every > 1 else [None] * taken
        for j, place in enumerate(places):
            part, i = slice(ends[j], ends[j + 1]), done + j + 1
            contacts.add(
                rows.constraint[part], rows.point[part], rows.normal[part], all_rows.percussion[part],
                None if friction is None else friction.take(part),
                self._log.correction[part] if len(self._log.correction) else None, place,
            )  # fmt: skip
            if i % self._every == 0 or i == self._total:
                contacts.close()

    def _places_of_rows(self, done: int, taken: int) -> list[Callable[[], Place] | None]:
        """Return of each step of the last call a function that returns where its rows are."""
        log, none, h = self._log, self._problem.constraints.empty, self._h
        q, v = self._before(slice(0, taken + 1))
        at_end, t0 = [False, *log.at_end[:taken].tolist()], self._problem.t0
        states = [
            Step(t0 + (done + j) * h, q[j], v[j], none, NO_RATES, 0.0, at_end=at_end[j]) for j in range(taken + 1)
        ]
        timing = self._recorder.timing_of_rows
        return [partial(place_of_rows, self._problem, timing, *two) for two in pairwise(states)]

    def _replay(self, done: int, taken: int) -> None:
        """Record the impacts of the steps of the last call, and what percussions their rows had."""
        recorder, log, begin = self._recorder, self._log, self._log.begin[: taken + 1].tolist()

        def add(j: int, impacting: Array | None = None) -> None:
            part = slice(begin[j], begin[j + 1])
            recorder.recent.add(log.number[part].copy(), log.rows[part, _PERCUSSION].copy(), impacting)

        def add_until(end: int) -> None:
            # one more than is kept: what follows an impact is known of those after the first
            for j in range(max(added, end - RECENT - 1), end):
                add(j)

        added = 0
        for event in np.flatnonzero(log.event[:taken]).tolist():
            add_until(event)
            if event:
                recorder.follow(self._state_before(done, event - 1), self._logged(done, event - 1))
            add(event, recorder.impact(self._logged(done, event)))
            added = event + 1
        add_until(taken)

    def _state_before(self, done: int, j: int) -> Step:
        """Return the state before step j of the last call, without rows."""
        t = self._problem.t0 + (done + j) * self._h
        return Step(t, *self._before(j), self._problem.constraints.empty, NO_RATES, 0.0)

    def _before(self, which: int | slice) -> tuple[Array, Array]:
        """Return q and v before some steps of the last call, without joints of walls."""
        q, v = self._log.q_before[which], self._log.v_before[which]
        return q[..., : self._problem.system.nq].copy(), v[..., : self._problem.system.nv].copy()

    def _logged(self, done: int, j: int) -> Step:
        t, log = self._problem.t0 + (done + j) * self._h + self._h, self._log
        step = logged_step(log, j, t, self._problem.constraints.empty.jacobian)
        q, v = self._before(j + 1)
        step = step._replace(q=q, v=v, at_end=bool(log.at_end[j]))
        if self._problem.system.single_mechanism:
            return step
        # the recorder asks which bodies each row acts on
        return step._replace(active=step.active._replace(jacobian=self._reach[step.active.constraint]))

    @cached_property
    def _reach(self) -> Array:
        """The reach of each constraint of the problem, shape (n, nv)."""
        reach = self._state.reach
        if self._own.numbers is not None:
            reach = reach[np.argsort(self._own.numbers), : self._problem.system.nv]
        return reach


class Patience:
    """How many steps Python takes where the loop leaves every one to it: attempts cost time."""

    def __init__(self) -> None:
        self._wait = self._failed = 0

    def waits(self) -> bool:
        """Return whether the next step is Python's, and count it."""
        self._wait -= 1
        return self._wait >= 0

    def took(self, steps: int) -> None:
        """Learn how many steps the loop took in an attempt."""
        self._failed = 0 if steps else self._failed + 1
        self._wait = _WAIT if self._failed >= _ATTEMPTS else 0


def logged_step(log: LoopRecord, j: int, t: float, none: Array) -> Step:
    """Return step j of a log; see `logged_rows`."""
    return logged_rows(log, slice(*log.begin[j : j + 2].tolist()), t, none)


def logged_rows(log: LoopRecord, part: slice, t: float, none: Array) -> Step:
    """Return `step_of_rows` of some rows of a log, which are copied."""
    return step_of_rows(log.number[part].copy(), log.rows[part].copy(), t, none)


def step_of_rows(number: Array, rows: Array, t: float, none: Array) -> Step:
    """Return a step with rows of a log, and with what recorders and contacts need of them; its state is left out.

    `none` is a Jacobian without rows.
    """
    tangents = slip = None
    if rows.shape[1] >= ROUGH:
        tangents = Tangents(rows[:, 12], rows[:, 13:19].reshape(-1, 2, 3), none, None)
        slip = rows[:, 19:27].reshape(-1, 4, 2).transpose(1, 0, 2)
        if rows.shape[1] == TURNING:
            slip = np.concatenate([slip, rows[:, 27:].reshape(-1, 4, 3).transpose(1, 0, 2)], axis=2)
    active = Rows(
        number, rows[:, 0], none, rows[:, 1].copy(), np.ascontiguousarray(rows[:, 2:5]), rows[:, 5:8],
        None, tangents,
    )  # fmt: skip
    return Step(t, _NOTHING, _NOTHING, active, np.ascontiguousarray(rows[:, 8:12].T), 0.0, slip)


def compiled_loop(
    problem: Problem, scheme: Scheme, projector: Projector, recorder: Recorder, guard: TunnellingGuard, h: float,
    every: int, total: int,
) -> CompiledLoop | None:  # fmt: skip
    """Return the loop of a run, or None if its steps are Python's: see docs/developer/architecture.md."""
    loop = loop_of(scheme)
    if loop is None or not is_compiled(problem, scheme) or projector.solver:
        return None
    own = in_loop(problem)
    mechanism = None if own is None else own.system.mechanism()
    if own is None or mechanism is None:
        return None
    return CompiledLoop(problem, own, mechanism, loop, scheme, projector, recorder, guard, h, every, total)

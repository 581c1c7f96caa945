"""The compiled loop: steps of a mechanism in one kernel, up to a step that Python takes."""

from __future__ import annotations

import numpy as np

from ..constraints import Rows
from ..constraints.mechanism_state import MechanismState, can_be_compiled, row_buffer
from ..constraints.mechanism_tables import MOST_ROWS
from ..problem import Problem
from ..projection import Projector
from ..schemes import Centered, MoreauJean, Paoli, Scheme, Step
from ..schemes.mechanism_steps import LawMemory, MechanismStep, Scales, room
from ..schemes.step import STILL
from ..system.articulated import ArticulatedSystem
from ..system.controls import LoopControl, no_control
from ..system.mechanism import Mechanism
from .recorder import RECENT, Recorder
from .step_loop import CENTERED, CENTERED_PROJECTED, MOREAU_JEAN, PAOLI, LoopRecord, run_steps
from .tunnelling import TunnellingGuard

Array = np.ndarray

# steps in one call of the kernel, so that bars and files go on
_CHUNK = 2000
_NOTHING = np.zeros(0)


class CompiledLoop:
    """Steps of one mechanism that need no Python.

    Parameters
    ----------
    problem, scheme, projector, recorder
        Those of a run of which `kind_of_scheme` and `can_be_compiled` are true.
    guard : TunnellingGuard
        Of the run.
    h : float
        Length of a step [s].
    every, total : int
        One state in `every` is recorded, and that of step number `total`.
    """

    def __init__(
        self, problem: Problem, kind: int, scheme: Scheme, projector: Projector, recorder: Recorder, guard: TunnellingGuard,
        h: float, every: int, total: int,
    ) -> None:  # fmt: skip
        self._problem, self._projector, self._recorder = problem, projector, recorder
        self._kind, self._limit, self._h, self._every, self._total = kind, guard.limit, h, every, total
        system = problem.system
        self._state = MechanismState(problem.constraints)
        self._step = mechanism_step(problem, scheme, projector.residual, system.mechanism(), self._state)
        self._memory = self._step.memory
        states = recorder.t, recorder.q, recorder.v, recorder.penetration, recorder.residual
        self._log = loop_record(problem, guard, *states)
        self.codes = np.zeros(8, np.int64)

    def run(self, state: Step, done: int, whole: int) -> tuple[Step, int, bool]:
        """Take steps after `done` ones, up to `whole`.

        Returns
        -------
        state : Step
            The last state.
        done : int
            How many steps are taken.
        complete : bool
            Whether none of them was left to Python.
        """
        if not self._state.enter():
            return state, done, False
        problem, recorder, memory = self._problem, self._recorder, self._memory
        self._projector.lend(memory.percussion, memory.start, memory.size)
        q, v, end = state.q.copy(), state.v.copy(), min(whole, done + _CHUNK) + 1
        self._log.recent[:] = -1
        following, recorder.count, code = run_steps(
            self._step, self._log, self._kind, q, v, problem.t0, self._h, done + 1, end, self._total, self._every,
            recorder.count, self._limit, STILL * problem.length,
        )  # fmt: skip
        self.codes[code] += 1
        self._state.leave()
        self._projector.take_back(memory.percussion, memory.start, memory.size)
        if following > done + 1:
            state = recorder.last = self._last_step(following - 1, q, v)
            for i in range(max(done + 1, following - RECENT), following):
                recorder.recent.add(*self._rows_of(i))
        return state, following - 1, following == end

    def _rows_of(self, i: int) -> tuple[Array, Array]:
        """Return constraints and percussions of the rows of step i, shapes (m,) and (1, m)."""
        place = i % RECENT
        m = int(self._log.recent[place])
        return self._log.number[place, :m].copy(), self._log.percussion[place, :m].copy()[None]

    def _last_step(self, i: int, q: Array, v: Array) -> Step:
        """Return the last step, number i, with what the recorder needs of its rows."""
        log, (number, _) = self._log, self._rows_of(i)
        m = len(number)
        rows = Rows(
            number, _NOTHING, self._problem.constraints.empty.jacobian, _NOTHING, log.point[:m].copy(), _NOTHING
        )
        t = self._problem.t0 + (i - 1) * self._h + self._h
        return Step(t, q, v, rows, log.rates[: 4 * m].reshape(4, m).copy(), 0.0)


def mechanism_step(
    problem: Problem, scheme: Scheme, residual: float, mechanism: Mechanism, state: MechanismState
) -> MechanismStep:
    """Return what steps a problem that the loop takes, with room for one step."""
    system, constraints = problem.system, problem.constraints
    nq, nv, frictional = system.nq, system.nv, constraints.frictional
    assert isinstance(system, ArticulatedSystem)
    control = system.control.table if isinstance(system.control, LoopControl) else no_control(nv)
    memory = LawMemory(np.zeros(MOST_ROWS), np.zeros(3 * MOST_ROWS), np.zeros(3, np.int64))
    theta = scheme.theta if isinstance(scheme, MoreauJean) else 0.5
    scales = Scales(problem.tolerance, problem.length, residual, constraints.cache.squares, system.controlled, theta)
    rows, ahead, middle = (row_buffer(nv, frictional) for _ in range(3))
    return MechanismStep(
        mechanism, state.arrays, memory, scales, control, room(nq, nv), rows, ahead, middle, np.zeros(nq), np.zeros(nv),
        np.zeros(4 * MOST_ROWS), np.zeros(1),
    )  # fmt: skip


def loop_record(
    problem: Problem, guard: TunnellingGuard, t: Array, q: Array, v: Array, penetration: Array, residual: Array
) -> LoopRecord:
    """Return the record of a loop that writes states to given arrays."""
    return LoopRecord(
        t, q, v, penetration, residual, np.full(RECENT, -1), np.zeros((RECENT, MOST_ROWS), np.int64),
        np.zeros((RECENT, MOST_ROWS)), np.zeros((MOST_ROWS, 3)), np.zeros(4 * MOST_ROWS), problem.constraints.lever,
        np.zeros(4 * MOST_ROWS), *guard.shares,
    )  # fmt: skip


def is_compiled(problem: Problem, scheme: Scheme) -> bool:
    """Return whether the loop takes the steps of a scheme; the projections may still be such that it does not."""
    system = problem.system
    if kind_of_scheme(scheme) is None or type(system) is not ArticulatedSystem or problem.energy_cap:
        return False
    if system.controlled and not isinstance(system.control, LoopControl):
        return False
    return not system.applied.any() and can_be_compiled(problem.constraints)


def kind_of_scheme(scheme: Scheme) -> int | None:
    """Return which scheme of the loop this is, None if it is none."""
    match scheme:
        case Paoli(project_positions=False) if type(scheme) is Paoli:
            return PAOLI
        case MoreauJean(project_positions=False) if type(scheme) is MoreauJean:
            return MOREAU_JEAN
        case Centered() if type(scheme) is Centered:
            return CENTERED_PROJECTED if scheme.project_positions else CENTERED
    return None


def compiled_loop(
    problem: Problem, scheme: Scheme, projector: Projector, recorder: Recorder, guard: TunnellingGuard, h: float, every: int,
    total: int,
) -> CompiledLoop | None:  # fmt: skip
    """Return the loop of a run, or None if its steps are Python's: see docs/architecture.md."""
    kind, system = kind_of_scheme(scheme), problem.system
    if kind is None or type(recorder) is not Recorder or not is_compiled(problem, scheme) or projector.solver:
        return None
    if projector.energy_cap or projector.accepted is not None or system.mechanism() is None:
        return None
    return CompiledLoop(problem, kind, scheme, projector, recorder, guard, h, every, total)

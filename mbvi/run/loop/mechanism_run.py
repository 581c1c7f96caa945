"""A problem that the compiled loop steps, on a copy of its own."""

from __future__ import annotations

from contextlib import nullcontext
from copy import copy

import numpy as np

from ...compiled import held
from ...constraints import Rows
from ...constraints.mechanism.state import MechanismState
from ...problem import Problem
from ...projection import Projector
from ...schemes import Scheme, Step
from ...schemes.step import NO_RATES, STILL
from ...system import FreeBodies, with_parts
from ...system.mechanisms.articulated import ArticulatedSystem, Control
from ...system.mechanisms.mechanism import Mechanism
from ...system.system import Array, System
from ..accuracy import projector_of
from ..control_stability import failures_with_time
from ..fixed_steps.retaken import SolvedSteps
from ..start import admitted, closes_none, first_step, kept_velocity
from ..tunnelling import TunnellingGuard
from .callbacks import python_callbacks
from .compiled_loop import Patience, logged_step
from .loop_scope import loop_of
from .made_records import CHUNK, loop_record, mechanism_step
from .moving_walls import in_loop
from .step_loop import DONE, FULL

# no state is recorded
_NEVER = 1 << 62


class OwnProblem:
    """A problem with its own caches and `pin.Data`, so that a thread can run it beside others.

    It starts from what the caches of the given problem held when that was built.

    Attributes
    ----------
    problem : Problem
        The copy; model, shapes and scene are shared.
    loop : InLoop or None
        What of it steps; None where kernels cannot step it.
    state : MechanismState
        The constraints of that in arrays.
    mechanism : Mechanism or None
        None where Pinocchio cannot be called by address, too.
    """

    mechanism: Mechanism | None

    def __init__(self, problem: Problem) -> None:
        problem.constraints.renew()
        self.problem = _moved_by(problem, with_parts(problem.system, _copy_of))
        self.loop, self.mechanism = in_loop(self.problem), None
        if self.loop is not None:
            self.state = MechanismState(self.loop.constraints)
            self.mechanism = self.loop.system.mechanism()

    @property
    def control(self) -> Control | None:
        """The control of its mechanism, where it is one mechanism."""
        system = self.problem.system
        return system.control if isinstance(system, ArticulatedSystem) else None

    def set_control(self, control: Control | None) -> None:
        """Replace the control of its mechanism, where it is one mechanism."""
        system = self.problem.system
        if isinstance(system, ArticulatedSystem):
            system.set_control(control)


def controlled_copy(problem: Problem, control: Control | None) -> Problem:
    """Return a copy of a problem of one mechanism with a control, and with caches of its own."""
    new = _copy_of(problem.system)
    assert isinstance(new, ArticulatedSystem)
    new.set_control(control)
    return _moved_by(problem, new)


def _moved_by(problem: Problem, system: System) -> Problem:
    """Return a copy of a problem on a copy of its system."""
    new = copy(problem)
    new.system, new.constraints = system, problem.constraints.moved_by(system)
    return new


def _copy_of(part: System) -> System:
    """Return a copy of a part of a system that the loop takes; models and controls are shared."""
    if isinstance(part, FreeBodies):
        # it has memory that its steps write to
        return FreeBodies(part.masses, part.inertias, part.gravity, part.bodies[1:])
    return copy(part)


class MechanismRun:
    """Runs of a problem by a scheme of the compiled loop: what kernels need, and the steps that they leave to Python.

    Parameters
    ----------
    own : OwnProblem
        The problem.
    scheme : Scheme
        Of the loop.
    h : float
        Length of a step [s].
    room : int
        States for which there is room.

    Attributes
    ----------
    problem : Problem
        The problem that is run now, of which some may share the system and the constraints.
    q, v : ndarray, shapes (nq,) and (nv,)
        The present state; the same arrays always.
    done : int
        Number of the step that ended there.
    """

    def __init__(self, own: OwnProblem, scheme: Scheme, h: float, room: int) -> None:
        problem, loop = own.problem, loop_of(scheme)
        assert loop is not None and own.mechanism is not None and own.loop is not None
        self._own = own.loop
        self.scheme, self._loop, self._h, self._state = scheme, loop, h, own.state
        self._guard, self._still = TunnellingGuard(problem, scheme, h), STILL * problem.length
        self._solved = SolvedSteps(problem, scheme, self._guard)
        self.start(problem)
        problem.system.start()
        self._callbacks = python_callbacks(problem, own.state)
        self._step = mechanism_step(
            problem, scheme, self._projector.residual, own.mechanism, own.state, self._callbacks, own.loop
        )
        # the joints of walls come last
        self._state_of_loop = own.loop.with_prescribed(problem.q0), own.loop.with_prescribed(problem.v0)
        self.q, self.v = self._state_of_loop[0][: len(problem.q0)], self._state_of_loop[1][: len(problem.v0)]
        penetration, violation, residual = np.zeros((3, room))
        states = np.zeros(room), self.q[None], self.v[None], penetration, violation, residual
        self._log = loop_record(problem, scheme, self._guard, *states, own.loop)
        self._held = held(self._step), held(self._log)
        # where states are recorded
        self._recorded = self._log.q, self._log.v
        # the last step, or its place in the log
        self._last: Step | int = 0

    def start(self, problem: Problem, done: int = 0) -> None:
        """Begin another run, after `done` steps: nothing is known of its projections yet."""
        self.problem, self._patience, self._since, self.done = problem, Patience(), done + 1, done
        self._made: Projector | None = None
        if self._own.numbers is not None:
            self._own.constraints.renew()

    @property
    def _projector(self) -> Projector:
        """The projector of the run, made when Python needs it."""
        if self._made is None:
            self._made = projector_of(self.problem, self.scheme, None, None, None, self._h)[0]
        return self._made

    def initial_step(self) -> Step:
        """Go to the initial state of the problem, and return it."""
        self._step.memory.size[:] = 0
        self._last = found = first_step(self.problem, self._projector)
        self._go_on(found)
        return found

    def begin_with(self, q: Array, v: Array, active: Rows) -> None:
        """Go to an initial state of which the rows are known; what the constraints hold after their query is set."""
        v = kept_velocity(self.problem, q, v)
        self.q[:], self.v[:], self._step.memory.size[:] = q, v, 0
        if not closes_none(active, v):
            self._state.leave()
            self._go_on(admitted(self.problem, self._projector, q, v, active))

    def take(self, first: int, end: int, q: Array, v: Array) -> int:
        """Take steps from number `first` on, at most up to `end` - 1; return the number of the next.

        They are recorded in q and v, shapes (end, nq) and (end, nv), unless these have one row.
        """
        if self._since < first or not self._patience.waits():
            every, count = (1, first) if len(q) > 1 else (_NEVER, 0)
            if q is not self._recorded[0] or v is not self._recorded[1]:
                self._recorded = q, v
                self._held[1].replace(q=q, v=v)
            with nullcontext() if self._callbacks is None else self._callbacks.interruptible():
                following, _, code = self._loop(
                    *self._held, *self._state_of_loop, self.problem.t0, self._h, first,
                    min(end, self._since + CHUNK), -1, every, count, self._guard.limit_with_walls, self._still,
                )  # fmt: skip
            if following > first:
                self._last = following - 1 - first
            taken, first, self.done = following - self._since, following, following - 1
            if self._callbacks is not None:
                self._callbacks.check()
            if code == DONE and taken < CHUNK:
                return first
            # `simulate` makes another attempt here
            self._patience.took(taken)
            self._since = first
            if code in (DONE, FULL):
                return first
        self._last = new = self._python_step(first)
        if len(q) > 1:
            q[first], v[first] = new.q, new.v
        self._since, self.done = first + 1, first
        return first + 1

    def last_step(self, t: float) -> Step:
        """Return the last step, which ended at a time, with what contacts need of its rows."""
        if isinstance(self._last, Step):
            return self._last
        return self._own.named(logged_step(self._log, self._last, t, self.problem.constraints.empty.jacobian))

    def _python_step(self, k: int) -> Step:
        """Take step number k by Python."""
        memory, problem, h = self._step.memory, self.problem, self._h
        self._state.leave()
        if self._own.numbers is None:
            self._projector.take_back(memory.percussion, memory.start, memory.size)
        t, q, v = problem.t0 + (k - 1) * h, self.q.copy(), self.v.copy()
        before = Step(t, q, v, problem.constraints.empty, NO_RATES, 0.0)
        with failures_with_time(problem, h, lambda: before):
            *_, new = self._solved.steps(t, before, h, self._projector)
        self._go_on(new)
        return new

    def _go_on(self, step: Step) -> None:
        """Let kernels go on from a state."""
        self.q[:], self.v[:] = step.q, step.v
        self._state.enter()
        memory = self._step.memory
        if self._own.numbers is None:
            self._projector.lend(memory.percussion, memory.start, memory.size)

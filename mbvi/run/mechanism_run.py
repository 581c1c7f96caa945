"""A problem of one mechanism that the compiled loop steps, on a copy of its own."""

from __future__ import annotations

from copy import copy

import numpy as np

from ..constraints.mechanism_state import MechanismState
from ..problem import Problem
from ..projection import Projector
from ..schemes import Scheme, Step
from ..schemes.step import NO_RATES, STILL
from ..system.articulated import ArticulatedSystem, Control
from ..system.mechanism import Mechanism
from .accuracy import projector_of
from .compiled_loop import kind_of_scheme, loop_record, mechanism_step
from .start import initial_step
from .tunnelling import TunnellingGuard


class OwnProblem:
    """A problem of one mechanism with its own caches and `pin.Data`, so that a thread can run it beside others.

    It starts from what the caches of the given problem held when that was built.

    Attributes
    ----------
    problem : Problem
        The copy; model, shapes and scene are shared.
    state : MechanismState
        Its constraints in arrays.
    mechanism : Mechanism or None
        None where Pinocchio cannot be called by address.
    """

    def __init__(self, problem: Problem) -> None:
        system = problem.system
        assert isinstance(system, ArticulatedSystem)
        problem.constraints.renew()
        self.problem = controlled_copy(problem, system.control)
        self.state = MechanismState(self.problem.constraints)
        own = self.problem.system
        assert isinstance(own, ArticulatedSystem)
        self.mechanism: Mechanism | None = own.mechanism()

    @property
    def control(self) -> Control | None:
        """Its control."""
        system = self.problem.system
        assert isinstance(system, ArticulatedSystem)
        return system.control

    def set_control(self, control: Control | None) -> None:
        """Replace the control."""
        system = self.problem.system
        assert isinstance(system, ArticulatedSystem)
        system.set_control(control)


def controlled_copy(problem: Problem, control: Control | None) -> Problem:
    """Return a copy of a problem of one mechanism with a control, and with caches of its own."""
    system, new = problem.system, copy(problem)
    assert isinstance(system, ArticulatedSystem)
    new.system = ArticulatedSystem(system.model, system.name, control)
    new.constraints = problem.constraints.moved_by(new.system)
    return new


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
    q, v : ndarray, shapes (nq,) and (nv,)
        The present state; the same arrays always.
    """

    def __init__(self, own: OwnProblem, scheme: Scheme, h: float, room: int) -> None:
        problem, kind = own.problem, kind_of_scheme(scheme)
        assert kind is not None and own.mechanism is not None
        self.problem, self.scheme, self.kind, self.h = problem, scheme, kind, h
        self.guard, self._state = TunnellingGuard(problem, scheme, h), own.state
        self.still = STILL * problem.length
        self.start(problem)
        self.step = mechanism_step(problem, scheme, self._projector.residual, own.mechanism, own.state)
        self.q, self.v = problem.q0.copy(), problem.v0.copy()
        self.log = loop_record(problem, self.guard, np.zeros(room), self.q[None], self.v[None], *np.zeros((2, room)))

    def start(self, problem: Problem) -> None:
        """Begin another run, of the problem or of its `at`: nothing is known of its projections yet."""
        self.problem = problem
        self._projector: Projector = projector_of(problem, self.scheme, None, None, None)[0]

    def initial_step(self) -> Step:
        """Return the initial state by Python, with the law applied where v0 is not in the tangent cone."""
        found = initial_step(self.problem, self._projector)
        self._go_on(found)
        return found

    def python_step(self, k: int) -> Step:
        """Take step number k by Python."""
        memory, problem = self.step.memory, self.problem
        self._state.leave()
        self._projector.take_back(memory.percussion, memory.start, memory.size)
        t, q, v = problem.t0 + (k - 1) * self.h, self.q.copy(), self.v.copy()
        new = self.scheme.step(problem, t, q, v, self.h, self._projector)
        if not (v.dot(v) < self.guard.limit and new.v.dot(new.v) < self.guard.limit):
            before = Step(t, q, v, problem.constraints.empty, NO_RATES, 0.0)
            *_, new = self.guard.followed(t, before, new, self.h, self._projector)
        self._go_on(new)
        return new

    def _go_on(self, step: Step) -> None:
        """Let kernels go on from a state."""
        self.q[:], self.v[:] = step.q, step.v
        self._state.enter()
        memory = self.step.memory
        self._projector.lend(memory.percussion, memory.start, memory.size)

"""Schemes that are given as a kernel alone: the compiled loop takes their steps, and single ones are taken here."""

from __future__ import annotations

from contextlib import nullcontext
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from ...compiled import held
from ...constraints import Rows
from ...constraints.mechanism.state import MechanismState
from ...constraints.mechanism.tables import MOST_ROWS, TOO_MANY, UNRESOLVED
from ...constraints.tangents import Tangents
from ...errors import ProjectionError, UnsuitableError
from ...problem import Problem
from ...projection import Projector
from ...schemes import Scheme, Step, Timing
from ...schemes.kernels.records import DONE, UNSOLVED, MechanismStep
from ...system.mechanisms.joined import joined
from ...system.system import Array
from .callbacks import python_callbacks
from .loop_scope import is_compiled
from .made_records import mechanism_step

_REASONS = {
    TOO_MANY: f"more than {MOST_ROWS} rows are active",
    UNRESOLVED: "shapes near each other have more contacts than there is room for",
    UNSOLVED: "its law is not solved",
}


class KernelScheme(Scheme):
    """A scheme whose step is a kernel, for mechanisms and a few free bodies.

    Parameters
    ----------
    kernel : callable
        A function marked by `mbvi.compiled.kernel("i8(MechanismStep, f8, f8[::1], f8[::1], f8)")`: it takes a
        `MechanismStep`, t [s], q, v and h [s], writes the state after the step to it, and returns `DONE` or what a
        phase returned instead.
    timing : Timing, optional
        Where in its step the velocity jumps; by default at the end.
    """

    def __init__(self, kernel: Any, timing: Timing | None = None) -> None:
        self.kernel, self.timing = kernel, Timing() if timing is None else timing
        # of each run what takes its single steps
        self._made: WeakKeyDictionary[Projector, _OneStep] = WeakKeyDictionary()

    def __reduce__(self) -> tuple[type, tuple[Any, Timing]]:
        """Leave out what takes steps."""
        return type(self), (self.kernel, self.timing)

    @property
    def name(self) -> str:
        """The name of the kernel."""
        return str(self.kernel.__name__)

    @property
    def step_kernel(self) -> Any:
        """The kernel; see `Scheme`."""
        return self.kernel

    def check(self, problem: Problem) -> None:
        """See `Scheme`."""
        if not is_compiled(problem, self):
            raise UnsuitableError(f"{self.name} is a kernel, which takes mechanisms and a few free bodies")

    def step(self, problem: Problem, t: float, q: Array, v: Array, h: float, projector: Projector) -> Step:
        """See `Scheme`.

        Raises
        ------
        ProjectionError
            If the kernel does not take the step; `problem` is empty then.
        """
        made = self._made.get(projector)
        if made is None or made.problem is not problem:
            made = self._made[projector] = _OneStep(problem, self, projector.residual)
        return made.take(t, q, v, h, projector)


class _OneStep:
    """Single steps of a problem by a kernel."""

    def __init__(self, problem: Problem, scheme: KernelScheme, residual: float) -> None:
        mechanism = joined(problem.system).mechanism()
        if mechanism is None:
            raise UnsuitableError(f"{scheme.name} is a kernel, but Pinocchio cannot be called by address here")
        self.problem = problem
        self._state, self._kernel = MechanismState(problem.constraints), scheme.kernel
        self._callbacks = python_callbacks(problem, self._state)
        self._step = mechanism_step(problem, scheme, residual, mechanism, self._state, self._callbacks)
        self._held, self._none = held(self._step), problem.constraints.empty

    def take(self, t: float, q: Array, v: Array, h: float, projector: Projector) -> Step:
        """Return the state at t + h."""
        step, memory = self._step, self._step.memory
        if not self._state.enter():
            raise UnsuitableError("the caches of this problem are not those of kernels")
        projector.lend(memory.percussion, memory.start, memory.size)
        step.at_end[0] = False
        with nullcontext() if self._callbacks is None else self._callbacks.interruptible():
            code = self._kernel(self._held, t, q.copy(), v.copy(), h)
        self._state.leave()
        if self._callbacks is not None:
            self._callbacks.check()
        m = step.rows.size[0]
        if code != DONE:
            why = _REASONS.get(code, f"it returned {code}")
            raise ProjectionError(f"the kernel of the step did not take it, at {m} rows: {why}", {})
        projector.take_back(memory.percussion, memory.start, memory.size)
        rates = step.rates[: 4 * m].reshape(4, m).copy()
        slip = step.slip[: 8 * m].reshape(4, m, 2).copy() if len(step.slip) else None
        if slip is not None and len(step.turn):
            slip = np.concatenate([slip, step.turn[: 12 * m].reshape(4, m, 3)], axis=2)
        active = rows_of(step) if m else self._none
        slip, at_end = slip if m else None, step.at_end.item(0)
        return Step(t + h, step.q.copy(), step.v.copy(), active, rates, step.residual.item(0), slip, at_end=at_end)


def rows_of(step: MechanismStep) -> Rows:
    """Return copies of the rows of a step."""
    rows, m = step.rows, step.rows.size[0]
    tangents = Tangents(rows.mu[:m].copy(), rows.axes[:m].copy(), rows.T[: 2 * m].copy(), None) if len(rows.T) else None
    if tangents is not None and len(rows.R):
        T, R = rows.T[: 2 * m].reshape(m, 2, -1), rows.R[: 3 * m].reshape(m, 3, -1)
        wide = np.concatenate([T, R], axis=1).reshape(5 * m, -1)
        tangents = tangents._replace(jacobian=wide, resistance=rows.resistance[:m].copy())
    return Rows(
        rows.number[:m].copy(), rows.gap[:m].copy(), rows.J[:m].copy(), rows.e[:m].copy(), rows.point[:m].copy(),
        rows.normal[:m].copy(), None, tangents,
    )  # fmt: skip

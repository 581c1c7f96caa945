"""The work of `rollout`: by the compiled loop on several threads, or by `simulate` one after the other."""

from __future__ import annotations

import threading
from enum import IntEnum
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from ...arguments import LARGEST
from ...constraints import AdmissibleSet, Rows
from ...errors import DivergedError, InadmissibleStartError, InputError, MbviError, ProjectionError
from ...problem import Problem
from ...schemes import MoreauJean, Paoli, Scheme
from ...system.controls import HeldTorque
from ...system.system import Array
from ..accuracy import projector_of
from ..loop.mechanism_run import MechanismRun, OwnProblem
from ..simulate import simulate
from ..sleeping import Sleepers

# parts of the rollouts for each thread, so that none has nothing to do for long
_PARTS = 4
# deviation of a norm from 1 above which `Problem.at` decides whether a quaternion is of unit length
_NEARLY_UNIT = 1e-7
# copies of problems that no rollout uses now, by the constraints of the original
_idle: WeakKeyDictionary[AdmissibleSet, list[OwnProblem]] = WeakKeyDictionary()


class RolloutStatus(IntEnum):
    """How a rollout ended.

    `COMPLETE`: all its steps are taken. `INVALID`: its initial state is none, and nothing is computed. `DIVERGED`: its
    velocities ran away. `UNSOLVED`: a projection did not reach the residual. `FAILED`: another error.
    """

    COMPLETE = 0
    INVALID = 1
    DIVERGED = 2
    UNSOLVED = 3
    FAILED = 4


class Job:
    """Rollouts that are being computed.

    Parameters
    ----------
    problem : Problem
        The problem.
    acting : Problem
        The same, or a copy with another control.
    scheme : Scheme
        Takes the steps.
    q0, v0 : ndarray, shapes (n, nq) and (n, nv)
        Initial states, of which any may be invalid.
    steps, h : int and float
        Number and length of the steps [s].

    Attributes
    ----------
    q, v, status, errors
        See `Rollouts`.
    """

    def __init__(
        self, problem: Problem, acting: Problem, scheme: Scheme, q0: Array, v0: Array, steps: int, h: float
    ) -> None:
        n = len(q0)
        self.problem, self.acting, self.scheme, self.h = problem, acting, scheme, h
        self.control = getattr(acting.system, "control", None)
        self.q0, self.v0, self.steps = q0, v0, steps
        self.q, self.v = np.empty((n, steps + 1, q0.shape[1])), np.empty((n, steps + 1, v0.shape[1]))
        self.status = np.zeros(n, np.int64)
        self.errors: list[Exception | None] = [None] * n
        # schemes that evaluate forces at the end of their steps
        self.at_end = isinstance(scheme, Paoli | MoreauJean) and scheme.timing.jump == 1.0
        self._check_states()

    def _check_states(self) -> None:
        """Find the initial states that `Problem.at` refuses."""
        with np.errstate(invalid="ignore", over="ignore"):
            fits = (np.abs(self.q0) <= LARGEST).all(axis=1) & (np.abs(self.v0) <= LARGEST).all(axis=1)
            for group in self.problem.system.unit_groups():
                size = np.linalg.norm(self.q0[:, group], axis=2)
                fits &= (np.abs(size - 1.0) < _NEARLY_UNIT).all(axis=1)
        for i in np.flatnonzero(~fits).tolist():
            try:
                self.problem.at(self.q0[i], self.v0[i])
            except MbviError as error:
                self.fail(i, 0, error)

    def fail(self, i: int, done: int, error: Exception) -> None:
        """End a rollout of which the first states are known."""
        self.q[i, done:], self.v[i, done:] = np.nan, np.nan
        self.status[i], self.errors[i] = _status_of(error, done), error

    def valid(self) -> Array:
        """Return the rollouts in which nothing has failed yet."""
        return np.flatnonzero(self.status == RolloutStatus.COMPLETE)

    def resting(self) -> Array:
        """Return the complete rollouts in which all bodies have come to rest, and sleep in `simulate`."""
        projector, _ = projector_of(self.acting, self.scheme, None, None, None, self.h)
        sleepers, complete = Sleepers(self.acting, self.h, projector), self.valid()
        if not sleepers.watched:
            return complete[:0]
        return complete[[bool(sleepers.all_still(self.v[i, 1:]).any()) for i in complete.tolist()]]

    def run_by_simulate(self, which: Array) -> None:
        """Run some rollouts by `simulate`, one after the other."""
        problem, most = self.acting, deepest(self.acting)
        for i in which.tolist():
            start, control = problem.at(self.q0[i], self.v0[i], problem.t0), self.control
            if isinstance(control, HeldTorque):
                control.begin(i, problem.t0, self.h, self.at_end)
            try:
                start.constraints.renew()
                check_depth(start, start.constraints.active(start.t0, start.q0, start.tolerance), most)
                run = simulate(start, self.scheme, step=self.h, duration=self.steps * self.h, progress=False)
            except Exception as error:
                before, done = getattr(error, "run", None), 0
                if before is not None:
                    done = len(before.t)
                    self.q[i, :done], self.v[i, :done] = before.q, before.v
                self.fail(i, done, error)
            else:
                self.q[i], self.v[i] = run.q, run.v

    def run_compiled(self, threads: int) -> bool:
        """Run all rollouts by the compiled loop; return False if that cannot be."""
        idle = _idle.setdefault(self.problem.constraints, [])
        own = [idle.pop() if idle else OwnProblem(self.problem) for _ in range(max(1, min(threads, len(self.q0))))]
        if any(one.mechanism is None for one in own):
            return False
        workers, parts, failed = [_Worker(self, one) for one in own], iter(self._parts(len(own))), list[BaseException]()

        def work(worker: _Worker) -> None:
            try:
                for first, end in parts:
                    if failed:
                        return
                    worker.run(first, end)
            except BaseException as error:
                failed.append(error)

        others = [threading.Thread(target=work, args=(worker,)) for worker in workers[1:]]
        for thread in others:
            thread.start()
        for worker in workers[:1]:
            work(worker)
        try:
            for thread in others:
                thread.join()
        except BaseException as error:
            failed.append(error)
            raise
        if failed:
            raise failed[0]
        idle += own
        return True

    def _parts(self, threads: int) -> list[tuple[int, int]]:
        """Return the first rollout and that after the last of each part."""
        n = len(self.q0)
        size = max(1, -(-n // (_PARTS * threads)))
        return [(first, min(first + size, n)) for first in range(0, n, size)]


class _Begun(NamedTuple):
    """What rollouts from one configuration begin with: rows there, and what the constraints hold after their query."""

    q: bytes
    rows: Rows
    memory: list[Array]
    kept: list[Any]


class _Worker:
    """Computes rollouts on one thread."""

    def __init__(self, job: Job, own: OwnProblem) -> None:
        self._job, self._deepest = job, deepest(own.problem)
        given, control = job.problem, job.control
        own.set_control(control.copy() if isinstance(control, HeldTorque) else control)
        own.problem = own.problem.at(given.q0, given.v0, given.t0)
        self._problem, self._control, self._memory = own.problem, own.control, own.state.memory
        self._run = MechanismRun(own, job.scheme, job.h, job.steps + 1)
        self._begun: _Begun | None = None

    def run(self, first: int, end: int) -> None:
        """Compute rollouts `first` to `end` - 1."""
        for i in range(first, end):
            if self._job.status[i] == RolloutStatus.COMPLETE:
                done = [0]
                try:
                    self._roll(i, done)
                except Exception as error:
                    self._job.fail(i, done[0], error)

    def _roll(self, i: int, done: list[int]) -> None:
        """Compute one rollout; `done` receives how many states are known."""
        job, run = self._job, self._run
        if isinstance(self._control, HeldTorque):
            self._control.begin(i, self._problem.t0, job.h, job.at_end)
        self._begin(i)
        q, v = job.q[i], job.v[i]
        q[0], v[0], done[0] = run.q, run.v, 1
        while done[0] <= job.steps:
            done[0] = run.take(done[0], job.steps + 1, q, v)

    def _begin(self, i: int) -> None:
        """Go to the initial state of a rollout, as one before did if it began at the same configuration."""
        run, begun, constraints = self._run, self._begun, self._problem.constraints
        q, v = self._job.q0[i], self._job.v0[i]
        run.start(self._problem)
        if begun is not None and begun.q == q.tobytes():
            for array, saved in zip(self._memory, begun.memory, strict=True):
                array[:] = saved
            constraints.kept = begun.kept
            run.begin_with(q, v, begun.rows)
            return
        run.start(self._problem.at(q, v, self._problem.t0))
        rows = run.initial_step().active
        check_depth(run.problem, rows, self._deepest)
        self._begun = _Begun(q.tobytes(), rows, [array.copy() for array in self._memory], constraints.kept)


def deepest(problem: Problem) -> Array:
    """Return how deep each contact may be at the start [m]: as its bodies are thick, at most the scene's length."""
    each = [np.broadcast_to(family.thickness, (family.size,)) for family in problem.constraints.families]
    return np.minimum(np.concatenate([np.zeros(0), *each]), problem.length)


def check_depth(problem: Problem, rows: Rows, most: Array) -> None:
    """Raise `InadmissibleStartError` if a contact is deeper than `deepest` allows."""
    depth = -rows.gap * problem.constraints.levers(rows.constraint)
    buried = np.flatnonzero(depth > most[rows.constraint])
    if buried.size:
        name = problem.constraints.name(int(rows.constraint[buried[0]]))
        raise InadmissibleStartError(
            f"{name} penetrates by {depth[buried[0]]:.6g}, more than the size of the bodies; move them apart"
        )


def _status_of(error: Exception, done: int) -> RolloutStatus:
    """Return how a rollout ended that an error ended, after some states."""
    if done == 0 and isinstance(error, InputError | InadmissibleStartError):
        return RolloutStatus.INVALID
    if isinstance(error, DivergedError):
        return RolloutStatus.DIVERGED
    return RolloutStatus.UNSOLVED if isinstance(error, ProjectionError) else RolloutStatus.FAILED

"""The work of `rollout`: by the compiled loop on several threads, or by `simulate` one after the other."""

from __future__ import annotations

import threading
from enum import IntEnum
from weakref import WeakKeyDictionary

import numpy as np

from ..arguments import LARGEST
from ..compiled import compile_kernel
from ..constraints import AdmissibleSet, Rows
from ..constraints.mechanism_rows import copy_memory
from ..constraints.mechanism_tables import MOST_ROWS
from ..errors import DivergedError, InadmissibleStartError, InputError, MbviError, ProjectionError
from ..problem import Problem
from ..schemes import MoreauJean, Paoli, Scheme, Step
from ..system.controls import HeldTorque
from ..system.system import Array
from .mechanism_run import MechanismRun, OwnProblem
from .rollout_loop import Batch, run_rollouts
from .simulate import simulate
from .step_loop import DONE

# steps that a thread takes before it looks for an interrupt
_MOST_STEPS = 20_000
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
        As of `Rollouts`.
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
        self.status[i], self.errors[i] = _status_of(error), error

    def run_by_simulate(self) -> None:
        """Run one rollout after the other by `simulate`."""
        problem, thick = self.acting, thickness(self.acting)
        for i in np.flatnonzero(self.status == RolloutStatus.COMPLETE).tolist():
            start, control = problem.at(self.q0[i], self.v0[i], problem.t0), self.control
            if isinstance(control, HeldTorque):
                control.begin(i, problem.t0, self.h, self.at_end)
            try:
                start.constraints.renew()
                check_depth(start, start.constraints.active(start.t0, start.q0, start.tolerance), thick)
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
        own = [idle.pop() if idle else OwnProblem(self.problem) for _ in range(min(threads, len(self.q0)))]
        if any(one.mechanism is None for one in own):
            return False
        # the main thread compiles, since others could not hold interrupts back
        compile_kernel(run_rollouts)
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
        size = max(1, min(-(-n // (_PARTS * threads)), _MOST_STEPS // self.steps))
        return [(first, min(first + size, n)) for first in range(0, n, size)]


class _Worker:
    """Computes rollouts on one thread."""

    def __init__(self, job: Job, own: OwnProblem) -> None:
        self._job, self._thickness = job, thickness(own.problem)
        given, control = job.problem, job.control
        own.set_control(control.copy() if isinstance(control, HeldTorque) else control)
        if isinstance(own.control, HeldTorque):
            own.control.begin(0, given.t0, job.h, job.at_end)
        own.problem = own.problem.at(given.q0, given.v0, given.t0)
        self._run = run = MechanismRun(own, job.scheme, job.h, job.steps + 1)
        self._problem, self._state = own.problem, own.state
        own.problem.constraints.renew()
        # False in copies of problems: nothing is known of their distances, and rollouts begin in Python
        self._known = own.state.enter()
        nv, nq, least = len(run.v), len(run.q), float(self._thickness.min(initial=np.inf))
        self._batch = Batch(
            job.q0, job.v0, job.q, job.v, job.status == RolloutStatus.COMPLETE, run.q, run.v,
            least if self._known else -np.inf, own.state.copy(), own.state.copy(), np.full(1, -1), np.zeros(nq),
            np.zeros((MOST_ROWS, nv)),
        )  # fmt: skip
        # the rollout of which Python took the last step
        self._rollout = -1

    def run(self, first: int, end: int) -> None:
        """Compute rollouts `first` to `end` - 1."""
        run, job, i, k = self._run, self._job, first, 0
        while i < end:
            i, k, code = run_rollouts(
                run.step, run.log, self._batch, run.kind, i, k, end, self._problem.t0, job.h, job.steps,
                run.guard.limit, run.still,
            )  # fmt: skip
            if code == DONE:
                return
            k = self._by_python(i, k)
            if k > job.steps:
                i, k = i + 1, 0

    def _by_python(self, i: int, k: int) -> int:
        """Take step k of a rollout, or bring it to its initial state if that is 0; return the next step."""
        job, run = self._job, self._run
        try:
            if i != self._rollout:
                self._rollout = i
                run.start(self._problem.at(job.q0[i], job.v0[i], self._problem.t0))
                self._problem.constraints.forget_kept()
            new = run.python_step(k) if k else self._begin(i)
        except Exception as error:
            job.fail(i, k, error)
            return job.steps + 1
        job.q[i, k], job.v[i, k] = new.q, new.v
        return k + 1

    def _begin(self, i: int) -> Step:
        """Return the initial state; let other rollouts from the same configuration begin as this one."""
        found, batch = self._run.initial_step(), self._batch
        rows = found.active
        check_depth(self._run.problem, rows, self._thickness)
        m = len(rows.gap)
        batch.rows[0] = -1
        if m <= MOST_ROWS and found.v.tobytes() == self._job.v0[i].tobytes():
            batch.rows[0], batch.begun_q[:] = m, found.q
            batch.begun_J[:m] = rows.jacobian
            copy_memory(self._state.arrays, batch.begun)
        return found


def thickness(problem: Problem) -> Array:
    """Return the thickness of the bodies of each constraint [m], infinite where there is none."""
    each = [np.broadcast_to(family.thickness, (family.size,)) for family in problem.constraints.families]
    return np.concatenate([np.zeros(0), *each])


def check_depth(problem: Problem, rows: Rows, thick: Array) -> None:
    """Raise `InadmissibleStartError` if a contact is deeper than its bodies are thick."""
    depth = -rows.gap * problem.constraints.levers(rows.constraint)
    buried = np.flatnonzero(depth > thick[rows.constraint])
    if buried.size:
        name = problem.constraints.name(int(rows.constraint[buried[0]]))
        raise InadmissibleStartError(
            f"{name} penetrates by {depth[buried[0]]:.6g}, more than the bodies are thick; move them apart"
        )


def _status_of(error: Exception) -> RolloutStatus:
    """Return how a rollout ended that an error ended."""
    kinds = {
        InputError: RolloutStatus.INVALID,
        InadmissibleStartError: RolloutStatus.INVALID,
        DivergedError: RolloutStatus.DIVERGED,
        ProjectionError: RolloutStatus.UNSOLVED,
    }
    return next((status for kind, status in kinds.items() if isinstance(error, kind)), RolloutStatus.FAILED)

"""Runs `Adaptive`: records its steps with cubics between their states, and the impacts between them."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from ...problem import Problem
from ...projection import Projector
from ...results.run_data import Array
from ...results.trajectory import Trajectory
from ...schemes import Adaptive, Centered, Step
from ...schemes.adaptive.cubic import POWERS, cubic
from ...schemes.adaptive.integrator import AdaptiveIntegrator, Counts, Stop, Stride, Strike
from ...schemes.event_driven.runge_kutta import DEGREE
from ...schemes.observer import contacts_of_step
from ..accuracy import residual_note
from ..fixed_steps.switching import SwitchedRecorder, Switching, switch_connections
from ..recording.impact_rows import RecentPercussions
from ..recording.recorder import RECENT
from ..start import initial_step
from ..tunnelling import TunnellingGuard
from .located import LocatedSwitches
from .recorded import recorded

# states for which there is room at first
_ROOM = 64
# arrays of a recorder that grow
_COLUMNS = "t", "q", "v", "penetration", "limit_violation", "residual"


class _AdaptiveRecorder(SwitchedRecorder):
    """States, cubics between them and impacts of a run of `Adaptive`.

    A located impact has two states, before and after it. One step in `every` is recorded, and in any case the last one
    and those that end at located impacts. Impacts that are not located are within a step.
    """

    impacts_apart = True

    def __init__(self, problem: Problem, every: int, notes: Sequence[str], contacts: bool) -> None:
        super().__init__(problem, _ROOM, Adaptive.timing, notes, contacts)
        self.timing_of_rows = Centered.timing
        self._every, self._since = every, 0
        self._cubics: list[Array] = []
        self.dense = self._cubics

    def add(self, part: Stride | Strike) -> None:
        """Record an accepted step or an impact."""
        self._make_room()
        if isinstance(part, Stride):
            self.step(part.first, False)
            self.step(part.second, False)
            self._since += 1
            if self._since >= self._every:
                self.keep()
            return
        self.keep()
        self._make_room()
        # percussions of impacts belong to no interval of time, and what rows carried before has no part in them
        log, recent, loaded = self.contacts, self.recent, part.step.percussion > 0.0
        self.contacts, self.recent, self.last = None, RecentPercussions(RECENT), None
        self.step(part.step, False)
        recent.add(part.step.active.constraint, part.step.percussion, loaded)
        self.contacts, self.recent, self._since = log, recent, 1
        self.keep()

    def keep(self) -> None:
        """Record the state after the last step, if it is not recorded yet."""
        if not self._since or self.last is None:
            return
        k, (t, q, v) = self.count, self.last[:3]
        if self.contacts is not None:
            self.contacts.close()
        last = self.count - 1
        dense = np.zeros((2, len(v), DEGREE))
        dense[:, :, : len(POWERS)] = cubic(self.problem.system, t - self.t[last], (self.q[last], self.v[last]), (q, v))
        self._cubics.append(dense)
        self.t[k], self.q[k], self.v[k] = t, q, v
        self.count, self._since = k + 1, 0

    def switched(self, problem: Problem, connections: dict[str, bool], before: Step, after: Step) -> None:
        """Go on with a problem; see `SwitchedRecorder.switched`."""
        self._make_room()
        super().switched(problem, connections, before, after)
        self._since = 0

    def trim(self) -> None:
        """Cut the arrays to the recorded states."""
        for name in _COLUMNS:
            setattr(self, name, getattr(self, name)[: self.count])

    def _make_room(self) -> None:
        if self.count < len(self.t):
            return
        for name in _COLUMNS:
            old = getattr(self, name)
            new = np.zeros((2 * len(old), *old.shape[1:]))
            new[: len(old)] = old
            setattr(self, name, new)


def run_adaptive(
    problem: Problem,
    scheme: Adaptive,
    duration: float,
    every: int,
    projector: Projector,
    notes: Sequence[str],
    out: str | os.PathLike[str] | None,
    progress: bool | None,
    contacts: bool = False,
    switching: Switching | None = None,
    projector_for: Callable[[Problem], Projector] | None = None,
) -> Trajectory:
    """Run a problem with `Adaptive`; see `simulate`.

    Where connections are switched, by `switching`, the run goes on with another problem and the projector for it.
    """
    record = _AdaptiveRecorder(problem, every, notes, contacts)
    state = initial_step(problem, projector)
    record.step(state, True)
    so_far, end = partial(record.trajectory, scheme, 0.0, complete=False), problem.t0 + duration
    switches, counts = None if switching is None else LocatedSwitches(switching, problem.t0, duration), Counts()
    with recorded(problem, scheme, duration, record, so_far, out, progress) as poll:
        now = problem
        if switches is not None:
            switches.at(state.t, state.q, state.v, partial(contacts_of_step, state, 0.0, problem.constraints.name))
        while True:
            connections = {} if switches is None else switches.take()
            if connections:
                assert switches is not None and projector_for is not None
                now, projector, state = switch_connections(
                    now, connections, state.t, state, scheme, projector_for, record
                )
                switches.begin(state.t, state.q, state.v)
            stop = None if switches is None else partial(_stop, switches, now)
            integrator, observe = guarded_integrator(now, scheme, projector, state, stop)
            integrator.counts = counts
            for part in integrator.run(end - state.t):
                record.add(part)
                if observe is not None and isinstance(part, Stride):
                    observe(part.second, part.second.t - part.first.t)
                poll(integrator.t)
                if switches is not None and switches.found is None and isinstance(part, Strike):
                    name, at = now.constraints.name, part.step
                    if switches.at(at.t, at.q, at.v, partial(contacts_of_step, at, 0.0, name)):
                        break
            record.keep()
            counts = integrator.counts
            if switches is None or switches.found is None:
                break
            assert record.last is not None
            record.t[record.count - 1] = switches.found.time
            state = record.last._replace(t=switches.found.time)
        record.trim()
        record.t[-1] = end
        record.notes += _notes(counts) + residual_note(projector)
    return record.trajectory(scheme, 0.0)


def guarded_integrator(
    problem: Problem, scheme: Adaptive, projector: Projector, start: Step, stop: Stop | None
) -> tuple[AdaptiveIntegrator, Callable[[Step, float], None] | None]:
    """Return an integrator with a tunnelling guard, and the observer of its steps, if a control reads contacts."""
    guard = TunnellingGuard(problem, Centered(project_positions=True), 1.0)
    if guard.observe is not None and start.percussion.any():
        guard.observe(start, 0.0)
    return scheme.integrator(problem, projector, start, guard.passed, stop), guard.observe


def _stop(switches: LocatedSwitches, problem: Problem, stride: Stride) -> float | None:
    """Return the time within a step at which connections are switched, None if none are."""
    t0, q0, v0, first, (t, q, v, *_) = stride
    system, h = problem.system, t - t0
    dense = cubic(system, h, (q0, v0), (q, v))

    def at(time: float) -> tuple[Array, Array]:
        dq, dv = h * (dense @ ((time - t0) / h) ** POWERS)
        return system.integrate(q0, dq), v0 + dv

    return switches.along(t0, t, at, partial(contacts_of_step, stride.second, t - first.t, problem.constraints.name))


def _notes(counts: Counts) -> list[str]:
    """Return what the notes of a run say of its steps."""
    found = [
        f"{counts.steps} steps were accepted and {counts.rejected} rejected, each of three evaluations; "
        f"{counts.located} impacts were located"
    ]
    if counts.floor + counts.floor_impacts:
        found.append(
            f"{counts.floor + counts.floor_impacts} steps were accepted at the shortest length, {counts.floor} of them "
            f"without an impact, the longest of {counts.longest_floor:.1e} s: the tolerance is not kept from "
            f"t = {counts.first_floor:.6g} s on"
        )
    return found

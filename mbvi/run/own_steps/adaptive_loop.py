"""Runs `Adaptive`: records its steps with cubics between their states, and the impacts between them."""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import partial

import numpy as np

from ...problem import Problem
from ...projection import Projector
from ...results.run_data import Array
from ...results.trajectory import Trajectory
from ...schemes import Adaptive, Centered
from ...schemes.adaptive.integrator import Counts, Stride, Strike
from ...schemes.event_driven.runge_kutta import DEGREE
from ..accuracy import residual_note
from ..recorder import Recorder
from ..start import initial_step
from ..tunnelling import TunnellingGuard
from .recorded import recorded

# states for which there is room at first
_ROOM = 64
# arrays of a recorder that grow
_COLUMNS = "t", "q", "v", "penetration", "limit_violation", "residual"


class _AdaptiveRecorder(Recorder):
    """States, cubics between them and impacts of a run of `Adaptive`.

    A located impact has two states, before and after it. One step in `every` is recorded, and in any case the last one
    and those that end at located impacts.
    """

    def __init__(self, problem: Problem, every: int, notes: Sequence[str], contacts: bool) -> None:
        super().__init__(problem, _ROOM, Adaptive.timing, notes, contacts)
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
        # percussions of impacts belong to no interval of time
        log, self.contacts = self.contacts, None
        self.step(part.step, False)
        self.contacts, self._since = log, 1
        self.keep()

    def keep(self) -> None:
        """Record the state after the last step, if it is not recorded yet."""
        if not self._since or self.last is None:
            return
        k, (t, q, v) = self.count, self.last[:3]
        if self.contacts is not None:
            self.contacts.close()
        self._cubics.append(self._cubic(t, q, v))
        self.t[k], self.q[k], self.v[k] = t, q, v
        self.count, self._since = k + 1, 0

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

    def _cubic(self, t: float, q: Array, v: Array) -> Array:
        """Return the cubic of q from the last recorded state to another, with the velocities at both ends, and of v."""
        system, last, dense = self.problem.system, self.count - 1, np.zeros((2, self.problem.system.nv, DEGREE))
        h, start = t - self.t[last], self.v[last]
        if h <= 0.0:
            return dense
        displacement = system.difference(self.q[last], q)
        end, mean = system.chart_rate(self.q[last], displacement, v), displacement / h
        dense[0, :, :3] = np.stack([start, 3.0 * mean - 2.0 * start - end, start + end - 2.0 * mean], axis=1)
        # the rate of that cubic; what the chart turns is added evenly
        dense[1, :, 0] = (2.0 * dense[0, :, 1] + v - end) / h
        dense[1, :, 1] = 3.0 * dense[0, :, 2] / h
        return dense


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
) -> Trajectory:
    """Run a problem with `Adaptive`; see `simulate`."""
    record = _AdaptiveRecorder(problem, every, notes, contacts)
    state = initial_step(problem, projector)
    record.step(state, True)
    guard = TunnellingGuard(problem, Centered(project_positions=True), 1.0)
    observe = guard.observe
    if observe is not None and state.percussion.any():
        observe(state, 0.0)
    so_far = partial(record.trajectory, scheme, 0.0, complete=False)
    with recorded(problem, scheme, duration, record, so_far, out, progress) as poll:
        integrator = scheme.integrator(problem, projector, state, guard.passed)
        for part in integrator.run(duration):
            record.add(part)
            if observe is not None and isinstance(part, Stride):
                observe(part.second, part.second.t - part.first.t)
            poll(integrator.t)
        record.keep()
        record.trim()
        record.t[-1] = problem.t0 + duration
        record.notes += _notes(integrator.counts) + residual_note(projector)
    return record.trajectory(scheme, 0.0)


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

"""The loop of schemes that choose their own steps and locate impacts between them."""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import partial
from time import perf_counter

import numpy as np

from ..problem import Problem
from ..projection import Projector
from ..results.contacts import ContactLog
from ..results.hdf5 import Writer
from ..results.run_data import Array, Impact, RunRecord
from ..results.trajectory import Trajectory
from ..schemes import EventDriven
from ..schemes.event_driven.impact_event import ImpactEvent
from ..schemes.event_driven.integrator import EventDrivenIntegrator
from ..schemes.event_driven.reactions import reactions
from ..schemes.event_driven.runge_kutta import DEGREE, RungeKuttaStep
from .interrupted import run_so_far
from .progress import Progress

_TICKS = 1000
_POWERS = np.arange(1, DEGREE + 1)


class _Record:
    """States, dense output and impacts of a run; an instant at which v jumps has two states.

    Of the smooth steps every so many are kept, those before an impact, and the last.
    """

    # the law acts at recorded states
    timing = EventDriven.timing

    def __init__(self, problem: Problem, every: int, notes: Sequence[str], contacts: ContactLog | None = None) -> None:
        self._problem, self._every = problem, every
        self.contacts = contacts
        if contacts is not None:
            contacts.close()
        self.t, self.q, self.v = [problem.t0], [problem.q0], [problem.v0]
        self.dense: list[Array] = []
        self.penetration, self.residual = [0.0], [0.0]
        self.impacts: list[Impact] = []
        self.notes = list(notes)
        self._no_motion = np.zeros((2, problem.system.nv, DEGREE))
        # the steps since the last state kept, the first and the last of them, and where that led
        self._since, self._worst = 0, 0.0
        self._first: RungeKuttaStep | None = None
        self._last: tuple[RungeKuttaStep, float, Array, Array, float] | None = None

    @property
    def count(self) -> int:
        """How many states are kept."""
        return len(self.t)

    def stride(self, stride: RungeKuttaStep, walk: EventDrivenIntegrator) -> None:
        """Keep a step and the state it led to, of which the drift of closed contacts was taken."""
        self._since += 1
        self._first = self._first or stride
        if self.contacts is not None:
            for rows in reactions(walk, stride):
                self.contacts.add(*rows)
        self._last = stride, walk.t, walk.q, walk.v, walk.depth
        self._worst = max(self._worst, walk.residual)
        if self._since >= self._every:
            self.keep()

    def keep(self) -> None:
        """Keep the state that the last step led to, unless it is."""
        if self._last is None or self._first is None:
            return
        stride, t, q, v, depth = self._last
        dense = stride.dense if self._since == 1 else self._joined(self._first, stride, t, q, v)
        self._state(t, q, v, depth, dense)

    def _joined(self, first: RungeKuttaStep, last: RungeKuttaStep, t: float, q: Array, v: Array) -> Array:
        """Return the cubics from the last state kept to (q, v) that have the rates of both ends."""
        system, h, v0 = self._problem.system, t - self.t[-1], self.v[-1]
        if h <= 0.0:
            return self._no_motion
        way = system.difference(self.q[-1], q)
        ends = np.array([[v0, system.chart_rate(self.q[-1], way, v)], [first.dense[1, :, 0], last.dense[1] @ _POWERS]])
        gone = np.array([way, v - v0]) / h
        start, end = ends[:, 0], ends[:, 1]
        dense = np.zeros_like(self._no_motion)
        dense[:, :, :3] = np.stack([start, 3 * gone - 2 * start - end, start + end - 2 * gone], axis=2)
        return dense

    def struck(self, struck: ImpactEvent, walk: EventDrivenIntegrator) -> None:
        """Keep an impact and the states before and after it."""
        self.keep()
        self._worst = walk.residual
        self._state(struck.t, struck.q, struck.after, walk.depth, self._no_motion)
        percussion, before, after = struck.rates
        taking_part = percussion > 0.0
        metric = self._problem.system.metric(struck.q)
        jump, mean = struck.after - struck.before, struck.after + struck.before
        names = map(self._problem.constraints.name, struck.number[taking_part].tolist())
        self.impacts.append(
            Impact(
                struck.t,
                tuple(names),
                percussion[taking_part],
                before[taking_part],
                after[taking_part],
                struck.point[taking_part],
                struck.normal[taking_part],
                0.5 * float(jump @ metric.apply(mean)),
            )
        )

    def _state(self, t: float, q: Array, v: Array, depth: float, dense: Array) -> None:
        if self.contacts is not None:
            self.contacts.close()
        self.dense.append(dense)
        self.t.append(t)
        self.q.append(q)
        self.v.append(v)
        self.penetration.append(depth)
        self.residual.append(self._worst)
        self._since, self._worst, self._first, self._last = 0, 0.0, None, None

    def trajectory(self, scheme: EventDriven, *, complete: bool) -> Trajectory:
        """Return what was recorded."""
        # an interrupt can come between two of these
        n = min(len(self.t), len(self.q), len(self.v), len(self.penetration), len(self.residual))
        return Trajectory(
            np.array(self.t[:n]),
            np.array(self.q[:n]),
            np.array(self.v[:n]),
            tuple(self.impacts),
            np.array(self.residual[:n]),
            scheme.name,
            0.0,
            tuple(self.notes),
            self._problem,
            complete,
            RunRecord(
                np.array(self.penetration[:n]),
                scheme,
                self.timing,
                np.array(self.dense[: n - 1]).reshape(-1, 2, self._problem.system.nv, DEGREE),
                contacts=None if self.contacts is None else self.contacts.table(self._problem.constraints.name, n),
            ),
        )


def run_event_driven(
    problem: Problem,
    scheme: EventDriven,
    duration: float,
    every: int,
    projector: Projector,
    notes: Sequence[str],
    out: str | os.PathLike[str] | None,
    progress: bool | None,
    contacts: bool = False,
) -> Trajectory:
    """Run a problem with a scheme that locates impacts; see `simulate`."""
    # while a contact stays closed it is one, however far it slides
    record = _Record(problem, every, notes, ContactLog(np.inf) if contacts else None)
    with (
        run_so_far(partial(record.trajectory, scheme, complete=False)),
        Writer(out, problem, scheme, 0.0, record) as writer,
        Progress(_TICKS, progress) as bar,
    ):
        walk, look = scheme.integrator(problem, projector), 0.0
        for part in walk.run(duration):
            if isinstance(part, ImpactEvent):
                record.struck(part, walk)
            else:
                record.stride(part, walk)
            if perf_counter() >= look:
                done = _TICKS * (walk.t - problem.t0) / duration
                look = min(writer.poll(), bar.poll(max(int(done), 1)))
        record.keep()
        record.notes += _fallen_back(walk.fallbacks)
    return record.trajectory(scheme, complete=True)


def _fallen_back(fallbacks: int) -> list[str]:
    if not fallbacks:
        return []
    return [
        f"{fallbacks} steps of 1e-4 s were taken by the paper's scheme, of order one: where gradients jump, or events "
        "follow each other without end, the tolerance is not kept"
    ]

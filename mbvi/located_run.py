"""The loop of schemes that choose their own steps and locate impacts between them."""

from __future__ import annotations

import os

import numpy as np

from .problem import Problem
from .progress import Progress
from .projection import Projector
from .schemes import EventDriven
from .schemes.flow import DEGREE, Stride
from .schemes.motion import Motion, Struck
from .trajectory import Array, Impact, Trajectory

_TICKS = 1000


class _Record:
    """States, dense output and impacts of a run; an instant at which v jumps has two states."""

    def __init__(self, problem: Problem) -> None:
        self._problem = problem
        self.t, self.q, self.v = [problem.t0], [problem.q0], [problem.v0]
        self.dense: list[Array] = []
        self.penetration, self.residual = [0.0], [0.0]
        self.impacts: list[Impact] = []
        self._no_motion = np.zeros((2, problem.system.nv, DEGREE))

    def stride(self, stride: Stride, walk: Motion) -> None:
        """Keep a step and the state it led to, of which the drift of closed contacts was taken."""
        self._state(walk.t, walk.q, walk.v, walk, stride.dense)

    def struck(self, struck: Struck, walk: Motion) -> None:
        """Keep an impact and the state after it."""
        self._state(struck.t, struck.q, struck.after, walk, self._no_motion)
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

    def _state(self, t: float, q: Array, v: Array, walk: Motion, dense: Array) -> None:
        self.t.append(t)
        self.q.append(q)
        self.v.append(v)
        self.penetration.append(walk.depth)
        self.residual.append(walk.residual)
        self.dense.append(dense)


def run_located(
    problem: Problem,
    scheme: EventDriven,
    duration: float,
    residual: float,
    out: str | os.PathLike[str] | None,
    progress: bool | None,
) -> Trajectory:
    """Run a problem with a scheme that locates impacts; see `simulate`."""
    from .trajectory_file import save, writable

    if out is not None:
        writable(out, problem)
    projector = Projector(residual)
    record, walk = _Record(problem), scheme.walk(problem, projector)
    with Progress(_TICKS, progress) as bar:
        for part in walk.run(duration):
            if isinstance(part, Struck):
                record.struck(part, walk)
            else:
                record.stride(part, walk)
                bar.poll(int(_TICKS * (walk.t - problem.t0) / duration))
    run = Trajectory(
        np.array(record.t),
        np.array(record.q),
        np.array(record.v),
        tuple(record.impacts),
        np.array(record.residual),
        type(scheme).__name__,
        0.0,
        _notes(walk.fallbacks),
        problem,
        True,
        np.array(record.penetration),
        _scheme=scheme,
        _dense=np.array(record.dense).reshape(-1, 2, problem.system.nv, DEGREE),
    )
    if out is not None:
        save(run, out)
    return run


def _notes(fallbacks: int) -> tuple[str, ...]:
    if not fallbacks:
        return ()
    return (
        f"{fallbacks} steps of 1e-4 s were taken by the paper's scheme, of order one: where gradients jump, or events "
        "follow each other without end, the tolerance is not kept",
    )

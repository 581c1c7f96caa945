"""Sleeping bodies: free bodies at rest are left out of the steps until another body touches them.

At rest, weight and contact forces balance at every step, so that leaving out both changes nothing. The rows of the
sleeping contacts are kept for the record. A step in which a row acts on a sleeping body, or a force moves one, is
retried with its island awake.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from types import TracebackType
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from ..constraints import ConstraintFamily, Rows
from ..constraints.rows import concatenate, take
from ..problem import Problem
from ..schemes import Step
from ..system import located_parts
from ..system.system import Array

# bodies are tested once in so many steps: a body at rest before and after a step stays at rest
_TEST_PERIOD = 8
# speed below which a body is at rest, in units of the speed that a step of free fall adds
_REST = 1e-10


class _Island(NamedTuple):
    """Sleeping bodies that touch each other, and the rows and rates of their contacts."""

    bodies: Array
    rows: Rows
    rates: Array


class Sleepers:
    """The sleeping bodies of a run; a context manager that wakes all of them at its end.

    Parameters
    ----------
    problem : Problem
        The problem that is run.
    h : float
        Time step [s].

    Attributes
    ----------
    any : bool
        Whether the problem has bodies that may sleep.
    """

    def __init__(self, problem: Problem, h: float) -> None:
        self._problem, self._h = problem, h
        self._islands: list[_Island] = []
        self._kept: _Island | None = None
        system = problem.system
        # only free bodies can sleep, and a scene has at most one system of them
        holding = [(p.system, p.v, p.body) for p in located_parts(system) if p.system.can_hold]
        wanted = problem.scene is not None and "rest" in problem.scene.reduce
        self.any = bool(holding) and wanted
        # whether friction holds a body depends on the history of its contacts: such bodies stay awake
        self.any = self.any and not problem.constraints.frictional
        if not self.any:
            return
        self._system, self._first_velocity, self._first_body = holding[0]
        self._count = len(self._system.bodies) - 1
        self._width = self._system.nv // self._count
        self._still = _REST * h * self._system.pull
        self._phase, self._quiet = 0, np.zeros(self._count, bool)
        self._asleep = np.zeros(self._count, bool)
        # the families that can leave out sleeping bodies; for all families their first number, and whether they can
        self._skipping: list[ConstraintFamily] = []
        starts, can_skip = [], []
        for family, start, _ in problem.constraints.numbered():
            starts.append(start)
            can_skip.append(family.skips_resting)
            if can_skip[-1]:
                self._skipping.append(family)
        self._starts, self._can_skip = np.array(starts, dtype=np.int64), np.array(can_skip, dtype=bool)

    def __enter__(self) -> Sleepers:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._islands:
            self._set([])

    def stepped(self, advance: Callable[[], Iterable[Step]], length: float) -> list[Step]:
        """Return the steps of `advance`, which last `length` [s] in all, with the rows of sleeping contacts."""
        found = list(advance())
        while self._islands:
            touched = self._touched(found)
            if not touched.any():
                break
            self._set([island for island in self._islands if not touched[island.bodies].any()])
            found = list(advance())
        kept = self._kept
        # only a whole step is tested, because the percussions of sleeping contacts are kept for that length
        if len(found) == 1 and length == self._h:
            self._find_resting(found[0])
        if kept is None:
            return found
        ends = [found[-1].t - length, *(step.t for step in found)]
        return [
            _with_sleeping_rows(step, kept, (end - begin) / self._h)
            for step, begin, end in zip(found, ends[:-1], ends[1:], strict=True)
        ]

    def _touched(self, found: list[Step]) -> Array:
        """Return which sleeping bodies are touched or moved, shape (n,)."""
        touched = np.zeros(self._count, bool)
        v = slice(self._first_velocity, self._first_velocity + self._width * self._count)
        for step in found:
            touched |= step.v[v].reshape(-1, self._width).any(axis=1)
            if step.active.gap.size:
                column = step.active.jacobian[:, v].nonzero()[1]
                touched[column // self._width] = True
        return touched & self._asleep

    def _find_resting(self, step: Step) -> None:
        """Put islands to sleep that were at rest before and after a step."""
        self._phase = (self._phase + 1) % _TEST_PERIOD
        if self._phase > 1:
            return
        v = step.v[self._first_velocity : self._first_velocity + self._width * self._count].reshape(-1, self._width)
        before, self._quiet = self._quiet, (np.abs(v) <= self._still).all(axis=1)
        ready = before & self._quiet & ~self._asleep
        if self._phase == 0 or not ready.any():
            return
        rows, free = step.active, self._count
        row, column = rows.jacobian.nonzero()
        body = (column - self._first_velocity) // self._width
        # one node of the graph for all other bodies, and for constraints that cannot leave out sleeping bodies
        body = np.where((column >= self._first_velocity) & (body < free), body, free)
        skips = self._can_skip[np.searchsorted(self._starts, rows.constraint, "right") - 1]
        other = np.flatnonzero(~skips)
        row, body = np.concatenate([row, other]), np.concatenate([body, np.full(len(other), free)])
        size = free + 1 + len(rows.gap)
        links = csr_array((np.ones(len(row)), (body, free + 1 + row)), shape=(size, size))
        label = connected_components(links, directed=False)[1]
        islands = list(self._islands)
        for one in np.unique(label[:free][ready]):
            bodies = np.flatnonzero(label[:free] == one)
            if one == label[free] or not ready[bodies].all():
                continue
            here = np.flatnonzero(label[free + 1 :] == one)
            islands.append(_Island(bodies, take(rows, here), step.rates[:, here]))
            v[bodies] = 0.0
        if len(islands) > len(self._islands):
            self._set(islands)

    def _set(self, islands: list[_Island]) -> None:
        """Make these islands, and no others, the sleeping ones."""
        self._islands = islands
        self._asleep[:] = False
        for island in islands:
            self._asleep[island.bodies] = True
        with_rows = [island for island in islands if island.rows.gap.size]
        self._kept = None
        if with_rows:
            rates = np.concatenate([island.rates for island in with_rows], axis=1)
            self._kept = _Island(np.zeros(0, np.int64), concatenate([island.rows for island in with_rows]), rates)
        still = None
        if islands:
            still = np.zeros(len(self._problem.system.bodies), bool)
            # body 0, the world, is at rest too
            still[0] = True
            still[1 + self._first_body : 1 + self._first_body + self._count] = self._asleep
        self._system.hold(self._asleep)
        for family in self._skipping:
            family.skip_resting(still)


def _with_sleeping_rows(step: Step, kept: _Island, share: float) -> Step:
    """Return a step with the rows of sleeping contacts; `share` is its length as a part of a whole step."""
    rows, rates = kept.rows, kept.rates.copy()
    # percussions and free rates are proportional to the length of the step
    rates[:2] *= share
    if not step.active.gap.size:
        return step._replace(active=rows, rates=rates)
    return step._replace(active=concatenate([step.active, rows]), rates=np.concatenate([step.rates, rates], axis=1))

"""Sleeping bodies: free bodies at rest are left out of the steps until another body touches them.

At rest, weight and contact forces balance at every step, so that leaving out both changes nothing. The rows of the
sleeping contacts are kept for the record. A step in which a row acts on a sleeping body, or a force moves one, is
retried with its island awake. With friction this holds as well: the percussions of contacts that hold a body may not be
unique, but those of the last step hold it for as long as nothing else acts on its island.

Projections of many bodies are solved to a residual, which leaves bodies at rest speeds that change from step to step. A
body whose mean speed over many steps is below what the residual leaves in one is at rest as well: a force that the
residual does not hide would have moved it farther. Its speed is removed, and a note of the run says so.
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
from ..projection import Projector
from ..schemes import Step
from ..system import located_parts
from ..system.parts import velocity_units
from ..system.system import Array

# bodies are tested once in so many steps: a body at rest before and after a step stays at rest
_TEST_PERIOD = 8
# velocities up to which a step of the compiled loop costs no more than one in which all bodies sleep
_FEW = 6
# speed below which a body is at rest, in units of the speed that a step of free fall adds
_REST = 1e-10
# tests after which mean speeds are compared with what the residual leaves, and how much faster a body may be in between
_TESTS, _NOISE = 8, 10.0
# how much faster contacts that stick creep by the residual than others
_CREEP = 10.0


class _Island(NamedTuple):
    """Sleeping bodies that touch each other, and of their contacts the rows, the rates and `Step.slip`."""

    bodies: Array
    rows: Rows
    rates: Array
    slip: Array | None


class Sleepers:
    """The sleeping bodies of a run; a context manager that wakes all of them at its end.

    Parameters
    ----------
    problem : Problem
        The problem that is run.
    h : float
        Time step [s].
    projector : Projector
        Solves the projections of the run.

    Attributes
    ----------
    any : bool
        Whether the problem has bodies that may sleep.
    watched : bool
        Whether the compiled loop leaves steps to Python once all bodies are at rest: nothing else can move.
    undisturbed : bool
        Whether nothing moved in the last step of `stepped`, and nothing can in the next: state and rows stay the same.
    """

    def __init__(self, problem: Problem, h: float, projector: Projector) -> None:
        self._problem, self._h = problem, h
        self._islands: list[_Island] = []
        self._kept: _Island | None = None
        # the largest speed that was removed, where it was more than rounding [m/s]
        self._removed = 0.0
        system, self.undisturbed = problem.system, False
        # only free bodies can sleep, and a scene has at most one system of them
        holding = [(p.system, p.v, p.body) for p in located_parts(system) if p.system.can_hold]
        wanted = problem.scene is not None and "rest" in problem.scene.reduce
        # what is connected to others moves with them
        self.any, self.watched = bool(holding) and wanted and not system.coupled(), False
        if not self.any:
            return
        self._system, self._first_velocity, self._first_body = holding[0]
        self._count = len(self._system.bodies) - 1
        self._width = self._system.nv // self._count
        alone = self._system.nv == system.nv
        # bodies on walls that move cannot be left alone: their steps cost less in the loop
        self.watched = alone and system.nv > _FEW and not problem.constraints.moving
        self._closed = alone and not (system.loaded or problem.constraints.moving)
        self._units = velocity_units(self._system, problem.length)[: self._width] / problem.length
        fall = h * self._system.pull * self._units
        self._still = _REST * fall
        # few bodies are solved to rounding
        left = projector.residual_at_rest if problem.system.sparse else 0.0
        if problem.constraints.frictional:
            left *= _CREEP
        self._slow = max(_REST, left) * fall
        self._phase, self._quiet = 0, np.zeros(self._count, bool)
        # where and when mean speeds are counted from, and bodies that were fast since then
        self._start: Step | None = None
        self._tests, self._fast = 0, np.zeros(self._count, bool)
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
        self.wake()

    def all_still(self, v: Array) -> Array:
        """Return whether all bodies are at rest, where they are `watched`: at v, shape (nv,), or at each of (n, nv)."""
        still: Array = (np.abs(v.reshape(*v.shape[:-1], -1, self._width)) <= self._slow).all(axis=(-2, -1))
        return still

    def wake(self) -> None:
        """Wake all bodies."""
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
        kept, whole = self._kept, len(found) == 1 and length == self._h
        self.undisturbed = self._closed and whole and bool(self._asleep.all())
        # only a whole step is tested, because the percussions of sleeping contacts are kept for that length
        if whole:
            self._find_resting(found[0])
        if kept is None:
            return found
        ends = [found[-1].t - length, *(step.t for step in found)]
        return [
            _with_sleeping_rows(step, kept, (end - begin) / self._h)
            for step, begin, end in zip(found, ends[:-1], ends[1:], strict=True)
        ]

    def note(self) -> list[str]:
        """Return a note that states the largest speed that sleep removed, or none where that was rounding."""
        if self._removed == 0.0:
            return []
        return [f"bodies at rest slept: their speeds, at most {self._removed:.1e} m/s, were removed"]

    def _touched(self, found: list[Step]) -> Array:
        """Return which sleeping bodies are touched or moved, shape (n,)."""
        touched = np.zeros(self._count, bool)
        v = slice(self._first_velocity, self._first_velocity + self._width * self._count)
        for step in found:
            touched |= self._of_bodies(step.v).any(axis=1)
            if step.active.gap.size:
                column = step.active.jacobian[:, v].nonzero()[1]
                touched[column // self._width] = True
        return touched & self._asleep

    def _find_resting(self, step: Step) -> None:
        """Put islands to sleep that were at rest before and after a step."""
        self._phase = (self._phase + 1) % _TEST_PERIOD
        if self._phase > 1:
            return
        v = self._of_bodies(step.v)
        before, self._quiet = self._quiet, (np.abs(v) <= self._still).all(axis=1)
        if self._phase == 0:
            return
        ready = ((before & self._quiet) | self._slow_bodies(step)) & ~self._asleep
        if not ready.any():
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
            slip = None if step.slip is None else step.slip[:, here]
            islands.append(_Island(bodies, take(rows, here), step.rates[:, here], slip))
            if not self._quiet[bodies].all():
                self._removed = max(self._removed, float((np.abs(v[bodies]) / self._units).max()))
            v[bodies] = 0.0
        if len(islands) > len(self._islands):
            self._set(islands)

    def _slow_bodies(self, step: Step) -> Array:
        """Return which bodies moved no more than the residual explains, shape (n,); none until tests are complete."""
        slow = np.zeros(self._count, bool)
        if self._start is None or self._tests == _TESTS:
            if self._start is not None:
                moved = self._of_bodies(self._problem.system.difference(self._start.q, step.q))
                slow = ~self._fast & (np.abs(moved) <= (step.t - self._start.t) * self._slow).all(axis=1)
            self._start, self._tests, self._fast[:] = step, 0, False
        self._tests += 1
        self._fast |= (np.abs(self._of_bodies(step.v)) > _NOISE * self._slow).any(axis=1)
        return slow

    def _of_bodies(self, v: Array) -> Array:
        """Return the part of a tangent vector that belongs to the bodies that can sleep, shape (n, width)."""
        return v[self._first_velocity : self._first_velocity + self._width * self._count].reshape(-1, self._width)

    def _set(self, islands: list[_Island]) -> None:
        """Make these islands, and no others, the sleeping ones."""
        self._islands, self.undisturbed = islands, False
        self._asleep[:] = False
        for island in islands:
            self._asleep[island.bodies] = True
        with_rows = [island for island in islands if island.rows.gap.size]
        self._kept = None
        if with_rows:
            rates = np.concatenate([island.rates for island in with_rows], axis=1)
            slips = [island.slip for island in with_rows if island.slip is not None]
            slip = np.concatenate(slips, axis=1) if slips else None
            self._kept = _Island(np.zeros(0, np.int64), concatenate([island.rows for island in with_rows]), rates, slip)
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
    rows, rates = kept.rows, _of_length(kept.rates, share)
    slip = None if kept.slip is None else _of_length(kept.slip, share)
    if not step.active.gap.size:
        return step._replace(active=rows, rates=rates, slip=slip)
    if slip is not None and step.slip is not None:
        slip = np.concatenate([step.slip, slip], axis=1)
    rows, rates = concatenate([step.active, rows]), np.concatenate([step.rates, rates], axis=1)
    return step._replace(active=rows, rates=rates, slip=slip)


def _of_length(rates: Array, share: float) -> Array:
    """Return rates of a step that lasts a part of the whole: percussions and free rates are proportional to it."""
    rates = rates.copy()
    rates[:2] *= share
    return rates

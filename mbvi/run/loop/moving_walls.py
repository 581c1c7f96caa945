"""Walls that move, in the compiled loop: there they are bodies of the mechanism, whose joints come after all others."""

from __future__ import annotations

from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from ...constraints import AdmissibleSet
from ...constraints.mechanism.state import can_be_compiled
from ...constraints.mechanism.walls import motions_of, wall_joints, with_wall_bodies
from ...problem import Problem
from ...schemes import Step
from ...schemes.kernels.records import Clocks
from ...system.mechanisms.articulated import ArticulatedSystem
from ...system.mechanisms.joined import joined
from ...system.system import Array
from .loop_record import LoopRecord

# making one takes as long as a hundred steps
_made: WeakKeyDictionary[AdmissibleSet, InLoop] = WeakKeyDictionary()
NO_CLOCKS = Clocks(np.zeros((0, 2)), np.zeros((0, 6)))


class InLoop(NamedTuple):
    """What the compiled loop steps.

    Attributes
    ----------
    system : ArticulatedSystem
        The parts of the problem as one mechanism, with the joints of walls that move.
    constraints : AdmissibleSet
        Those of the problem; where walls move, others in which these are bodies.
    clocks : Clocks
        The joints of walls.
    numbers : ndarray of int, shape (n,), or None
        Of each of the constraints its number in the problem; None where these are the same.
    """

    system: ArticulatedSystem
    constraints: AdmissibleSet
    clocks: Clocks
    numbers: Array | None

    def with_clocks(self, state: Array) -> Array:
        """Return q or v with room for the joints of walls."""
        return np.concatenate([state, np.zeros(len(self.clocks.speeds))])

    def named(self, step: Step) -> Step:
        """Return a step with rows of a log with the numbers of the problem."""
        if self.numbers is None:
            return step
        return step._replace(active=step.active._replace(constraint=self.numbers[step.active.constraint]))

    def name_rows(self, log: LoopRecord, taken: int) -> None:
        """Give the rows of a log, of so many steps, the numbers of the problem, ascending in each step."""
        if self.numbers is None:
            return
        ends = log.begin[: taken + 1]
        own = slice(0, int(ends[-1]))
        number, step = self.numbers[log.number[own]], np.repeat(np.arange(taken), np.diff(ends))
        order = np.lexsort((number, step))
        log.number[own], log.rows[own] = number[order], log.rows[own][order]
        if len(log.correction):
            log.correction[own] = log.correction[own][order]


def in_loop(problem: Problem) -> InLoop | None:
    """Return what the compiled loop steps of a problem of which `is_compiled` is true; None if it cannot."""
    system = joined(problem.system)
    motions = motions_of(problem.constraints)
    if not motions:
        return InLoop(system, problem.constraints, NO_CLOCKS, None)
    found = _made.get(problem.constraints)
    if found is None:
        walls = wall_joints(system, problem.system, motions)
        constraints, numbers = with_wall_bodies(problem.constraints, walls)
        if not can_be_compiled(constraints):
            return None
        found = InLoop(walls.system, constraints, Clocks(walls.clocks, walls.changes), numbers)
        constraints.cache.start(found.with_clocks(problem.q0))
        _made[problem.constraints] = found
    # a run gives the same bytes whatever ran before
    found.constraints.renew()
    return found

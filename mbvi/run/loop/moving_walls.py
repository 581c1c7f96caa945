"""Walls that move, in the compiled loop: there they are bodies of the mechanism, whose joints come after all others."""

from __future__ import annotations

from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from ...constraints import AdmissibleSet
from ...constraints.mechanism.state import can_be_compiled, walls_can_be_bodies
from ...constraints.mechanism.walls import PrescribedJoints, motions_of, wall_joints, with_wall_bodies
from ...problem import Problem
from ...schemes import Step
from ...system.mechanisms.articulated import ArticulatedSystem
from ...system.mechanisms.joined import can_be_joined, joined
from ...system.system import Array
from .loop_record import LoopRecord

# making one takes as long as a hundred steps
_made: WeakKeyDictionary[AdmissibleSet, InLoop] = WeakKeyDictionary()
NONE_PRESCRIBED = PrescribedJoints(np.zeros((0, 2)), np.zeros((0, 6)))


class InLoop(NamedTuple):
    """What the compiled loop steps.

    Attributes
    ----------
    system : ArticulatedSystem
        The parts of the problem as one mechanism, with the joints of walls that move.
    constraints : AdmissibleSet
        Those of the problem; where walls move, others in which these are bodies.
    prescribed : PrescribedJoints
        The joints of walls.
    numbers : ndarray of int, shape (n,), or None
        Of each of the constraints its number in the problem; None where these are the same.
    """

    system: ArticulatedSystem
    constraints: AdmissibleSet
    prescribed: PrescribedJoints
    numbers: Array | None

    def with_prescribed(self, state: Array) -> Array:
        """Return q or v with room for the joints of walls."""
        return np.concatenate([state, np.zeros(len(self.prescribed.motion))])

    @property
    def speeds(self) -> Array:
        """The speeds of the joints of walls."""
        return self.prescribed.motion[:, 0]

    def at_time(self, step: Step) -> Step:
        """Return a step with the joints of walls, where they are at its time."""
        q, v = np.append(step.q, self.speeds * step.t + self.prescribed.motion[:, 1]), np.append(step.v, self.speeds)
        return step._replace(q=q, v=v)

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
    if not problem.constraints.moving:
        return InLoop(joined(problem.system), problem.constraints, NONE_PRESCRIBED, None)
    found = with_walls(problem)
    if found is None or not can_be_compiled(found.constraints):
        return None
    # a run gives the same bytes whatever ran before
    found.constraints.renew()
    return found


def with_walls(problem: Problem) -> InLoop | None:
    """Return a problem with its walls that move as bodies; None if there are none, or if some cannot be bodies."""
    constraints = problem.constraints
    if not (constraints.moving and walls_can_be_bodies(constraints) and can_be_joined(problem.system)):
        return None
    found = _made.get(constraints)
    if found is None:
        walls = wall_joints(joined(problem.system), problem.system, motions_of(constraints) or [])
        bodies, numbers = with_wall_bodies(constraints, walls)
        found = _made[constraints] = InLoop(walls.system, bodies, walls.prescribed, numbers)
        bodies.cache.start(found.with_prescribed(problem.q0))
    return found

"""Steps of `Centered` that know which contacts are at rest, and do not lose them however long they are."""

from __future__ import annotations

import numpy as np

from ...constraints import Rows
from ...constraints.rows import match_contacts
from ...problem import Problem
from ...system.system import Array
from ..centered import Centered
from ..positions.nearby_rows import NearbyRows
from ..step import joining, near_margin
from .measure import Measure

# travel in a step up to which gaps are looked at, and the most, in lengths of the scene
_TRAVEL, _FARTHEST = 2.0, 0.5


class HoldingCentered(Centered):
    """`Centered(project_positions=True)`, in whose law contacts at rest take part wherever their bodies would move.

    Without them a contact whose body moves along a curve, or whose wall slows down, is open at the end of a long step
    at the velocity before. They do not bounce: that a curve comes near within a step is no impact.

    Parameters
    ----------
    measure : Measure
        Sizes of displacements.

    Attributes
    ----------
    resting : Rows or None
        The contacts at rest before the step.
    """

    def __init__(self, measure: Measure) -> None:
        super().__init__(project_positions=True)
        self._measure = measure
        self.resting: Rows | None = None

    def rows_ahead(self, problem: Problem, nearby: NearbyRows, q: Array, v: Array, h: float) -> Rows:
        """See `Centered`."""
        if self.resting is None or not len(self.resting.gap):
            return super().rows_ahead(problem, nearby, q, v, h)
        moved, _ = problem.system.coast(v, h)
        margin = near_margin(problem, True, moved)
        # constraints of the user do not say how far their bodies travel
        travel = max(problem.constraints.travel(moved), self._measure.size(moved) * problem.length)
        far = max(margin, min(_TRAVEL * travel + margin, _FARTHEST * problem.length))
        ahead = nearby.at(problem.system.integrate(q, moved), far)
        near = problem.constraints.levers(ahead.constraint) * ahead.gap <= problem.tolerance + margin
        joins = near & joining(problem, ahead, h * ahead.speeds(moved / h))
        rests = match_contacts(ahead, self.resting) >= 0
        chosen = joins | rests
        ahead = nearby.only(chosen)
        return ahead._replace(restitution=np.where(rests[chosen], 0.0, ahead.restitution))

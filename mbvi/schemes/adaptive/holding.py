"""Steps of `Centered` that know which contacts are at rest, and do not lose them however long they are."""

from __future__ import annotations

import numpy as np

from ...constraints import Rows
from ...constraints.rows import match_contacts, take
from ...constraints.tangents import along_axes
from ...problem import Problem
from ...projection import Projector
from ...system.system import Array
from ..centered import Centered
from ..positions.nearby_rows import NearbyRows
from ..step import Step, joining, near_margins
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
        # those of them that have friction at the start of the step, and their slips [m/s]; and that start
        self._rough: tuple[Rows, Array] | None = None
        self._start: tuple[Array, Array] | None = None

    def start_from(self, resting: Rows) -> None:
        """Let these be the contacts at rest before the next step."""
        self.resting, self._start = resting, None

    def step(self, problem: Problem, t: float, q: Array, v: Array, h: float, projector: Projector) -> Step:
        """See `Scheme`."""
        # the whole step and its first half start alike
        if self._start is None or self._start[0] is not q or self._start[1] is not v:
            self._rough, self._start = self._with_friction(problem, t, q, v), (q, v)
        return self._from_the_start(super().step(problem, t, q, v, h, projector))

    def _from_the_start(self, step: Step) -> Step:
        """Return a step whose rates and slips before the law are those at its start, of contacts at rest with friction.

        Those after the law are those at its end, as far as the turning of bodies goes.
        """
        tangents = step.active.tangents
        if self._rough is None or step.slip is None or tangents is None or not len(self._rough[1]):
            return step
        here, before = self._rough
        assert here.tangents is not None
        owner, slip, rates = match_contacts(step.active, here), step.slip.copy(), step.rates.copy()
        known = owner >= 0
        # gaps at rest do not change
        rates[3, known] = 0.0
        slip[3, known, :2] = along_axes(before[owner], here.tangents.axes[owner], tangents.axes)[known]
        return step._replace(rates=rates, slip=slip)

    def _with_friction(self, problem: Problem, t: float, q: Array, v: Array) -> tuple[Rows, Array] | None:
        """Return the contacts at rest that have friction, and how they slip."""
        resting = self.resting
        if resting is None or resting.tangents is None or not (resting.tangents.friction > 0.0).any():
            return None
        here = problem.constraints.active(t, q, 4.0 * self._measure.gap)
        here = take(here, match_contacts(here, resting) >= 0)
        return None if here.tangents is None else (here, here.tangents.slip(v)[:, :2])

    def rows_of_law(self, rows: Rows, v: Array, opened: Array | None) -> tuple[Rows, Array | None]:
        """Return rows in whose law contacts at rest turn with the mean of the velocities before and after.

        A body that turns about a contact moves across it, or slips, in the middle of a step. The law would only take
        that away, and with it half of the forces that bend the path; Coulomb's law would not see the other half.
        """
        tangents = rows.tangents
        if self._rough is None or tangents is None or not len(self._rough[1]):
            return rows, opened
        here, before = self._rough
        owner = match_contacts(rows, here)
        rests = owner >= 0
        assert here.tangents is not None
        slip = tangents.slip(v)
        slip[:, :2] -= along_axes(before[owner], here.tangents.axes[owner], tangents.axes)
        slip[~rests], slip[:, 2:] = 0.0, 0.0
        across = np.where(rests, rows.speeds(v), 0.0)
        tangents = tangents._replace(rate=slip.ravel() + (0.0 if tangents.rate is None else tangents.rate))
        rows = rows._replace(rate=across + (0.0 if rows.rate is None else rows.rate), tangents=tangents)
        return rows, None if opened is None else np.where(rests, 0.0, opened)

    def rows_ahead(self, problem: Problem, nearby: NearbyRows, q: Array, v: Array, h: float) -> Rows:
        """See `Centered`."""
        if self.resting is None or not len(self.resting.gap):
            return super().rows_ahead(problem, nearby, q, v, h)
        moved, _ = problem.system.coast(v, h)
        margins = near_margins(problem, True, moved, nearby.t - h, q, h)
        # constraints of the user do not say how far their bodies travel
        travel = max(problem.constraints.travel(moved), self._measure.size(moved) * problem.length)
        near = margins.largest
        far = np.maximum(near, np.minimum(_TRAVEL * travel + near, _FARTHEST * problem.length))
        ahead = nearby.at(problem.system.integrate(q, moved), far)
        joins = joining(problem, ahead, margins, h * ahead.speeds(moved / h))
        rests = match_contacts(ahead, self.resting) >= 0
        chosen = joins | rests
        ahead = nearby.only(chosen)
        return ahead._replace(restitution=np.where(rests[chosen], 0.0, ahead.restitution))

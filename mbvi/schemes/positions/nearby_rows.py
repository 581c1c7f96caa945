"""Rows found at one configuration and known to first order at others nearby."""

from __future__ import annotations

import numpy as np

from ...constraints import Rows
from ...constraints.rows import take
from ...problem import Problem
from ...projection.row_speeds import times
from ...system.system import Array

# second-order part of a gap that is left out, in lengths of the scene
SECOND_ORDER = 1e-6


def largest_reach(problem: Problem) -> float:
    """Return the travel up to which gaps count as linear [m]; 0 where the travel of some constraint is not known."""
    return (2.0 * SECOND_ORDER) ** 0.5 * problem.length if problem.constraints.knows_travel else 0.0


class NearbyRows:
    """The rows at one time, searched again only where their gaps are no longer linear in the displacement.

    The second-order part of a gap is about displacement^2 / (2 length). Up to the displacement `reach` it is at most
    1e-6 of the scene's length, and far below the activation tolerance where bodies come to rest. A search covers a
    margin, so that rows which come near by such displacements are known too.

    Parameters
    ----------
    problem : Problem
        Its constraints are searched.
    t : float
        Time [s].
    linear : bool
        Whether gaps are taken to first order at all; otherwise every configuration is searched.
    """

    def __init__(self, problem: Problem, t: float, *, linear: bool) -> None:
        self._problem, self._t = problem, t
        self._reach = largest_reach(problem) if linear else 0.0
        # the last search: the rows, where, and their largest gap less the tolerance
        self._rows: Rows | None = None
        self._q: Array | None = None
        self._margin = 0.0
        # which of them the last answer holds, and that answer
        self._near: Array = np.zeros(0, bool)
        self._answer: Rows | None = None

    @property
    def place(self) -> Array:
        """The configuration of the last search, shape (nq,): gradients are those of it."""
        assert self._q is not None
        return self._q

    def at(self, q: Array, margin: float = 0.0) -> Rows:
        """Return the rows at q with a gap of at most the activation tolerance and a margin [m]."""
        known = self.known_at(q, margin)
        if known is not None:
            return known
        self._q, self._margin = q, margin + 2.0 * self._reach
        self._rows = self._problem.constraints.active(self._t, q, self._problem.tolerance + self._margin)
        return self._within(self._rows, margin)

    def _within(self, rows: Rows, margin: float) -> Rows:
        levers, tolerance = self._problem.constraints.levers(rows.constraint), self._problem.tolerance
        self._near = levers * rows.gap <= tolerance + margin
        self._answer = rows if self._near.all() else take(rows, self._near)
        return self._answer

    def all_at(self, q: Array) -> Rows:
        """Return all rows of the last search with their gaps at q to first order."""
        assert self._rows is not None
        displacement = self._problem.system.difference(self.place, q)
        return self._rows._replace(gap=self._rows.gap + times(self._rows.jacobian, displacement))

    def only(self, some: Array) -> Rows:
        """Keep some of the rows of the last answer, a mask of shape (k,), and return them."""
        assert self._answer is not None
        if not some.all():
            self._near[np.flatnonzero(self._near)[~some]] = False
            self._answer = take(self._answer, some)
        return self._answer

    def known_at(self, q: Array, margin: float = 0.0) -> Rows | None:
        """Return the same from the last search, with gaps to first order; None if the rows must be searched again."""
        if self._rows is None:
            return None
        gap = self._gaps_at(q, margin)
        return None if gap is None else self._within(self._rows._replace(gap=gap), margin)

    def sinks(self, q: Array) -> bool:
        """Return whether some gap at q may be below zero by more than the tolerance."""
        gap = self._gaps_at(q, 0.0)
        if gap is None or self._rows is None:
            return True
        lengths = self._problem.constraints.levers(self._rows.constraint) * gap
        return bool(lengths.min(initial=0.0) < -self._problem.tolerance)

    def _gaps_at(self, q: Array, margin: float) -> Array | None:
        """Return the gaps of the last search at q to first order; None if the rows must be searched again."""
        if self._rows is None or self._q is None or self._reach == 0.0:
            return None
        displacement = self._problem.system.difference(self._q, q)
        travel = self._problem.constraints.travel(displacement)
        if travel > self._reach or margin + travel > self._margin:
            return None
        gap: Array = self._rows.gap + times(self._rows.jacobian, displacement)
        return gap

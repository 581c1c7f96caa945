"""Rows found at one configuration and known to first order at others nearby."""

from __future__ import annotations

import numpy as np

from ..constraints import Rows
from ..constraints.rows import take
from ..problem import Problem
from ..system.system import Array


class NearbyRows:
    """The rows at one time, searched again only where their gaps are no longer linear in the displacement.

    The second-order part of a gap is about displacement^2 / (2 length). It is within the activation tolerance up to the
    displacement `reach`. A search covers a margin, so that rows which come near by such displacements are known too.

    Parameters
    ----------
    problem : Problem
        Its constraints are searched.
    t : float
        Time [s].
    """

    def __init__(self, problem: Problem, t: float) -> None:
        self._problem, self._t = problem, t
        known = problem.constraints.travel(np.zeros(problem.system.nv)) == 0.0
        self._reach = float(np.sqrt(2.0 * problem.tolerance * problem.length)) if known else 0.0
        # the last search: the rows, where, and their largest gap less the tolerance
        self._rows: Rows | None = None
        self._q: Array | None = None
        self._margin = 0.0

    def at(self, q: Array, margin: float = 0.0) -> Rows:
        """Return the rows at q with a gap of at most the activation tolerance and a margin [m]."""
        constraints, tolerance = self._problem.constraints, self._problem.tolerance
        rows = self._moved(q, margin)
        if rows is None:
            self._q, self._margin = q, margin + 2.0 * self._reach
            self._rows = rows = constraints.active(self._t, q, tolerance + self._margin)
        near = constraints.levers(rows.constraint) * rows.gap <= tolerance + margin
        return rows if near.all() else take(rows, near)

    def _moved(self, q: Array, margin: float) -> Rows | None:
        """Return the rows of the last search with their gaps at q to first order; None if they must be searched."""
        if self._rows is None or self._q is None or self._reach == 0.0:
            return None
        displacement = self._problem.system.difference(self._q, q)
        travel = self._problem.constraints.travel(displacement)
        if travel > self._reach or margin + travel > self._margin:
            return None
        return self._rows._replace(gap=self._rows.gap + self._rows.jacobian @ displacement)

"""Rows found at one configuration and known to first order at others nearby."""

from __future__ import annotations

import numpy as np

from ...compiled import kernel, plain_array
from ...constraints import Rows
from ...constraints.rows import take
from ...problem import Problem
from ...projection.positions.travel import largest_of_parts, write_travels_of_parts
from ...projection.row_speeds import times
from ...system.system import Array

# second-order part of a gap that is left out, in lengths of the scene
SECOND_ORDER = 1e-6


def linear_reach(problem: Problem) -> Array:
    """Return the travel up to which the gaps of each part count as linear, shape (parts,) [m].

    It is 0 where a constraint does not say how far bodies travel, or where its gaps are not linear.
    """
    part = problem.constraints.part
    reach = np.full(part[-1] + 1, (2.0 * SECOND_ORDER) ** 0.5 * problem.length)
    reach[part[problem.constraints.searched]] = 0.0
    return reach


class NearbyRows:
    """The rows at one time, searched again only where their gaps are no longer linear in the displacement.

    The second-order part of a gap is about displacement^2 / (2 length). Up to the displacement `reach` it is at most
    1e-6 of the scene's length, and far below the activation tolerance where bodies come to rest. A search covers a
    margin, so that rows which come near by such displacements are known too. The next search moves only the
    mechanisms and free bodies that have travelled farther than that; the others stay where they were found, so that
    their rows do not depend on what moves elsewhere.

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
        self._problem, self.t, self._part = problem, t, problem.constraints.part
        self._still = np.zeros(self._part[-1] + 1)
        self._reach = linear_reach(problem) if linear else self._still
        # the last search: the rows, where, and of each part the margin
        self._rows: Rows | None = None
        self._q: Array | None = None
        self._margins = self._still
        # of which parts the rows must be searched again, and the last configuration in question with its displacement
        self._renewed: Array = np.zeros(0, bool)
        self._last: tuple[Array, Array] | None = None
        # which of them the last answer holds, and that answer
        self._near: Array = np.zeros(0, bool)
        self._answer: Rows | None = None

    @property
    def place(self) -> Array:
        """The configuration of the last search, shape (nq,): gradients are those of it."""
        assert self._q is not None
        return self._q

    def at(self, q: Array, margins: Array | None = None) -> Rows:
        """Return the rows at q with a gap of at most the activation tolerance and a margin [m].

        `margins`, shape (parts,), are those of mechanisms and free bodies, 0 by default; a row has the larger of its
        two.
        """
        margins = self._still if margins is None else margins
        if not self._is_known_at(q, margins):
            self._search(q, margins)
        return self._within(self.all_at(q), margins)

    def _search(self, q: Array, margins: Array) -> None:
        system, tolerance = self._problem.system, self._problem.tolerance
        if self._q is None or self._renewed.all():
            self._q, self._margins, self._last = q, margins, None
        else:
            moved = np.where(self._renewed[self._part], self._displacement_to(q), 0.0)
            self._q, self._last = system.integrate(self._q, moved), None
            self._margins = np.where(self._renewed, margins, self._margins)
        margins = self._margins + 2.0 * self._reach
        rows = self._problem.constraints.active(self.t, self._q, tolerance + margins.max())
        known = self._are_within(rows, margins)
        self._rows = rows if known.all() else take(rows, known)

    def _are_within(self, rows: Rows, margins: Array) -> Array:
        """Return which rows have a gap of at most the activation tolerance and their margin, shape (k,)."""
        if not len(rows.gap):
            return np.zeros(0, bool)
        lengths = self._problem.constraints.levers(rows.constraint) * rows.gap - self._problem.tolerance
        return np.asarray(lengths <= largest_of_parts(rows.jacobian, self._part, margins))

    def _within(self, rows: Rows, margins: Array) -> Rows:
        self._near = self._are_within(rows, margins)
        self._answer = rows if self._near.all() else take(rows, self._near)
        return self._answer

    def all_at(self, q: Array) -> Rows:
        """Return all rows of the last search with their gaps at q to first order."""
        assert self._rows is not None
        if q is self._q:
            return self._rows
        displacement = self._displacement_to(q)
        return self._rows._replace(gap=self._rows.gap + times(self._rows.jacobian, displacement))

    def _displacement_to(self, q: Array) -> Array:
        if self._last is None or self._last[0] is not q:
            self._last = q, self._problem.system.difference(self.place, q)
        return self._last[1]

    def only(self, some: Array) -> Rows:
        """Keep some of the rows of the last answer, a mask of shape (k,), and return them."""
        assert self._answer is not None
        if not some.all():
            self._near[np.flatnonzero(self._near)[~some]] = False
            self._answer = take(self._answer, some)
        return self._answer

    def sinks(self, q: Array) -> bool:
        """Return whether some gap at q may be below zero by more than the tolerance."""
        if not self._is_known_at(q, self._still):
            return True
        rows = self.all_at(q)
        lengths = self._problem.constraints.levers(rows.constraint) * rows.gap
        return bool(lengths.min(initial=0.0) < -self._problem.tolerance)

    def _is_known_at(self, q: Array, margins: Array) -> bool:
        """Return whether the last search found all rows at q within the margins, and gaps are linear up to there."""
        if self._rows is None or self._q is None:
            return False
        self._renewed = np.ones(len(margins), bool)
        if self._reach.any():
            squares, travels = plain_array(self._problem.constraints.cache.squares), np.empty(len(margins))
            displacement = plain_array(self._displacement_to(q))
            write_travels_of_parts(squares, displacement, self._part, travels)
            mark_unknown(travels, self._reach, margins, self._margins, self._renewed)
        return not self._renewed.any()


@kernel("b1(f8[::1], f8[::1], f8[::1], f8[::1], b1[::1])")
def mark_unknown(travels: Array, reach: Array, margins: Array, known: Array, unknown: Array) -> bool:
    """Mark the parts of which a search must find the rows again; return whether there are any.

    Parameters
    ----------
    travels : ndarray, shape (parts,)
        How far bodies have moved since the last search; see `write_travels_of_parts`.
    reach : ndarray, shape (parts,)
        Travel up to which gaps are linear [m]; see `linear_reach`.
    margins, known : ndarray, shape (parts,)
        The margins now, and those of the last search, which found gaps of up to these and twice the reach [m].
    unknown : ndarray of bool, shape (parts,)
        Receives the answer.
    """
    some = False
    for p in range(len(travels)):
        # the other body of a contact may have moved by the reach
        left = known[p] + reach[p] - margins[p]
        unknown[p] = not reach[p] > 0.0 or travels[p] > reach[p] or travels[p] > left
        some = some or unknown[p]
    return some

"""Pairs of bodies that may touch: which of them must be asked, and their rows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ..extrema import most
from ..system import System
from .active import Array, Rows
from .shapes import PlacedShape

_DENSE_REACH = 200_000


class Contacts(NamedTuple):
    """Contact points of some pairs, pair after pair.

    Attributes
    ----------
    pair : ndarray of int, shape (k,)
        Which pair each belongs to, ascending.
    gap : ndarray, shape (k,)
        Signed distances [m].
    point, normal : ndarray, shape (k, 3)
        In the world; the normal leads from the pair's first body to its second.
    """

    pair: Array
    gap: Array
    point: Array
    normal: Array


class Pairs:
    """Pairs of placed shapes with a budget each: how far their bodies must travel before they can touch.

    A pair's budget is its last gap less all that its two shapes can have travelled since, bounded by
    reach . |difference of configurations|; only a pair whose budget is spent is asked again.

    Parameters
    ----------
    system : System
        What moves the bodies.
    first, second : sequence of PlacedShape or None
        The shapes of each pair; None is a wall of the world.
    names : sequence of str
        One a pair.
    restitution : ndarray, shape (n,)
        e of each pair.
    """

    def __init__(
        self,
        system: System,
        first: Sequence[PlacedShape | None],
        second: Sequence[PlacedShape],
        names: Sequence[str],
        restitution: Array,
    ) -> None:
        self.system = system
        self.asked_by: object = None
        self.names = tuple(names)
        self.restitution = restitution
        self._first_body = np.array([0 if s is None else s.body for s in first], dtype=np.intp)
        self._second_body = np.array([s.body for s in second], dtype=np.intp)
        reaches: dict[str, Array] = {}
        rows, envelope = [], np.zeros(system.nv)
        dense = len(second) * system.nv <= _DENSE_REACH
        for a, b in zip(first, second, strict=True):
            sides = [np.zeros(system.nv) if s is None else _reach(system, s, reaches) for s in (a, b)]
            # velocities that carry both sides leave their distance as it is
            row = np.where((sides[0] > 0.0) & (sides[1] > 0.0), 0.0, sides[0] + sides[1])
            np.maximum(envelope, row, out=envelope)
            rows.append(row if dense else _sparse().csr_array(row[None]))
        self._reach = np.array(rows) if dense else _sparse().vstack(rows, format="csr")
        self._budget = np.full(len(self.names), -np.inf)
        # no pair nears faster than the envelope says: while that has not used up the least budget of the pairs that
        # were not asked, the same pairs are asked again and no budget is looked at
        self._envelope = envelope
        self._spare, self._travelled = -np.inf, np.zeros(system.nv)
        self._due = np.zeros(0, dtype=np.intp)

    def contacts(self, q: Array, pairs: Array, tolerance: float) -> Contacts:
        """Return at least one contact of each of the given pairs, all their points within the tolerance included."""
        raise NotImplementedError

    def active(self, t: float, q: Array, tolerance: float, travel: Array | None) -> Rows | None:
        """Return the rows within the tolerance, or None.

        Parameters
        ----------
        t : float
            Time [s].
        q : ndarray, shape (nq,)
            Configuration.
        tolerance : float
            Gap at and below which a row is active [m].
        travel : ndarray, shape (nv,), or None
            |difference| to the configuration of the last call; None asks every pair.
        """
        due = self._due_pairs(tolerance, travel)
        if not due.size:
            return None
        pair, gap, point, normal = self.contacts(q, due, tolerance)
        if most(gap) > tolerance:
            # some pair was asked in vain, and its budget is known anew; one that touches stays due
            self._spare = -np.inf
            self._budget[due] = gap if pair.size == due.size else np.minimum.reduceat(gap, np.searchsorted(pair, due))
            near = (gap <= tolerance).nonzero()[0]
            if not near.size:
                return None
            pair, gap, point, normal = pair[near], gap[near], point[near], normal[near]
        first, second = self._first_body.take(pair), self._second_body.take(pair)
        rows = self.system.separation_rows(q, first, second, point, normal)
        return Rows(pair, gap, rows, self.restitution.take(pair), point, normal)

    def _due_pairs(self, tolerance: float, travel: Array | None) -> Array:
        """Return the pairs whose budgets are spent."""
        if travel is None:
            self._budget[:] = -np.inf
        else:
            self._travelled += travel
            if self._travelled.dot(self._envelope) < self._spare:
                return self._due
            self._budget -= self._reach @ self._travelled
        self._travelled[:] = 0.0
        due = self._budget <= tolerance
        self._due = due.nonzero()[0]
        self._spare = float(np.where(due, np.inf, self._budget).min()) - tolerance
        return self._due

    def _nearest(self, q: Array) -> Contacts:
        pairs = np.arange(len(self.names))
        contacts = self.contacts(q, pairs, 0.0)
        order = np.lexsort((contacts.gap, contacts.pair))
        first = order[np.searchsorted(contacts.pair[order], pairs)]
        return Contacts(*(part[first] for part in contacts))

    def gap(self, t: float, q: Array) -> Array:
        """Return the signed distance of every pair, shape (m,) [m]."""
        return self._nearest(q).gap

    def gradient(self, t: float, q: Array) -> Array:
        """Return the gradient of every pair's distance, shape (m, nv)."""
        pair, _, point, normal = self._nearest(q)
        return self.system.separation_rows(q, self._first_body[pair], self._second_body[pair], point, normal)


def _reach(system: System, placed: PlacedShape, known: dict[str, Array]) -> Array:
    if placed.body == 0:
        return np.zeros(system.nv)
    if placed.name not in known:
        known[placed.name] = system.reach(placed.body, placed.position, placed.shape.bound)
    return known[placed.name]


def _sparse() -> Any:
    # imported here for its weight: only scenes of many pairs need it
    from scipy import sparse

    return sparse

"""Pairs of bodies that may touch: which of them must be asked, and their rows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ..compiled import kernel
from ..geometry.shapes import PlacedShape
from ..system import System
from .rebuilt import Rebuilt
from .rows import Array, Rows

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


@kernel("Tuple((i8, f8))(f8[::1], f8[:,::1], f8[::1], f8, i8[::1])")
def _spend(budget: Array, reach: Array, travel: Array, tolerance: float, due: Array) -> tuple[int, float]:
    """Take the travel from the budgets; return how many are spent, and the least that another has left.

    Parameters
    ----------
    budget : ndarray, shape (n,)
        What each pair's bodies may travel before they can touch [m]; changed.
    reach : ndarray, shape (nv, n)
        How far each velocity carries each pair towards each other.
    travel : ndarray, shape (nv,)
        What was travelled; zero afterwards.
    tolerance : float
        The budget that counts as spent [m].
    due : ndarray of int, shape (n,)
        Receives the pairs whose budgets are spent, ascending, in its first places.
    """
    nv, n = reach.shape
    for k in range(nv):
        if travel[k] != 0.0:
            for i in range(n):
                budget[i] -= travel[k] * reach[k, i]
            travel[k] = 0.0
    count, spare = 0, np.inf
    for i in range(n):
        if budget[i] <= tolerance:
            due[count] = i
            count += 1
        else:
            spare = min(spare, budget[i] - tolerance)
    return count, spare


@kernel("Tuple((i8, b1))(i8[::1], f8[::1], f8, f8[::1], i8[::1])")
def sift(pair: Array, gap: Array, tolerance: float, budget: Array, near: Array) -> tuple[int, bool]:
    """Find the contacts within the tolerance; the budget of a pair that has none is its least gap.

    Parameters
    ----------
    pair, gap : ndarray, shape (k,)
        Contacts, pair after pair.
    tolerance : float
        Gap at and below which a contact is active [m].
    budget : ndarray, shape (n,)
        Of all pairs; written for those asked.
    near : ndarray of int, shape (k,)
        Receives which contacts are within the tolerance, in its first places.

    Returns
    -------
    count : int
        How many they are.
    vain : bool
        Whether some pair has none.
    """
    count, vain = 0, False
    for i in range(len(gap)):
        budget[pair[i]] = np.inf
    for i in range(len(gap)):
        budget[pair[i]] = min(budget[pair[i]], gap[i])
        if gap[i] <= tolerance:
            near[count] = i
            count += 1
    for i in range(len(gap)):
        vain = vain or budget[pair[i]] > tolerance
    return count, vain


def chosen(contacts: Contacts, index: Array, count: int) -> Contacts | None:
    """Return the contacts that the first places of `index` name, or None if there are none."""
    pair, gap, point, normal = contacts
    if count == len(gap):
        return contacts if count else None
    index = index[:count]
    return Contacts(pair.take(index), gap.take(index), point.take(index, 0), normal.take(index, 0)) if count else None


class Pairs(Rebuilt):
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
        self.first_number = 0
        self.names = tuple(names)
        self.restitution = restitution
        self._first_body = np.array([0 if s is None else s.body for s in first], dtype=np.intp)
        self._second_body = np.array([s.body for s in second], dtype=np.intp)
        self._pair: Array | None = None
        # which pairs are left out, and those due that are not
        self._resting: Array | None = None
        self._awake: tuple[Array, Array] | None = None
        self._budget = np.full(len(self.names), -np.inf)
        self._reckon(first, second)
        self.forget()

    def _reckon(self, first: Sequence[PlacedShape | None], second: Sequence[PlacedShape]) -> None:
        """Find out how fast each velocity can bring each pair nearer."""
        system = self.system
        reaches: dict[str, Array] = {}
        rows, envelope = [], np.zeros(system.nv)
        dense = len(second) * system.nv <= _DENSE_REACH
        for a, b in zip(first, second, strict=True):
            sides = [np.zeros(system.nv) if s is None else _reach(system, s, reaches) for s in (a, b)]
            # velocities that carry both sides leave their distance as it is
            row = np.where((sides[0] > 0.0) & (sides[1] > 0.0), 0.0, sides[0] + sides[1])
            np.maximum(envelope, row, out=envelope)
            rows.append(row if dense else _sparse().csr_array(row[None]))
        # shape (nv, n), dense or sparse
        self._reach = (
            np.array(rows).reshape(-1, system.nv).T.copy() if dense else _sparse().vstack(rows, format="csr").T
        )
        # bodies that travel less within a step do not pass through each other; nothing passes a half-space
        self.thickness = np.array(
            [np.inf if a is None else a.shape.inner + b.shape.inner for a, b in zip(first, second, strict=True)]
        )
        # no pair nears faster than the envelope says: while that has not used up the least budget of the pairs that
        # are not due, the same pairs are asked again and no budget is looked at
        self.envelope = envelope

    def forget(self) -> None:
        """Ask every pair next time."""
        self._budget[:] = -np.inf
        self._due = np.arange(len(self.names))
        self._pair, self._key = None, b""
        self.spare, self.busy = -np.inf, True

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
            Sum of |difference| over all that was travelled since budgets were last reckoned, zero afterwards; None asks
            every pair, `STILL` those that were due.
        """
        if travel is None:
            self.forget()
        elif travel.size:
            self._spend(tolerance, travel)
        due = self._due if self._resting is None else self._not_resting(self._resting)
        if not due.size:
            return None
        return self.rows(q, due, tolerance)

    def leave_out(self, still: Array | None) -> None:
        """Leave out the pairs of bodies that both stand still, shape (bodies,) of bool; None leaves out none."""
        self._resting = None if still is None else still[self._first_body] & still[self._second_body]
        self._awake = None

    def _not_resting(self, resting: Array) -> Array:
        # the same array again where nothing changed: what was gathered for it is found by that
        if self._awake is None or self._awake[0] is not self._due:
            self._awake = self._due, self._due[~resting[self._due]]
        return self._awake[1]

    def rows(self, q: Array, due: Array, tolerance: float) -> Rows | None:
        """Return the rows of some pairs within the tolerance; where a pair has none, its budget is known anew."""
        near, vain = self.near(q, due, tolerance)
        if vain:
            # it need not be asked next time
            self.spare = -np.inf
        if near is None:
            return None
        pair, gap, point, normal = near
        number, first, second, restitution = self._sides_of(pair)
        rows = self.system.separation_rows(q, first, second, point, normal)
        return Rows(number, gap, rows, restitution, point, normal)

    def near(self, q: Array, due: Array, tolerance: float) -> tuple[Contacts | None, bool]:
        """Return the contacts within the tolerance, and whether some pair has none; budgets are written."""
        return self._near(self.contacts(q, due, tolerance), tolerance)

    def _near(self, contacts: Contacts, tolerance: float) -> tuple[Contacts | None, bool]:
        index = np.empty(len(contacts.gap), np.int64)
        count, vain = sift(contacts.pair, contacts.gap, tolerance, self._budget, index)
        return chosen(contacts, index, count), vain

    def _sides_of(self, pair: Array) -> tuple[Array, Array, Array, Array]:
        """Return number, bodies and restitution of some pairs; often the same come again."""
        if pair is not self._pair:
            key = pair.tobytes()
            if key != self._key:
                self._key = key
                self._sides_and_e = (
                    pair + self.first_number,
                    self._first_body[pair],
                    self._second_body[pair],
                    self.restitution[pair],
                )
            self._pair = pair
        return self._sides_and_e

    def _spend(self, tolerance: float, travel: Array) -> None:
        """Bring the pairs whose budgets are spent up to date."""
        if isinstance(self._reach, np.ndarray):
            due = np.empty(len(self._budget), np.int64)
            count, self.spare = _spend(self._budget, self._reach, travel, tolerance, due)
            self._due = due[:count]
        else:
            self._budget -= travel @ self._reach
            travel[:] = 0.0
            spent = self._budget <= tolerance
            self._due = spent.nonzero()[0]
            self.spare = float(np.where(spent, np.inf, self._budget).min()) - tolerance
        self.busy = bool(self._due.size)

    @property
    def reach(self) -> Array:
        """How fast each velocity can bring each pair nearer, shape (n, nv)."""
        return self._reach.T if isinstance(self._reach, np.ndarray) else self._reach.T.toarray()

    def passable(self, q: Array, way: Array) -> tuple[Array, Array, Array]:
        """Return the pairs that may pass through each other on a way from q, how far each travels, and how thick it is.

        Parameters
        ----------
        q, way : ndarray, shapes (nq,) and (nv,)
            Configuration, and the tangent vector that leads on from it.
        """
        travel = np.asarray(np.abs(way) @ self._reach)
        pairs = np.flatnonzero(travel > self.thickness)
        return pairs, travel[pairs], self.thickness[pairs]

    def gaps(self, q: Array, pairs: Array) -> Array:
        """Return the signed distances of some pairs in ascending order, shape (k,) [m]."""
        return self.nearest(q, pairs).gap

    def sides(self, pair: Array) -> tuple[Array, Array]:
        """Return the two bodies of some pairs."""
        return self._first_body[pair], self._second_body[pair]

    def nearest(self, q: Array, pairs: Array) -> Contacts:
        """Return the nearest contact of each of some pairs in ascending order."""
        contacts = self.contacts(q, pairs, 0.0)
        order = np.lexsort((contacts.gap, contacts.pair))
        first = order[np.searchsorted(contacts.pair[order], pairs)]
        return Contacts(*(part[first] for part in contacts))

    def gap(self, t: float, q: Array) -> Array:
        """Return the signed distance of every pair, shape (m,) [m]."""
        return self.nearest(q, np.arange(len(self.names))).gap

    def gradient(self, t: float, q: Array) -> Array:
        """Return the gradient of every pair's distance, shape (m, nv)."""
        pair, _, point, normal = self.nearest(q, np.arange(len(self.names)))
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

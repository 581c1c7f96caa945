"""Pairs of shapes on bodies: which of them must be measured, and the rows of those that are near."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ...compiled import kernel
from ...geometry.shapes.shape_table import ShapeTable
from ...system import System
from ..family import ConstraintFamily
from ..rebuilt import Rebuilt
from ..relative_ways import PairBalls, balls_of_sides, relative_ways, shared_lengths, ways_of
from ..rows import Array, Rows
from .candidates import PairCandidates

# entries of the table of reaches up to which it is a dense array
_MOST_DENSE = 200_000


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


@kernel("Tuple((i8, b1))(i8[::1], f8[::1], f8, f8[::1], i8[::1])")
def filter_active(pair: Array, gap: Array, tolerance: float, clearance: Array, active: Array) -> tuple[int, bool]:
    """Find the contacts within the tolerance; the clearance of each measured pair becomes its least gap.

    Parameters
    ----------
    pair, gap : ndarray, shape (k,)
        Contacts, pair after pair.
    tolerance : float
        Gap at and below which a contact is active [m].
    clearance : ndarray, shape (n,)
        Of all pairs; receives the least gap of each measured pair [m].
    active : ndarray of int, shape (k,)
        Receives which contacts are within the tolerance, in its first places.

    Returns
    -------
    count : int
        How many contacts these are.
    any_empty : bool
        Whether a measured pair has no contact within the tolerance.
    """
    count, any_empty = 0, False
    for i in range(len(gap)):
        clearance[pair[i]] = np.inf
    for i in range(len(gap)):
        clearance[pair[i]] = min(clearance[pair[i]], gap[i])
        if gap[i] <= tolerance:
            active[count] = i
            count += 1
    for i in range(len(gap)):
        any_empty = any_empty or clearance[pair[i]] > tolerance
    return count, any_empty


def _take(contacts: Contacts, index: Array, count: int) -> Contacts | None:
    """Return the contacts in the first `count` places of `index`, or None if there are none."""
    pair, gap, point, normal = contacts
    if count == len(gap):
        return contacts if count else None
    index = index[:count]
    return Contacts(pair.take(index), gap.take(index), point.take(index, 0), normal.take(index, 0)) if count else None


class Pairs(Rebuilt, ConstraintFamily):
    """Pairs of placed shapes. Only pairs whose clearance is used up are measured; see `PairCandidates`.

    Parameters
    ----------
    system : System
        What moves the bodies.
    table : ShapeTable
        The shapes.
    sides : ndarray of int, shape (n, 2)
        The shapes of each pair in the table; -1 stands for a half-space of the world.
    restitution : ndarray, shape (n,)
        e of each pair.
    friction : ndarray, shape (n,), or float
        Coefficient of friction of each pair, or of all.
    """

    skips_resting = True
    isotropic = True
    # whether contacts depend on what is beside fixed shapes
    has_seams = False

    def __init__(
        self, system: System, table: ShapeTable, sides: Array, restitution: Array, friction: Array | float = 0.0
    ) -> None:
        self.system, self._shapes, self._sides = system, table, sides
        self.size, self.numbers = len(sides), np.arange(len(sides))
        self.restitution: Array = restitution
        self.friction = friction
        # a half-space is the last entry; it has no far side: no body passes through it
        self._first_body, self._second_body = np.append(table.body, 0)[sides.T]
        self.thickness: Array = np.add(*np.append(table.inner, np.inf)[sides.T])
        # the pairs of the last rows with their numbers, bodies and e, computed again only if the pairs differ
        self._last_pair, self._last_key = np.zeros(0, np.int64), b""
        self._constants = self._last_pair, self._first_body[:0], self._second_body[:0], self.restitution[:0]
        # which pairs are at rest; the last candidates and those of them that are not at rest
        self._resting: Array | None = None
        self._last_awake: tuple[Array, Array] | None = None
        # for queries without a cache: every pair is a candidate
        self._every = PairCandidates(self.size)

    @cached_property
    def _reach(self) -> Any:
        """The reach of each pair, shape (nv, n), dense or sparse."""
        # a velocity that moves both bodies moves them as one rigid body: their distance does not change
        if self.size * self.system.nv <= _MOST_DENSE:
            each = np.array([*_reaches(self.system, self._shapes), np.zeros(self.system.nv)])
            left, right = each[self._sides.T]
            return np.where((left > 0.0) & (right > 0.0), 0.0, left + right).T.copy()
        return relative_reaches(sparse_reaches(self.system, self._shapes), self._sides)

    @cached_property
    def _envelope(self) -> Array:
        reach = self._reach
        most = reach.max(axis=1, initial=0.0) if isinstance(reach, np.ndarray) else reach.max(axis=1).toarray()
        return np.asarray(most).reshape(-1)

    def envelope(self) -> Array:
        """Return the largest reach of any pair, shape (nv,)."""
        return self._envelope

    def reach(self) -> Array:
        """Return the reach of each pair, shape (n, nv)."""
        return self._reach.T if isinstance(self._reach, np.ndarray) else self._reach.T.toarray()

    def pair_candidates(self) -> PairCandidates:
        """Return a new table of the pairs, in which every pair is a candidate."""
        return PairCandidates(self.size, self._reach)

    def measure(self, q: Array, pairs: Array, tolerance: float) -> Contacts:
        """Return the contacts of the given pairs within the tolerance, and at least one of each pair."""
        raise NotImplementedError

    def contacts(self, t: float, q: Array, tolerance: float) -> Rows | None:
        """Return the rows of all pairs within the tolerance, or None."""
        return self.contacts_among(q, tolerance, self._every)

    def contacts_among(self, q: Array, tolerance: float, candidates: PairCandidates) -> Rows | None:
        """Return the rows of the candidates within the tolerance, or None; write the clearances of the candidates."""
        candidates.any_empty = False
        index = candidates.index if self._resting is None else self._not_resting(candidates.index, self._resting)
        return self._rows(q, index, tolerance, candidates) if index.size else None

    def skip_resting(self, resting: Array | None) -> None:
        """Leave out the pairs of bodies that are both at rest; see the base class."""
        self.some_rest = resting is not None
        self._resting = None if resting is None else resting[self._first_body] & resting[self._second_body]
        self._last_awake = None

    def _not_resting(self, index: Array, resting: Array) -> Array:
        # return the same array while nothing changes: `HalfSpaceContacts` compares it by identity
        if self._last_awake is None or self._last_awake[0] is not index:
            self._last_awake = index, index[~resting[index]]
        return self._last_awake[1]

    def _rows(self, q: Array, pairs: Array, tolerance: float, candidates: PairCandidates) -> Rows | None:
        """Return the rows of some pairs within the tolerance; see `contacts_among`."""
        near, candidates.any_empty = self._near(q, pairs, tolerance, candidates.clearance)
        if near is None:
            return None
        pair, gap, point, normal = near
        number, first, second, restitution = self._constants_of(pair)
        rows = self.system.separation_rows(q, first, second, point, normal)
        return Rows(number, gap, rows, restitution, point, normal)

    def _near(self, q: Array, pairs: Array, tolerance: float, clearance: Array) -> tuple[Contacts | None, bool]:
        """Return the contacts of some pairs within the tolerance, and whether a pair has none; write clearances."""
        return self._within(self.measure(q, pairs, tolerance), tolerance, clearance)

    def _within(self, contacts: Contacts, tolerance: float, clearance: Array) -> tuple[Contacts | None, bool]:
        index = np.empty(len(contacts.gap), np.int64)
        count, any_empty = filter_active(contacts.pair, contacts.gap, tolerance, clearance, index)
        return _take(contacts, index, count), any_empty

    def _constants_of(self, pair: Array) -> tuple[Array, Array, Array, Array]:
        """Return constraint numbers, both bodies and e of some pairs; the same arrays for the same pairs."""
        if pair is not self._last_pair:
            key = pair.tobytes()
            if key != self._last_key:
                self._last_key = key
                bodies = self._first_body[pair], self._second_body[pair]
                self._constants = self.numbers[pair], *bodies, self.restitution[pair]
            self._last_pair = pair
        return self._constants

    def bodies_of(self, numbers: Array) -> tuple[Array, Array]:
        """Return the first and the second body of some pairs, shapes (k,)."""
        return self._first_body[numbers], self._second_body[numbers]

    def passed_share(self) -> Array:
        """Return the reach divided by the thickness, shape (nv, n); see the base class."""
        return np.asarray(self.reach().T / self.thickness)

    def passable(self, q: Array, displacement: Array) -> tuple[Array, Array, Array]:
        """Return the pairs that may pass through each other, their travel and their thickness; see the base class."""
        pairs = np.flatnonzero(shared_lengths(self.system, displacement) @ self._reach > self.thickness)
        ways = ways_of(self.system, displacement, self._reach[:, pairs])
        travel = relative_ways(self.system, q, displacement, ways, self.balls_of(pairs))
        thickness = self.thickness[pairs]
        passing = travel > thickness
        return pairs[passing], travel[passing], thickness[passing]

    def balls_of(self, numbers: Array) -> PairBalls:
        """Return balls that hold the shapes of some pairs; half-spaces have none."""
        return balls_of_sides(self._shapes, self._sides[numbers])

    def reach_of(self, numbers: Array) -> Array:
        """Return the reach of some pairs, shape (k, nv)."""
        reach = self._reach[:, numbers].T
        return reach if isinstance(reach, np.ndarray) else np.asarray(reach.toarray())

    def nearest_of(self, t: float, q: Array, pairs: Array) -> tuple[Array, Array]:
        """Return signed distances and normals of some pairs in ascending order, shapes (k,) [m] and (k, 3)."""
        nearest = self.nearest(q, pairs)
        return nearest.gap, nearest.normal

    def nearest(self, q: Array, pairs: Array) -> Contacts:
        """Return the nearest contact of each of some pairs in ascending order."""
        contacts = self.measure(q, pairs, 0.0)
        order = np.lexsort((contacts.gap, contacts.pair))
        first = order[np.searchsorted(contacts.pair[order], pairs)]
        return Contacts(*(part[first] for part in contacts))

    def nearest_points(self, q: Array) -> tuple[Array, Array]:
        """Return point and normal of the nearest contact of every pair, shapes (n, 3)."""
        contacts = self.nearest(q, np.arange(self.size))
        return contacts.point, contacts.normal

    def gap(self, t: float, q: Array) -> Array:
        """Return the signed distance of every pair, shape (n,) [m]."""
        return self.nearest(q, np.arange(self.size)).gap

    def gradient(self, t: float, q: Array) -> Array:
        """Return the gradient of every pair's distance, shape (n, nv)."""
        return self._gradients(q, self.nearest(q, np.arange(self.size)))

    def _row_contacts(self, q: Array, rows: Array) -> Contacts:
        """Return the contacts of some rows of `row_table`: of each pair its nearest one."""
        return self.nearest(q, rows)

    def _gradients(self, q: Array, contacts: Contacts) -> Array:
        pair, _, point, normal = contacts
        gradient: Array = self.system.separation_rows(q, self._first_body[pair], self._second_body[pair], point, normal)
        return gradient

    def row_gap(self, t: float, q: Array, rows: Array) -> Array:
        """Return the gaps of some rows in ascending order, shape (k,) [m]."""
        return self._row_contacts(q, rows).gap

    def row_gradient(self, t: float, q: Array, rows: Array) -> Array:
        """Return the gradients of some rows, shape (k, nv)."""
        return self._gradients(q, self._row_contacts(q, rows))

    def row_points(self, t: float, q: Array, rows: Array) -> tuple[Array, Array]:
        """Return contact points and normals of some rows, shapes (k, 3)."""
        contacts = self._row_contacts(q, rows)
        return contacts.point, contacts.normal


def _reaches(system: System, table: ShapeTable) -> Iterator[Array]:
    """Yield the most that each velocity moves a point of each shape, shape (nv,)."""
    for s in table.placed:
        yield system.reach(s.body, s.position, s.shape.bound) if s.body else np.zeros(system.nv)


def sparse_reaches(system: System, table: ShapeTable) -> Any:
    """Return the most that each velocity moves a point of each shape, and a row of zeros, shape (s + 1, nv)."""
    # only scenes of many pairs need it, and its import is slow
    from scipy.sparse import csr_array, vstack

    return vstack([*(csr_array(r[None]) for r in _reaches(system, table)), csr_array((1, system.nv))], format="csr")


def relative_reaches(reaches: Any, sides: Array) -> Any:
    """Return the most that each velocity moves two shapes relative to each other, sparse, shape (nv, k).

    Parameters
    ----------
    reaches : sparse array
        The reach of each shape, shape (s, nv).
    sides : ndarray
        The two shapes of each pair, shape (k, 2).
    """
    left, right = (reaches[side] for side in sides.T)
    # a velocity that carries both moves them as one
    rows, both = left + right, (left > 0.0).multiply(right > 0.0)
    return (rows - rows.multiply(both)).T

"""The family of convex shapes against each other: closed forms, signed distances to rounding, and shared regions."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from ...geometry.broad.separating_axis import SeparatingAxes, carry_axes
from ...geometry.closed_form.primitive_pairs import NONE, PrimitivePairs
from ...geometry.narrow.collinear import keep_one_of_each_line
from ...geometry.narrow.pair_contacts import write_contacts
from ...geometry.narrow.pair_distances import distances_from_axes
from ...geometry.shapes.seams import uncovered
from ...geometry.shapes.shape_table import ShapeTable
from ...geometry.shapes.shapes import Capsule, Sphere
from ...system import System
from ..features.pair_features import FeatureRows, is_polyhedron
from ..features.round_features import is_round
from ..mechanism.pairs import AS_THEY_ARE, LEFT_TO_PYTHON, MOST_CONTACTS, ROUNDED, PairShapes
from ..row_table import RowTable
from ..rows import Rows
from .pairs import Array, Contacts, Pairs

# contact points of a pair for which there is room at first
_ROOM = 16
# contacts of more pairs are not kept while bodies stand still: of so many some body always moves
_MOST_KEPT = 1000
# placements are rounded to multiples of 1 / this (lengths in units of the shapes' size), about 1e-14, so that a body at
# rest has the same placement, bit by bit, at every step
_GRID = 2.0**47


class SignedDistances(Pairs):
    """Signed distances of pairs of convex shapes, to rounding.

    Parameters
    ----------
    system : System
        What moves the bodies.
    table, sides, restitution
        As `Pairs`.
    line : ndarray, shape (3,), optional
        The normal of the plane of a planar scene: of contact points on one line along it the first is kept.
    at_rest : bool
        Whether to keep the contacts of pairs, instead of computing them again, while their bodies stand still.
    numbers : ndarray of int, shape (n,), optional
        The numbers of the constraints; by default 0 to n - 1.
    friction
        As `Pairs`.
    """

    def __init__(
        self,
        system: System,
        table: ShapeTable,
        sides: Array,
        restitution: Array,
        line: Array | None = None,
        at_rest: bool = True,
        numbers: Array | None = None,
        friction: Array | float = 0.0,
    ) -> None:
        super().__init__(system, table, sides, restitution, friction)
        self.numbers = self.numbers if numbers is None else numbers
        self._at_rest = at_rest
        # the last pairs, tolerance and placements of their bodies, and the contacts found
        self.kept: tuple[tuple[bytes, float, bool, bytes], Contacts] | None = None
        self._grid = np.array([[_GRID]] * 3 + [[_GRID / table.unit]])
        self._cell = 1.0 / self._grid
        # the compiled loop of a single mechanism needs the kernels that measure anyway, and measured axes last longer
        self._axes = SeparatingAxes(table, sides, guesses=not system.single_mechanism)
        # during a query that knows them, the placements
        self._placed: Array | None = None
        self._closed = PrimitivePairs(table, sides)
        # of each pair the bounding radius of the smaller shape [m]
        self._bound = np.minimum(*table.bound[sides.T])
        self._flat = ~np.logical_or(*table.smooth[sides.T])
        self._line = np.zeros(3) if line is None else np.array(line, dtype=float)
        self._planar = line is not None
        # where fixed shapes touch each other: of each pair the shapes of the world, -1 for others
        some = len(table.seams.neighbour) > 0
        self._fixed = tuple(np.where(table.frame[sides.T] < 0, sides.T, -1)) if some else None
        # whether contacts depend on what is beside fixed shapes
        self.has_seams = some or any(len(one.beside) for one in table.placed)
        self._bounds = np.zeros(self.size)
        # pairs of spheres and capsules have a continuous gradient
        self.smooth: Array = self._closed.smooth
        self._some_smooth, self._is_smooth = bool(self.smooth.any()), self.smooth.tolist().__getitem__
        self._some_closed = bool((self._closed.form != NONE).any())

    @cached_property
    def names(self) -> tuple[str, ...]:  # type: ignore[override]
        """The name of each pair."""
        return tuple(self._shapes.name(a, b) for a, b in self._sides.tolist())

    def memory(self) -> tuple[Array, ...]:
        """Return the axes from which distances are searched, and the points at which climbs over hulls begin."""
        return self._axes.axis, self._axes.shapes.start

    def loop_tables(self) -> tuple[tuple[Array, ...], PairShapes]:
        """Return the shapes, and what else the compiled loop needs of the pairs; both share the axes."""
        n, axes = self.size, self._axes
        rooms: Any = np.zeros((2, len(axes.bodies), 4, 3))
        unresolved, closed, others, state = np.zeros((4, n), np.int64)
        mode = LEFT_TO_PYTHON if self._planar else ROUNDED if self._at_rest else AS_THEY_ARE
        found: Any = np.zeros(n), *np.zeros((2, n, 3)), state
        contacts: Any = np.zeros(MOST_CONTACTS, np.int64), np.zeros(MOST_CONTACTS), *np.zeros((2, MOST_CONTACTS, 3))
        fields: Any = (
            np.array(axes.bodies, dtype=np.int64), *rooms, unresolved, closed, others, axes.axis,
            self._closed.form, self.smooth, self._flat, self._bound, self._grid.ravel(), mode, self._bounds, *found,
            *contacts, self._shapes.seams,
        )  # fmt: skip
        return axes.tables, PairShapes(*fields)

    def keep_axes_of(self, other: SignedDistances) -> None:
        """Take over what another list of pairs of the same shapes knows of those that are in both."""
        before, axes = other._axes, self._axes
        carry_axes(other.numbers, before.axis, before.shapes.start, self.numbers, axes.axis, axes.shapes.start)

    def describe_paths(self) -> str:
        """Return in words how many pairs take which path."""
        closed = np.count_nonzero(self._closed.form)
        ways = (closed, "in closed form"), (self.size - closed, "by search from the last axis")
        return ", ".join(f"{n} {way}" for n, way in ways if n)

    def describe(self) -> str:
        """Return one line of `Problem.report()`, in words."""
        return f"{self.size} pair{'s' * (self.size != 1)} of shapes: {self.describe_paths()}"

    def row_table(self, t: float, q: Array) -> RowTable:
        """Return the table of the rows: one for each pair, its least distance."""
        first, second = self._sides.T
        flat, ball = np.array([[is_polyhedron(s), isinstance(s.shape, Sphere)] for s in self._shapes.placed]).T
        # the nearest point of a convex body to the centre of a ball moves without jumps
        smooth = self.smooth | (ball[first] & (flat | ball)[second]) | (flat[first] & ball[second])
        rounded = np.array([is_round(s) for s in self._shapes.placed])
        featured = (flat[first] | rounded[first]) & (flat[second] | rounded[second]) & ~self.smooth & (not self._planar)
        capsule = np.array([isinstance(s.shape, Capsule) for s in self._shapes.placed])
        featured &= flat[first] | flat[second] | (capsule[first] & capsule[second])
        if self._fixed is not None:
            # rows of a union begin and end where those of its parts do not
            beside = (np.diff(self._shapes.seams.first_neighbour) > 0)[self._sides].any(axis=1)
            smooth, featured = smooth & ~beside, featured & ~beside
        return RowTable(np.arange(self.size), self.restitution, smooth, self.reach(), self.thickness, featured)

    def feature_rows(self, q: Array, row: int, tolerance: float, features: FeatureRows) -> list[int]:
        pair, shapes = np.array([row]), (self._shapes, self._sides[row], q)
        # beyond the tolerance the normal is that of the distance, and not that of a face nearby
        nearest = self.measure(q, pair, -np.inf)
        one = features.add(*shapes, nearest.point[0], nearest.normal[0], alone=True)
        if one is not None:
            return [one]
        contacts = self.measure(q, pair, tolerance)
        # the corners of the region that two shapes share lie on either side of the tolerance
        near = contacts.gap <= max(tolerance, float(nearest.gap[0]))
        found = [features.add(*shapes, *each) for each in zip(contacts.point[near], contacts.normal[near], strict=True)]
        if None in found:
            # beside nearly parallel faces the region that two shapes share has other corners
            normal = nearest.normal[0]
            found = [features.add(*shapes, point, normal) for point in features.shared(*shapes, normal)]
        return [] if None in found else [k for k in dict.fromkeys(found) if k is not None]

    def contacts_of_placed(self, q: Array, places: Array, tolerance: float) -> Rows | None:
        """Return what `contacts` returns, given the placements of the table's bodies, shape (b, 4, 3)."""
        self._placed = places
        try:
            return self.contacts(0.0, q, tolerance)
        finally:
            self._placed = None

    def _near(self, q: Array, pairs: Array, tolerance: float, clearance: Array) -> tuple[Contacts | None, bool]:
        places = self.system.placements(q, self._axes.bodies) if self._placed is None else self._placed
        left = self._axes.clear(places, pairs, tolerance, clearance)
        if not left.size:
            return None, True
        contacts, any_empty = self._within(self._measure_all(places, left, tolerance, rough=True), tolerance, clearance)
        return self._of_unions(contacts), any_empty or len(left) < len(pairs)

    def _of_unions(self, contacts: Contacts | None) -> Contacts | None:
        """Return those of some contacts that the unions of fixed shapes have; see `geometry.shapes.seams`."""
        if contacts is None or self._fixed is None:
            return contacts
        first, second = (side[contacts.pair] for side in self._fixed)
        kept = np.empty(len(first), np.int64)
        count = uncovered(self._shapes.seams, first, second, *contacts[1:], kept)
        return Contacts(*(part[kept[:count]] for part in contacts)) if count else None

    def measure(self, q: Array, pairs: Array, tolerance: float) -> Contacts:
        return self._measure_all(self.system.placements(q, self._axes.bodies), pairs, tolerance)

    def row_lower_bound(self, t: float, q: Array, rows: Array) -> Array:
        return self._lower_bound(q, rows)

    def _lower_bound(self, q: Array, pairs: Array) -> Array:
        """Return lower bounds of some signed distances: positive by an axis that separates, or the distances."""
        places = self.system.placements(q, self._axes.bodies)
        left = self._axes.clear(places, pairs, 0.0, self._bounds)
        if left.size:
            contacts = self._measure_all(places, left, 0.0, rough=True)
            self._bounds[left] = np.inf
            np.minimum.at(self._bounds, contacts.pair, contacts.gap)
        return self._bounds[pairs]

    def passable(self, q: Array, displacement: Array) -> tuple[Array, Array, Array]:
        pairs, travel, thickness = super().passable(q, displacement)
        # drop the pairs that are farther apart than they travel: these are most
        near = self._lower_bound(q, pairs) <= travel if pairs.size else np.zeros(0, bool)
        return pairs[near], travel[near], thickness[near]

    def _measure_all(self, places: Array, pairs: Array, tolerance: float, rough: bool = False) -> Contacts:
        """Return the contacts of some pairs; if `rough`, gaps beyond the tolerance are lower bounds."""
        if not self._at_rest or (self._some_smooth and all(map(self._is_smooth, pairs.tolist()))):
            return self._measure(places, pairs, tolerance, rough)
        places = np.rint(places * self._grid)
        places *= self._cell
        if len(pairs) > _MOST_KEPT:
            return self._measure(places, pairs, tolerance, rough)
        # for the world the last placement is taken, which does no harm
        where = pairs.tobytes(), tolerance, rough, places[self._axes.frame[self._axes.shapes.sides[pairs]]].tobytes()
        if self.kept is None or self.kept[0] != where:
            self.kept = where, self._measure(places, pairs, tolerance, rough)
        return self.kept[1]

    def _measure(self, places: Array, pairs: Array, tolerance: float, rough: bool) -> Contacts:
        """Return the contacts of some pairs, in closed form where there is one; see `_measure_all`."""
        if not self._some_closed:
            return self._search(places, pairs, tolerance, rough)
        closed = self._closed.form[pairs] != NONE
        if not closed.any():
            return self._search(places, pairs, tolerance, rough)
        found = self._measure_closed(places, pairs if closed.all() else pairs[closed], tolerance)
        if closed.all():
            return found
        other = self._search(places, pairs[~closed], tolerance, rough)
        parts = [np.concatenate(part) for part in zip(found, other, strict=True)]
        order = np.argsort(parts[0], kind="stable")
        return Contacts(*(part[order] for part in parts))

    def _measure_closed(self, places: Array, pairs: Array, tolerance: float) -> Contacts:
        """Return the contacts of some pairs that have a closed form."""
        found = Contacts(*self._closed.contacts(places, pairs, tolerance))
        self._axes.keep(places, pairs, found.normal[np.searchsorted(found.pair, pairs)])
        return self._one_of_each_line(found) if self._planar and len(found.gap) > len(pairs) else found

    def _one_of_each_line(self, found: Contacts) -> Contacts:
        """Keep in a planar scene one contact of each pair on each line along its normal."""
        kept = np.empty(len(found.gap), np.int64)
        kept = kept[: keep_one_of_each_line(found.pair, found.point, self._line, kept)]
        return Contacts(*(part[kept] for part in found))

    def _search(self, places: Array, pairs: Array, tolerance: float, rough: bool) -> Contacts:
        """Return the contacts of some pairs that have no closed form."""
        axes, n = self._axes, len(pairs)
        normal = np.empty((n, 3))
        found = np.empty(n), normal, np.empty((n, 3)), np.empty(n, np.int64)
        shared = places, axes.tables, self._bound
        distances_from_axes(*shared, pairs, axes.axis, tolerance if rough else np.inf, *found)
        axes.keep(places, pairs, normal)
        room = _ROOM * n
        while True:
            rows = np.empty(room, np.int64), np.empty(room), np.empty((room, 3)), np.empty((room, 3))
            total = write_contacts(*shared, self._flat, pairs, tolerance, *found, *rows)
            if total >= 0:
                contacts = Contacts(*(part[:total] for part in rows))
                return self._one_of_each_line(contacts) if self._planar and total > n else contacts
            room *= 4

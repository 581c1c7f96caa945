"""The family of convex shapes against each other: closed forms, signed distances to rounding, and shared regions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..geometry.coal_distance import CoalDistances
from ..geometry.collinear import keep_one_of_each_line
from ..geometry.pair_contacts import write_contacts
from ..geometry.pair_distances import distances_from_axes, distances_from_normals
from ..geometry.primitive_pairs import NONE, PrimitivePairs
from ..geometry.refined_distance import FAILED
from ..geometry.separating_axis import SeparatingAxes
from ..geometry.shapes import PlacedShape, length_unit
from ..system import System
from .family import RowTable
from .pairs import Array, Contacts, Pairs

# contact points of a pair for which there is room at first
_ROOM = 16
# placements are rounded to multiples of 1 / this (lengths in units of the shapes' size), about 1e-14, so that a body at
# rest has the same placement, bit by bit, at every step
_GRID = 2.0**47


class SignedDistances(Pairs):
    """Signed distances of pairs of convex shapes, to rounding.

    Parameters
    ----------
    system : System
        What moves the bodies.
    first, second : sequence of PlacedShape
        The two shapes of each pair.
    names, restitution
        As `Pairs`.
    line : ndarray, shape (3,), optional
        The normal of the plane of a planar scene: of contact points on one line along it the first is kept.
    at_rest : bool
        Whether to keep the contacts of pairs, instead of computing them again, while their bodies stand still.
    unit : float, optional
        A power of two about as large as the shapes [m]; by default found from these shapes.
    geometries : dict, optional
        Coal geometries by shape and unit, which several families may share.
    """

    def __init__(
        self,
        system: System,
        first: Sequence[PlacedShape],
        second: Sequence[PlacedShape],
        names: Sequence[str],
        restitution: Array,
        line: Array | None = None,
        at_rest: bool = True,
        unit: float | None = None,
        geometries: dict[Any, Any] | None = None,
    ) -> None:
        super().__init__(system, first, second, names, restitution)
        self._at_rest = at_rest
        # the last pairs, tolerance and placements of their bodies, and the contacts found
        self._last: tuple[tuple[bytes, float, bool, bytes], Contacts] | None = None
        placed = {s.name: s for s in (*first, *second)}
        shapes, number = list(placed.values()), {name: k for k, name in enumerate(placed)}
        sides = [(number[a.name], number[b.name]) for a, b in zip(first, second, strict=True)]
        grid = length_unit(s.shape.bound for s in shapes) if unit is None else unit
        self._grid = np.array([[_GRID]] * 3 + [[_GRID / grid]])
        self._cell = 1.0 / self._grid
        self._axes = SeparatingAxes(shapes, np.array(sides, dtype=np.int64).reshape(-1, 2))
        self._closed = PrimitivePairs(shapes, self._axes.shapes)
        self._coal = CoalDistances(shapes, self._axes, self.names, {} if geometries is None else geometries)
        self._flat = np.array([not (shapes[a].shape.smooth or shapes[b].shape.smooth) for a, b in sides], dtype=bool)
        self._line = np.zeros(3) if line is None else np.array(line, dtype=float)
        self._planar = line is not None
        self._bounds = np.empty(len(sides))
        # pairs of spheres and capsules have a continuous gradient
        self.smooth: Array = self._closed.smooth
        self._some_smooth, self._is_smooth = bool(self.smooth.any()), self.smooth.tolist().__getitem__
        self._some_closed = bool((self._closed.form != NONE).any())

    def describe(self) -> str:
        """Return one line of `Problem.report()`, in words."""
        return f"{self.size} pairs of shapes"

    def row_table(self, t: float, q: Array) -> RowTable:
        """Return the table of the rows: one for each pair, its least distance."""
        return RowTable(np.arange(self.size), self.restitution, self.smooth, self.reach(), self.thickness)

    def _near(self, q: Array, pairs: Array, tolerance: float, clearance: Array) -> tuple[Contacts | None, bool]:
        places = self.system.placements(q, self._axes.bodies)
        left = self._axes.clear(places, pairs, tolerance, clearance)
        if not left.size:
            return None, True
        contacts, any_empty = self._within(self._measure_all(places, left, tolerance, rough=True), tolerance, clearance)
        return contacts, any_empty or len(left) < len(pairs)

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
        # for the world the last placement is taken, which does no harm
        where = pairs.tobytes(), tolerance, rough, places[self._axes.frame[self._axes.shapes.sides[pairs]]].tobytes()
        if self._last is None or self._last[0] != where:
            self._last = where, self._measure(places, pairs, tolerance, rough)
        return self._last[1]

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
        axes, sizes, n = self._axes, self._coal, len(pairs)
        distance, normal, middle = np.empty(n), np.empty((n, 3)), np.zeros((n, 3))
        state, unknown = np.empty(n, np.int64), np.empty(n, np.int64)
        shared, found = (places, axes.tables, sizes.bound), (distance, normal, middle, state)
        failed = distances_from_axes(*shared, pairs, axes.axis, *found, unknown)
        if failed:
            unknown = unknown[:failed]
            for i in unknown.tolist():
                distance[i] = sizes.approximate(places, pairs.item(i), normal[i])
            failed = distances_from_normals(*shared, pairs, unknown, tolerance if rough else np.inf, *found)
        for i in (state == FAILED).nonzero()[0].tolist() if failed else ():
            distance[i], normal[i], middle[i], state[i] = sizes.measure(places, pairs.item(i))
        axes.keep(places, pairs, normal)
        room = _ROOM * n
        while True:
            rows = np.empty(room, np.int64), np.empty(room), np.empty((room, 3)), np.empty((room, 3))
            total = write_contacts(*shared, sizes.unit, self._flat, pairs, tolerance, *found, *rows)
            if total >= 0:
                contacts = Contacts(*(part[:total] for part in rows))
                return self._one_of_each_line(contacts) if self._planar and total > n else contacts
            room *= 4

"""The family of convex shapes against each other: refined signed distances of Coal, and patches of parallel faces."""

from __future__ import annotations

from collections.abc import Sequence
from math import frexp
from typing import Any

import coal
import numpy as np

from ..errors import MbviError
from ..geometry.pair_contacts import COAL, distances_from_axes, distances_from_normals, write_contacts
from ..geometry.polyhedron_overlap import overlap
from ..geometry.refined_distance import FAILED, UNIQUE, refined
from ..geometry.separating_axis import SeparatingAxes, place_shape
from ..geometry.shapes import Box, Cylinder, Hull, PlacedShape, Sphere, length_unit
from ..geometry.sphere_capsule import SphereCapsulePairs, out_of_cylinder
from ..system import System
from .family import RowTable
from .pairs import Array, Contacts, Pairs

# Tolerances for Coal, in units of the pair's size. At Coal's default, normals of curved shapes are wrong in the third
# digit. At the fine one, about one penetration depth in some hundred is wrong by an order of magnitude, or not finite
_FINE, _ROBUST = 1e-9, 1e-6
# lengths below are relative to the bounding radius of the smaller shape
# how much deeper the fine answer may be than the robust one
_AGREEMENT = 1e-4
# by how much a refined distance may be below Coal's
_REFINED = 1e-5
# contact points of a pair for which there is room at first
_ROOM = 16
# placements are rounded to multiples of 1 / this (lengths in units of the shapes' size), about 1e-14, so that a body at
# rest has the same placement, bit by bit, at every step
_GRID = 2.0**47


class SignedDistances(Pairs):
    """Signed distances of pairs of convex shapes: Coal's, refined to rounding; closed forms for spheres and capsules.

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
        Whether to keep the contacts of a pair, instead of computing them again, while both bodies stand still.
    unit : float, optional
        A power of two about as large as the shapes [m]; by default found from these shapes.
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
    ) -> None:
        super().__init__(system, first, second, names, restitution)
        self._at_rest = at_rest
        # the last pairs, tolerance and placements of their bodies, and the contacts found
        self._last: tuple[tuple[bytes, float, bool, bytes], Contacts] | None = None
        placed = {s.name: s for s in (*first, *second)}
        self._placed = list(placed.values())
        number = {name: k for k, name in enumerate(placed)}
        self._sides = [(number[a.name], number[b.name]) for a, b in zip(first, second, strict=True)]
        self._bound = [min(a.shape.bound, b.shape.bound) for a, b in zip(first, second, strict=True)]
        # Coal gets each shape in the unit of its pair, a power of two: one geometry for each shape and unit
        self._unit = [2.0 ** frexp(bound)[1] for bound in self._bound]
        scaled: dict[tuple[int, float], int] = {}
        self._scaled_sides = [
            tuple(scaled.setdefault((side, unit), len(scaled)) for side in sides)
            for sides, unit in zip(self._sides, self._unit, strict=True)
        ]
        self._scaled = list(scaled)
        self._geometry = [self._coal(self._placed[side], unit) for side, unit in self._scaled]
        self._distance = [coal.ComputeDistance(self._geometry[a], self._geometry[b]) for a, b in self._scaled_sides]
        grid = length_unit(s.shape.bound for s in self._placed) if unit is None else unit
        self._grid = np.array([[_GRID]] * 3 + [[_GRID / grid]])
        self._cell = 1.0 / self._grid
        self._requests, self._results = [], [coal.DistanceResult(), coal.DistanceResult()]
        for accuracy in (_FINE, _ROBUST):
            request = coal.DistanceRequest()
            request.gjk_tolerance = request.epa_tolerance = accuracy
            self._requests.append(request)
        shapes = [(self._placed[a].shape, self._placed[b].shape) for a, b in self._sides]
        self._sphere_cylinder = [{type(a), type(b)} == {Sphere, Cylinder} for a, b in shapes]
        self._flat = np.array([not (a.smooth or b.smooth) for a, b in shapes], dtype=bool)
        self._side_of_face = np.full(len(shapes), -1)
        self._sizes = np.array(self._bound), np.array(self._unit)
        self._both = both = np.array(self._sides, dtype=np.int64).reshape(-1, 2)
        self._axes = SeparatingAxes(self._placed, both)
        self._line = np.zeros(3) if line is None else np.array(line, dtype=float)
        self._bounds = np.empty(len(self._sides))
        self._closed_form = SphereCapsulePairs(self._placed, self._axes.frame, both)
        # pairs of spheres and capsules have a continuous gradient
        self.smooth: Array = self._closed_form.closed_form
        self._is_smooth = self.smooth.tolist().__getitem__
        self._pose = [coal.Transform3s() for _ in self._scaled]
        # side, scaled side and unit of the two shapes of each pair
        self._posed = [
            [(*one, unit) for one in zip(sides, scaled_sides, strict=True)]
            for sides, scaled_sides, unit in zip(self._sides, self._scaled_sides, self._unit, strict=True)
        ]
        self._world = np.empty((4, 3))

    def _coal(self, placed: PlacedShape, unit: float) -> Any:
        return placed.shape.coal(unit)

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

    def _place(self, places: Array, pair: int) -> None:
        """Set the poses of the two shapes of a pair by the placements of their bodies."""
        for side, scaled, unit in self._posed[pair]:
            place_shape(places, self._axes.frame, self._axes.shapes.fixed, side, self._world)
            self._pose[scaled].setTransform(self._world[:3].T, self._world[3] / unit)

    def _measure_all(self, places: Array, pairs: Array, tolerance: float, rough: bool = False) -> Contacts:
        """Return the contacts of some pairs; if `rough`, gaps beyond the tolerance are lower bounds."""
        if all(map(self._is_smooth, pairs.tolist())):
            found = self._closed_form.contacts(places, pairs)
            # concentric spheres have no normal in closed form; Coal returns one
            if found is not None:
                self._axes.keep(places, pairs, found[2])
                return Contacts(pairs, *found)
        if not self._at_rest:
            return self._measure(places, pairs, tolerance, rough)
        places = np.round(places * self._grid)
        places *= self._cell
        # of bodies of the world the last placement is taken, which does no harm
        where = pairs.tobytes(), tolerance, rough, places[self._axes.frame[self._both[pairs]]].tobytes()
        if self._last is None or self._last[0] != where:
            self._last = where, self._measure(places, pairs, tolerance, rough)
        return self._last[1]

    def _measure(self, places: Array, pairs: Array, tolerance: float, rough: bool) -> Contacts:
        """Return the contacts of some pairs; see `_measure_all`."""
        axes, n = self._axes, len(pairs)
        distance, normal, middle = np.empty(n), np.empty((n, 3)), np.zeros((n, 3))
        state, count = np.empty(n, np.int64), np.empty(n, np.int64)
        tables = places, *axes.shapes, axes.sides, axes.start
        distances_from_axes(*tables, axes.axis, self._sizes[0], pairs, distance, normal, middle, state)
        if (state == FAILED).any():
            unknown = (state == FAILED).nonzero()[0]
            least = self._ask_coal(places, pairs, unknown.tolist(), distance, normal)
            enough = tolerance if rough else np.inf
            search = places, *axes.shapes[:7], axes.sides, axes.start
            distances_from_normals(*search, pairs, unknown, least, enough, distance, normal, middle, state)
            for i in (state == FAILED).nonzero()[0].tolist():
                distance[i], normal[i], middle[i], state[i] = self._refined_distance(pairs.item(i), places)
        axes.keep(places, pairs, normal)
        room = _ROOM * n
        while True:
            gap, point = np.empty(room), np.empty((room, 3))
            total = write_contacts(
                *tables, *self._sizes, self._flat, self._line, self._side_of_face,
                pairs, tolerance, distance, normal, middle, state, count, gap, point,
            )  # fmt: skip
            if total >= 0:
                break
            room *= 4
        return Contacts(np.repeat(pairs, count), gap[:total], point[:total], np.repeat(normal, count, axis=0))

    def _ask_coal(self, places: Array, pairs: Array, unknown: list[int], distance: Array, normal: Array) -> Array:
        """Write Coal's distances and normals of some of the pairs; return lower bounds of their distances."""
        request, result = self._requests[1], self._results[1]
        error = np.empty(len(unknown))
        for j, i in enumerate(unknown):
            k = pairs.item(i)
            self._place(places, k)
            a, b = self._scaled_sides[k]
            result.clear()
            distance[i] = self._distance[k](self._pose[a], self._pose[b], request, result) * self._unit[k]
            normal[i] = result.normal
            # for a ball in a cylinder Coal is wrong, so that its answer must not be refined
            wrong = self._sphere_cylinder[k] and distance.item(i) < 0.0
            error[j] = np.nan if wrong else _REFINED * self._bound[k]
        return error

    def _refined_distance(self, k: int, places: Array) -> tuple[float, Array, Array, int]:
        """Return signed distance, unit normal, midpoint and state of one pair; see `geometry.pair_contacts`.

        The refinement starts from Coal's normal: at the robust tolerance first, then at the fine one. If both fail,
        Coal's own answer is returned.
        """
        self._place(places, k)
        a, b = self._scaled_sides[k]
        unit, (fine, robust), (result, second) = self._unit[k], self._requests, self._results
        for request in (robust, fine):
            second.clear()
            distance = self._distance[k](self._pose[a], self._pose[b], request, second) * unit
            if distance < 0.0 and self._sphere_cylinder[k]:
                return *self._ball_at_cylinder(k), UNIQUE
            normal = np.array(second.normal)
            found, exact, point = refined(self._axes, places, k, normal)
            if found != FAILED and exact >= distance - _REFINED * self._bound[k]:
                return exact, normal, point, found
        result.clear()
        distance = self._distance[k](self._pose[a], self._pose[b], fine, result)
        if distance < 0.0:
            second.clear()
            check = self._distance[k](self._pose[a], self._pose[b], robust, second)
            # the depth is the least over all directions, so that the deeper of two answers is wrong
            if distance < check - _AGREEMENT * self._bound[k] / unit:
                distance, result = check, second
            if not abs(distance) < 1e100:
                return *self._overlap(k), COAL
        return distance * unit, np.array(result.normal), _midway(result) * unit, COAL

    def _place_of(self, k: int, side: int) -> tuple[Array, Array]:
        """Return rotation and origin of one side of a pair, shapes (3, 3) and (3,)."""
        pose = self._pose[self._scaled_sides[k][side]]
        return pose.getRotation(), pose.getTranslation() * self._unit[k]

    def _overlap(self, k: int) -> tuple[float, Array, Array]:
        """Return signed distance, normal and point of two polyhedra whose depth Coal does not find."""
        a, b = (self._placed[side].shape for side in self._sides[k])
        if not (isinstance(a, Box | Hull) and isinstance(b, Box | Hull)):
            raise MbviError(f"{self.names[k]}: Coal finds no penetration depth; take a smaller step or simpler shapes")
        places = [self._place_of(k, side) for side in (0, 1)]
        first, second = (np.concatenate([R.T, origin[None]]) for R, origin in places)
        return overlap(a, first, b, second)

    def _ball_at_cylinder(self, k: int) -> tuple[float, Array, Array]:
        """Return signed distance, normal and point of a sphere and a cylinder that overlap, in closed form."""
        sides = [self._placed[side].shape for side in self._sides[k]]
        swapped = isinstance(sides[0], Sphere)
        ball, cylinder = (0, 1) if swapped else (1, 0)
        centre, (R, origin) = self._place_of(k, ball)[1], self._place_of(k, cylinder)
        size, radius = sides[cylinder], sides[ball].bound
        assert isinstance(size, Cylinder)
        distance, local = out_of_cylinder(R.T @ (centre - origin), size.radius, size.length)
        out = R @ local
        return distance - radius, -out if swapped else out, centre - 0.5 * (distance + radius) * out


def _midway(result: coal.DistanceResult) -> Array:
    """Return the midpoint of the two nearest points."""
    return np.asarray(0.5 * (result.getNearestPoint1() + result.getNearestPoint2()))

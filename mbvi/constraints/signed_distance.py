"""The family of convex shapes against each other: Coal's signed distances, and all points that two faces share."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, frexp
from typing import Any, NamedTuple

import coal
import numpy as np

from ..errors import MbviError
from ..geometry.collinear import unique_along
from ..geometry.faces import most_facing
from ..geometry.patches import PatchFinder
from ..geometry.polyhedron_overlap import overlap
from ..geometry.refined_distance import FAILED, FLAT, refined, separated
from ..geometry.separating_axis import SeparatingAxes
from ..geometry.shapes import Box, Cylinder, Ellipsoid, Hull, PlacedShape, Sphere, length_unit
from ..geometry.sphere_capsule import Balls, out_of_cylinder
from ..system import System
from .family import RowTable
from .pairs import Array, Contacts, Pairs

# Coal's tolerances, which are absolute: it is given geometry in units of the pair's size. At its own, normals of curved
# shapes are wrong in the third digit; at a fine one its penetration depth fails once in some hundred times, by an order
# of magnitude or outright
_FINE, _ROBUST = 1e-9, 1e-6
# how much deeper the fine answer may be than the robust one, in radii of the smaller shape
_AGREEMENT = 1e-4
# how far Coal's normal may be off where the distance vanishes, and where it does not [rad]
_MOST_TURN, _LEAST_TURN = 0.3, 1e-5
# how deep below the touching plane a vertex may lie and still be looked at, in radii of the smaller shape
_PATCH_DEPTH = 0.02
# by how much less a patch's deepest corner may be in than the shapes are, in the same radii
_CORNER = 1e-6
_NO_POINT = np.zeros(3)
# by how much a refined distance may be below Coal's, in the same radii
_REFINED = 1e-5
# cosine of the angle within which a face is looked at for the normal, and distances that are equal, in the same radii
_SAME_FACE, _EQUAL = cos(1e-3), 1e-8
# what places are rounded to where contacts are kept at rest, so that rounding is no motion: some 1e-14, of lengths in
# units of the shapes' size
_GRID = 2.0**47


class _Kept(NamedTuple):
    """What was found of a pair: where its bodies stood, if their patch was looked for, and its contacts.

    `rough` are those whose distance is only known to be at least `distance`.
    """

    where: bytes
    patched: bool
    rough: bool
    distance: float
    axis: Array
    gap: list[float]
    point: list[Array]
    normal: Array

    def holds(self, where: bytes, tolerance: float, rough: bool) -> bool:
        """Return whether the bodies still stand there, and as much would be looked for as was."""
        return self.where == where and self.patched == (self.distance <= tolerance) and (rough or not self.rough)


class SignedDistances(Pairs):
    """Coal's signed distance of each pair, with kept functors.

    Parameters
    ----------
    system : System
        What moves the bodies.
    first, second : sequence of PlacedShape
        The two shapes of each pair.
    names, restitution
        As `Pairs`.
    line : ndarray, shape (3,), optional
        The normal of the plane that all moves in: of contact points in line with it one is taken.
    at_rest : bool
        Whether what is known of a pair is kept while both bodies stand still.
    unit : float, optional
        A power of two about as large as the shapes [m]; by default from the shapes given.
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
        self._line, self._at_rest = line, at_rest
        self._kept: dict[int, _Kept] = {}
        placed = {s.name: s for s in (*first, *second)}
        self._placed = list(placed.values())
        number = {name: k for k, name in enumerate(placed)}
        self._sides = [(number[a.name], number[b.name]) for a, b in zip(first, second, strict=True)]
        self._bound = [min(a.shape.bound, b.shape.bound) for a, b in zip(first, second, strict=True)]
        # shapes in units of each pair's size, which differ by powers of two: numbers and poses of these
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
        self._patches = PatchFinder(self._geometry)
        shapes = [(self._placed[a].shape, self._placed[b].shape) for a, b in self._sides]
        self._curved = [a.smooth or b.smooth for a, b in shapes]
        # of the faces that a normal may stand for; None where a shape has none
        self._normals = [s.shape.faces[0].copy() if hasattr(s.shape, "faces") else None for s in self._placed]
        self._round_ends = [{type(a), type(b)} == {Sphere, Cylinder} for a, b in shapes]
        self._faced = [self._normals[a] is not None or self._normals[b] is not None for a, b in self._sides]
        self._both = both = np.array(self._sides, dtype=np.int64).reshape(-1, 2)
        self._axes = SeparatingAxes(self._placed, both)
        self._frames = [[frame for frame in self._axes.frame[list(s)].tolist() if frame >= 0] for s in self._sides]
        self._bounds = np.empty(len(self._sides))
        self._balls = Balls(self._placed, self._axes.frame, both)
        # pairs of spheres and capsules have a continuous gradient
        self.smooth: Array = self._balls.are
        self._is_smooth = self._balls.are.tolist().__getitem__
        self._pose = [coal.Transform3s() for _ in self._scaled]
        for (side, unit), pose in zip(self._scaled, self._pose, strict=True):
            placed_shape = self._placed[side]
            if placed_shape.body == 0:
                pose.setTransform(placed_shape.rotation, placed_shape.position / unit)

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
        asked = self._axes.clear(places, pairs, tolerance, clearance)
        if not asked.size:
            return None, True
        contacts, any_empty = self._within(self._measured(places, asked, tolerance, rough=True), tolerance, clearance)
        return contacts, any_empty or len(asked) < len(pairs)

    def measure(self, q: Array, pairs: Array, tolerance: float) -> Contacts:
        return self._measured(self.system.placements(q, self._axes.bodies), pairs, tolerance)

    def row_lower_bound(self, t: float, q: Array, rows: Array) -> Array:
        return self._lower_bound(q, rows)

    def _lower_bound(self, q: Array, pairs: Array) -> Array:
        """Return lower bounds of some signed distances: positive by an axis that separates, or the distances."""
        places = self.system.placements(q, self._axes.bodies)
        asked = self._axes.clear(places, pairs, 0.0, self._bounds)
        if asked.size:
            contacts = self._measured(places, asked, 0.0, rough=True)
            self._bounds[asked] = np.inf
            np.minimum.at(self._bounds, contacts.pair, contacts.gap)
        return self._bounds[pairs]

    def passable(self, q: Array, displacement: Array) -> tuple[Array, Array, Array]:
        pairs, travel, thickness = super().passable(q, displacement)
        # most pairs that could travel so far are farther apart than that
        near = self._lower_bound(q, pairs) <= travel if pairs.size else np.zeros(0, bool)
        return pairs[near], travel[near], thickness[near]

    def _place(self, places: Array, pairs: list[int]) -> None:
        """Bring the poses of the shapes in the given pairs to where their bodies are."""
        for k in {scaled for pair in pairs for scaled in self._scaled_sides[pair]}:
            side, unit = self._scaled[k]
            placed, frame = self._placed[side], self._axes.frame.item(side)
            if frame >= 0:
                turn = places[frame, :3].T
                self._pose[k].setTransform(turn @ placed.rotation, (turn @ placed.position + places[frame, 3]) / unit)

    def _measured(self, places: Array, pairs: Array, tolerance: float, rough: bool = False) -> Contacts:
        """Return the contacts of some pairs; `rough` where a bound of what exceeds the tolerance will do."""
        if all(map(self._is_smooth, pairs.tolist())):
            balls = self._balls.contacts(places, pairs)
            # of balls about one centre Coal knows a way apart
            if balls is not None:
                self._axes.keep(places, pairs, balls[2])
                return Contacts(pairs, *balls)
        if self._at_rest:
            places = np.round(places * self._grid)
            places *= self._cell
        pair: list[int] = []
        gap: list[float] = []
        point: list[Array] = []
        normal: list[Array] = []
        asked = pairs.tolist()
        where = {k: places[self._frames[k]].tobytes() for k in asked}
        kept_of = self._kept
        known = {k: kept_of[k] for k in asked if k in kept_of and kept_of[k].holds(where[k], tolerance, rough)}
        self._place(places, [k for k in asked if k not in known])
        for k in asked:
            kept = known.get(k)
            if kept is None:
                kept = self._found(k, places, where[k], tolerance, rough)
                if self._at_rest:
                    self._kept[k] = kept
                self._axes.keep(places, np.array([k]), kept.axis[None])
            gap.extend(kept.gap)
            point.extend(kept.point)
            pair.extend([k] * len(kept.gap))
            normal.extend([kept.normal] * len(kept.gap))
        return Contacts(np.array(pair), np.array(gap), np.array(point), np.array(normal))

    def _found(self, k: int, places: Array, where: bytes, tolerance: float, rough: bool) -> _Kept:
        """Return the contacts of one pair whose shapes are placed."""
        distance, axis, middle, exact = self._measure(k, places, tolerance if rough else np.inf)
        if distance > tolerance:
            return _Kept(where, False, rough, distance, axis, [distance], [middle], axis)
        n, patch = axis, None
        if self._faced[k]:
            n = self._face_of(k, places, axis, distance) if exact else self._sharpened(k, axis, distance)
        if not self._curved[k]:
            patch = self._patch(k, middle, n, distance)
            if patch is not None and self._line is not None:
                one = unique_along(patch[0], self._line)
                patch = patch[0][one], patch[1][one]
        # no line along the normal crosses more than the depth
        gap = [] if patch is None else np.maximum(patch[1], distance).tolist()
        point = [] if patch is None else list(patch[0])
        # where edges cross none of the patch's corners may be as deep
        if not gap or min(gap) > distance + _CORNER * self._bound[k]:
            gap, point = [distance, *gap], [middle, *point]
        return _Kept(where, True, False, distance, axis, gap, point, n)

    def _face_of(self, k: int, places: Array, n: Array, distance: float) -> Array:
        """Return the normal of a face along which the distance is the same, that of the first shape if both have one.

        Of two faces that touch either normal is that of the least depth, by rounding.
        """
        for side, scaled, sign in zip(self._sides[k], self._scaled_sides[k], (1.0, -1.0), strict=True):
            normals = self._normals[side]
            if normals is None:
                continue
            R = self._pose[scaled].getRotation()
            along, normal = most_facing(normals, R.T.dot(sign * n))
            if along > _SAME_FACE:
                face = sign * R.dot(normal)
                if separated(self._axes, places, self._both[k], face) >= distance - _EQUAL * self._bound[k]:
                    return face
        return n

    def _sharpened(self, k: int, n: Array, distance: float) -> Array:
        """Return the normal of a face that Coal's own, uncertain where the shapes just touch, may stand for."""
        turn = _FINE * self._unit[k] / max(abs(distance), 1e-300) + _LEAST_TURN
        closest, sharp = cos(min(_MOST_TURN, turn)), n
        for side, scaled, sign in zip(self._sides[k], self._scaled_sides[k], (1.0, -1.0), strict=True):
            normals = self._normals[side]
            if normals is None:
                continue
            R = self._pose[scaled].getRotation()
            along, normal = most_facing(normals, R.T.dot(sign * n))
            if along > closest:
                closest, sharp = along, sign * R.dot(normal)
        return sharp

    def _measure(self, k: int, places: Array, enough: float = np.inf) -> tuple[float, Array, Array, bool]:
        """Return signed distance, unit normal and a point midway of one pair, and whether they are exact to rounding.

        Coal's answer is only where to start from: at the robust tolerance, and where that does not lead to a maximum,
        at the fine one. Of a distance beyond `enough` a lower bound is returned, without a point.
        """
        a, b = self._scaled_sides[k]
        unit, (fine, robust), (result, second) = self._unit[k], self._requests, self._results
        for request in (robust, fine):
            second.clear()
            distance = self._distance[k](self._pose[a], self._pose[b], request, second) * unit
            if distance < 0.0 and self._round_ends[k]:
                return *self._ball_at_cylinder(k), True
            normal = np.array(second.normal)
            if distance > enough + 2.0 * _REFINED * self._bound[k]:
                return distance - _REFINED * self._bound[k], normal, _NO_POINT, False
            found, exact, point = refined(self._axes, places, self._both[k], normal)
            if found != FAILED and exact >= distance - _REFINED * self._bound[k]:
                if found == FLAT:
                    point = _midway(second) * unit
                return exact, normal, point, True
        result.clear()
        distance = self._distance[k](self._pose[a], self._pose[b], fine, result)
        if distance < 0.0:
            second.clear()
            check = self._distance[k](self._pose[a], self._pose[b], robust, second)
            # every direction bounds the depth from above: of two answers the deeper one is wrong
            if distance < check - _AGREEMENT * self._bound[k] / unit:
                distance, result = check, second
            if not abs(distance) < 1e100:
                return *self._overlap(k), False
        return distance * unit, np.array(result.normal), _midway(result) * unit, False

    def _place_of(self, k: int, side: int) -> tuple[Array, Array]:
        """Return rotation and origin of one side of a pair, shapes (3, 3) and (3,)."""
        pose = self._pose[self._scaled_sides[k][side]]
        return pose.getRotation(), pose.getTranslation() * self._unit[k]

    def _overlap(self, k: int) -> tuple[float, Array, Array]:
        """Return signed distance, normal and point of a pair for which Coal finds nothing."""
        a, b = (self._placed[side].shape for side in self._sides[k])
        if not (isinstance(a, Box | Hull) and isinstance(b, Box | Hull)):
            raise MbviError(f"{self.names[k]}: Coal finds no penetration depth; take a smaller step or simpler shapes")
        places = [self._place_of(k, side) for side in (0, 1)]
        first, second = (np.concatenate([R.T, origin[None]]) for R, origin in places)
        return overlap(a, first, b, second)

    def _ball_at_cylinder(self, k: int) -> tuple[float, Array, Array]:
        sides = [self._placed[side].shape for side in self._sides[k]]
        swapped = isinstance(sides[0], Sphere)
        ball, cylinder = (0, 1) if swapped else (1, 0)
        centre, (R, origin) = self._place_of(k, ball)[1], self._place_of(k, cylinder)
        size, radius = sides[cylinder], sides[ball].bound
        assert isinstance(size, Cylinder)
        distance, way = out_of_cylinder(R.T @ (centre - origin), size.radius, size.length)
        out = R @ way
        return distance - radius, -out if swapped else out, centre - 0.5 * (distance + radius) * out

    def _patch(self, k: int, point: Array, normal: Array, distance: float) -> tuple[Array, Array] | None:
        """Return two or more points of the polygon that two faces share, shape (k, 3), and their gaps, or None."""
        unit, scaled = self._unit[k], self._scaled_sides[k]
        tolerance = _PATCH_DEPTH * self._bound[k] / unit
        poses = self._pose[scaled[0]], self._pose[scaled[1]]
        points = self._patches.find(scaled, poses, tolerance, point / unit, normal, distance / unit)
        if points is None:
            return None
        points *= unit
        way_a, way_b = self._way_out(k, 0, points, normal), self._way_out(k, 1, points, -normal)
        return points + 0.5 * (way_a - way_b)[:, None] * normal, -(way_a + way_b)

    def _way_out(self, k: int, side: int, points: Array, direction: Array) -> Array:
        """Return how far from points a line along a direction leaves one shape of a pair [m]."""
        R, origin = self._place_of(k, side)
        shape = self._placed[self._sides[k][side]].shape
        assert not isinstance(shape, Sphere | Ellipsoid)
        return shape.exit((points - origin) @ R, R.T @ direction)


def _midway(result: coal.DistanceResult) -> Array:
    return np.asarray(0.5 * (result.getNearestPoint1() + result.getNearestPoint2()))

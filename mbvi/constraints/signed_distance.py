"""The family of convex shapes against each other: refined signed distances of Coal, and patches of parallel faces."""

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
# bounds of the error of Coal's normal: the first where shapes just touch, the second where they are far apart [rad]
_ERROR_TOUCHING, _ERROR_APART = 0.3, 1e-5
# how deep below the contact plane a vertex may lie and still belong to the patch
_PATCH_DEPTH = 0.02
# a patch whose corners are all less deep than the penetration by more than this lacks the deepest point
_CORNER = 1e-6
# stands for the contact point where the distance is only a lower bound
_NO_POINT = np.zeros(3)
# by how much a refined distance may be below Coal's
_REFINED = 1e-5
# a face normal replaces the normal within the angle of this cosine, if the distance differs by no more than the second
_SAME_FACE, _EQUAL = cos(1e-3), 1e-8
# placements are rounded to multiples of 1 / this (lengths in units of the shapes' size), about 1e-14, so that a body at
# rest has the same placement, bit by bit, at every step
_GRID = 2.0**47


class _Measurement(NamedTuple):
    """The last measurement of a pair: the placements of its bodies as bytes, and its contacts.

    `patched` is whether the patch was computed. If `rough` is True, `distance` is only a lower bound.
    """

    where: bytes
    patched: bool
    rough: bool
    distance: float
    axis: Array
    gap: list[float]
    point: list[Array]
    normal: Array

    def is_valid(self, where: bytes, tolerance: float, rough: bool) -> bool:
        """Return whether the bodies have not moved, and a new measurement would give the same."""
        return self.where == where and self.patched == (self.distance <= tolerance) and (rough or not self.rough)


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
        self._line, self._at_rest = line, at_rest
        self._kept: dict[int, _Measurement] = {}
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
        self._patches = PatchFinder(self._geometry)
        shapes = [(self._placed[a].shape, self._placed[b].shape) for a, b in self._sides]
        self._curved = [a.smooth or b.smooth for a, b in shapes]
        # normals of the faces of each shape; None where it has no faces
        self._normals = [s.shape.faces[0].copy() if hasattr(s.shape, "faces") else None for s in self._placed]
        self._sphere_cylinder = [{type(a), type(b)} == {Sphere, Cylinder} for a, b in shapes]
        self._has_faces = [self._normals[a] is not None or self._normals[b] is not None for a, b in self._sides]
        self._both = both = np.array(self._sides, dtype=np.int64).reshape(-1, 2)
        self._axes = SeparatingAxes(self._placed, both)
        self._frames = [[frame for frame in self._axes.frame[list(s)].tolist() if frame >= 0] for s in self._sides]
        self._bounds = np.empty(len(self._sides))
        self._closed_form = SphereCapsulePairs(self._placed, self._axes.frame, both)
        # pairs of spheres and capsules have a continuous gradient
        self.smooth: Array = self._closed_form.closed_form
        self._is_smooth = self.smooth.tolist().__getitem__
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

    def _place(self, places: Array, pairs: list[int]) -> None:
        """Set the poses of the shapes of some pairs by the placements of their bodies."""
        for k in {scaled for pair in pairs for scaled in self._scaled_sides[pair]}:
            side, unit = self._scaled[k]
            placed, frame = self._placed[side], self._axes.frame.item(side)
            if frame >= 0:
                turn = places[frame, :3].T
                self._pose[k].setTransform(turn @ placed.rotation, (turn @ placed.position + places[frame, 3]) / unit)

    def _measure_all(self, places: Array, pairs: Array, tolerance: float, rough: bool = False) -> Contacts:
        """Return the contacts of some pairs; if `rough`, gaps beyond the tolerance are lower bounds."""
        if all(map(self._is_smooth, pairs.tolist())):
            found = self._closed_form.contacts(places, pairs)
            # concentric spheres have no normal in closed form; Coal returns one
            if found is not None:
                self._axes.keep(places, pairs, found[2])
                return Contacts(pairs, *found)
        if self._at_rest:
            places = np.round(places * self._grid)
            places *= self._cell
        pair: list[int] = []
        gap: list[float] = []
        point: list[Array] = []
        normal: list[Array] = []
        wanted = pairs.tolist()
        where = {k: places[self._frames[k]].tobytes() for k in wanted}
        kept_of = self._kept
        known = {k: kept_of[k] for k in wanted if k in kept_of and kept_of[k].is_valid(where[k], tolerance, rough)}
        self._place(places, [k for k in wanted if k not in known])
        for k in wanted:
            kept = known.get(k)
            if kept is None:
                kept = self._measure_one(k, places, where[k], tolerance, rough)
                if self._at_rest:
                    self._kept[k] = kept
                self._axes.keep(places, np.array([k]), kept.axis[None])
            gap.extend(kept.gap)
            point.extend(kept.point)
            pair.extend([k] * len(kept.gap))
            normal.extend([kept.normal] * len(kept.gap))
        return Contacts(np.array(pair), np.array(gap), np.array(point), np.array(normal))

    def _measure_one(self, k: int, places: Array, where: bytes, tolerance: float, rough: bool) -> _Measurement:
        """Return the contacts of one pair, after `_place`, with all that is kept while its bodies stand still."""
        distance, axis, middle, exact = self._refined_distance(k, places, tolerance if rough else np.inf)
        if distance > tolerance:
            return _Measurement(where, False, rough, distance, axis, [distance], [middle], axis)
        n, patch = axis, None
        if self._has_faces[k]:
            n = self._face_of(k, places, axis, distance) if exact else self._likely_face(k, axis, distance)
        if not self._curved[k]:
            patch = self._patch(k, middle, n, distance)
            if patch is not None and self._line is not None:
                one = unique_along(patch[0], self._line)
                patch = patch[0][one], patch[1][one]
        # no point is deeper than the penetration depth: what exceeds it is rounding
        gap = [] if patch is None else np.maximum(patch[1], distance).tolist()
        point = [] if patch is None else list(patch[0])
        # where edges cross, the deepest point may be none of the corners of the patch: it is a row of its own
        if not gap or min(gap) > distance + _CORNER * self._bound[k]:
            gap, point = [distance, *gap], [middle, *point]
        return _Measurement(where, True, False, distance, axis, gap, point, n)

    def _face_of(self, k: int, places: Array, n: Array, distance: float) -> Array:
        """Return the normal of a face, if the separation along it is the distance; else n. The first shape goes first.

        Where two faces touch, rounding decides which of their normals n is; a fixed choice makes rows steady.
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

    def _likely_face(self, k: int, n: Array, distance: float) -> Array:
        """Return the normal of the face nearest to Coal's normal, if it lies within the error of that; else Coal's.

        The error grows as the distance vanishes.
        """
        turn = _FINE * self._unit[k] / max(abs(distance), 1e-300) + _ERROR_APART
        closest, sharp = cos(min(_ERROR_TOUCHING, turn)), n
        for side, scaled, sign in zip(self._sides[k], self._scaled_sides[k], (1.0, -1.0), strict=True):
            normals = self._normals[side]
            if normals is None:
                continue
            R = self._pose[scaled].getRotation()
            along, normal = most_facing(normals, R.T.dot(sign * n))
            if along > closest:
                closest, sharp = along, sign * R.dot(normal)
        return sharp

    def _refined_distance(self, k: int, places: Array, enough: float = np.inf) -> tuple[float, Array, Array, bool]:
        """Return signed distance, unit normal and midpoint of one pair, and whether they are exact to rounding.

        The refinement starts from Coal's normal: at the robust tolerance first, then at the fine one. If both fail,
        Coal's own answer is returned. Of a distance beyond `enough` a lower bound is returned, without a midpoint.
        """
        a, b = self._scaled_sides[k]
        unit, (fine, robust), (result, second) = self._unit[k], self._requests, self._results
        for request in (robust, fine):
            second.clear()
            distance = self._distance[k](self._pose[a], self._pose[b], request, second) * unit
            if distance < 0.0 and self._sphere_cylinder[k]:
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
            # the depth is the least over all directions, so that the deeper of two answers is wrong
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

    def _patch(self, k: int, point: Array, normal: Array, distance: float) -> tuple[Array, Array] | None:
        """Return two or more points of the polygon that two faces share, shape (k, 3), and their gaps, or None."""
        unit, scaled = self._unit[k], self._scaled_sides[k]
        tolerance = _PATCH_DEPTH * self._bound[k] / unit
        poses = self._pose[scaled[0]], self._pose[scaled[1]]
        points = self._patches.find(scaled, poses, tolerance, point / unit, normal, distance / unit)
        if points is None:
            return None
        points *= unit
        exit_a, exit_b = self._exit(k, 0, points, normal), self._exit(k, 1, points, -normal)
        return points + 0.5 * (exit_a - exit_b)[:, None] * normal, -(exit_a + exit_b)

    def _exit(self, k: int, side: int, points: Array, direction: Array) -> Array:
        """Return the distances from points to where lines along a direction leave one shape of a pair [m]."""
        R, origin = self._place_of(k, side)
        shape = self._placed[self._sides[k][side]].shape
        assert not isinstance(shape, Sphere | Ellipsoid)
        return shape.exit((points - origin) @ R, R.T @ direction)


def _midway(result: coal.DistanceResult) -> Array:
    """Return the midpoint of the two nearest points."""
    return np.asarray(0.5 * (result.getNearestPoint1() + result.getNearestPoint2()))

"""Signed distances between convex shapes from Coal, with all the points that two flat faces share."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos
from typing import Any, NamedTuple

import coal
import numpy as np

from ..errors import MbviError
from ..system import System
from .balls import Balls, out_of_cylinder
from .faces import most_facing
from .in_line import one_of_each_line
from .overlap import overlap
from .pairs import Array, Contacts, Pairs
from .separating_axis import SeparatingAxes
from .shapes import Box, Cylinder, Ellipsoid, Hull, PlacedShape, Sphere

# Coal's own tolerance leaves normals of curved shapes wrong in the third digit; at a fine one its penetration depth
# fails once in some hundred times, by an order of magnitude or outright
_FINE, _ROBUST = 1e-9, 1e-6
# how much deeper the fine answer may be than the robust one, in radii of the smaller shape
_AGREEMENT = 1e-4
# how far Coal's normal may be off where the distance vanishes, and where it does not [rad]
_MOST_TURN, _LEAST_TURN = 0.3, 1e-5
# how deep below the touching plane a vertex may lie and still be looked at, in radii of the smaller shape
_PATCH_DEPTH = 0.02
# by how much less a patch's deepest corner may be in than the shapes are, in the same radii
_CORNER = 1e-6
# what places are rounded to where contacts are kept at rest: some 1e-14 [m], so that rounding is no motion
_GRID = 2.0**47


class _Kept(NamedTuple):
    """What was found of a pair: where its bodies stood, if their patch was looked for, and its contacts."""

    where: bytes
    patched: bool
    distance: float
    axis: Array
    gap: list[float]
    point: list[Array]
    normal: Array

    def holds(self, where: bytes, tolerance: float) -> bool:
        """Tell whether the bodies still stand there, and a patch would be looked for as it was."""
        return self.where == where and self.patched == (self.distance <= tolerance)


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
    ) -> None:
        super().__init__(system, first, second, names, restitution)
        self._line, self._at_rest = line, at_rest
        self._kept: dict[int, _Kept] = {}
        placed = {s.name: s for s in (*first, *second)}
        self._placed = list(placed.values())
        number = {name: k for k, name in enumerate(placed)}
        self._sides = [(number[a.name], number[b.name]) for a, b in zip(first, second, strict=True)]
        self._geometry = [self._coal(s) for s in self._placed]
        self._distance = [coal.ComputeDistance(self._geometry[a], self._geometry[b]) for a, b in self._sides]
        self._bound = [min(a.shape.bound, b.shape.bound) for a, b in zip(first, second, strict=True)]
        self._requests, self._results = [], [coal.DistanceResult(), coal.DistanceResult()]
        for accuracy in (_FINE, _ROBUST):
            request = coal.DistanceRequest()
            request.gjk_tolerance = request.epa_tolerance = accuracy
            self._requests.append(request)
        self._patches = _PatchFinder(self._geometry, self._placed)
        shapes = [(self._placed[a].shape, self._placed[b].shape) for a, b in self._sides]
        self._smooth = [a.smooth or b.smooth for a, b in shapes]
        # of the faces that a normal may stand for; None where a shape has none
        self._normals = [s.shape.faces[0].copy() if hasattr(s.shape, "faces") else None for s in self._placed]
        self._faced = [self._normals[a] is not None or self._normals[b] is not None for a, b in self._sides]
        both = np.array(self._sides, dtype=np.int64).reshape(-1, 2)
        self._axes = SeparatingAxes(self._placed, both)
        self._frames = [[frame for frame in self._axes.frame[list(s)].tolist() if frame >= 0] for s in self._sides]
        self._bounds = np.empty(len(self._sides))
        self._balls = Balls(self._placed, self._axes.frame, both)
        self._round = self._balls.are.tolist().__getitem__
        self._pose = [coal.Transform3s() for _ in self._placed]
        for placed_shape, pose in zip(self._placed, self._pose, strict=True):
            if placed_shape.body == 0:
                pose.setTransform(placed_shape.rotation, placed_shape.position)

    def _coal(self, placed: PlacedShape) -> Any:
        return placed.shape.coal()

    @property
    def round(self) -> Array:
        """Which pairs have a smooth gradient: balls and capsules, shape (n,)."""
        return self._balls.are

    def near(self, q: Array, due: Array, tolerance: float) -> tuple[Contacts | None, bool]:
        places = self.system.placements(q, self._axes.bodies)
        asked = self._axes.clear(places, due, tolerance, self._budget)
        if not asked.size:
            return None, True
        contacts, vain = self._near(self._measured(places, asked, tolerance), tolerance)
        return contacts, vain or len(asked) < len(due)

    def contacts(self, q: Array, due: Array, tolerance: float) -> Contacts:
        return self._measured(self.system.placements(q, self._axes.bodies), due, tolerance)

    def at_least(self, q: Array, pairs: Array) -> Array:
        """Return what some signed distances are at least: more than 0 by an axis that separates, or themselves."""
        places = self.system.placements(q, self._axes.bodies)
        asked = self._axes.clear(places, pairs, 0.0, self._bounds)
        if asked.size:
            contacts = self._measured(places, asked, 0.0)
            self._bounds[asked] = np.inf
            np.minimum.at(self._bounds, contacts.pair, contacts.gap)
        return self._bounds[pairs]

    def passable(self, q: Array, way: Array) -> tuple[Array, Array, Array]:
        pairs, travel, thickness = super().passable(q, way)
        # most that could travel so far have nothing on their way
        near = self.at_least(q, pairs) <= travel if pairs.size else np.zeros(0, bool)
        return pairs[near], travel[near], thickness[near]

    def _place(self, places: Array, pairs: list[int]) -> None:
        """Bring the poses of the shapes in the given pairs to where their bodies are."""
        for k in {side for pair in pairs for side in self._sides[pair]}:
            placed, frame = self._placed[k], self._axes.frame.item(k)
            if frame >= 0:
                turn = places[frame, :3].T
                self._pose[k].setTransform(turn @ placed.rotation, turn @ placed.position + places[frame, 3])

    def _measured(self, places: Array, pairs: Array, tolerance: float) -> Contacts:
        if all(map(self._round, pairs.tolist())):
            balls = self._balls.contacts(places, pairs)
            # of balls about one centre Coal knows a way apart
            if balls is not None:
                self._axes.keep(places, pairs, balls[2])
                return Contacts(pairs, *balls)
        if self._at_rest:
            places = np.round(places * _GRID) / _GRID
        pair: list[int] = []
        gap: list[float] = []
        point: list[Array] = []
        normal: list[Array] = []
        asked = pairs.tolist()
        where = {k: places[self._frames[k]].tobytes() for k in asked}
        known = {k: self._kept[k] for k in asked if k in self._kept and self._kept[k].holds(where[k], tolerance)}
        self._place(places, [k for k in asked if k not in known])
        for k in asked:
            kept = known.get(k)
            if kept is None:
                kept = self._found(k, where[k], tolerance)
                if self._at_rest:
                    self._kept[k] = kept
                self._axes.keep(places, np.array([k]), kept.axis[None])
            gap.extend(kept.gap)
            point.extend(kept.point)
            pair.extend([k] * len(kept.gap))
            normal.extend([kept.normal] * len(kept.gap))
        return Contacts(np.array(pair), np.array(gap), np.array(point), np.array(normal))

    def _found(self, k: int, where: bytes, tolerance: float) -> _Kept:
        """Return the contacts of one pair whose shapes are placed."""
        distance, axis, middle = self._measure(k)
        n, patch = axis, None
        if distance <= tolerance:
            if self._faced[k]:
                n = self._sharpened(k, axis, distance)
            if not self._smooth[k]:
                sides = self._sides[k]
                poses = self._pose[sides[0]], self._pose[sides[1]]
                patch = self._patches.find(sides, poses, middle, n, distance)
                if patch is not None and self._line is not None:
                    one = one_of_each_line(patch[0], self._line)
                    patch = patch[0][one], patch[1][one]
        # no line along the normal crosses more than the depth
        gap = [] if patch is None else np.maximum(patch[1], distance).tolist()
        point = [] if patch is None else list(patch[0])
        # where edges cross none of the patch's corners may be as deep
        if not gap or min(gap) > distance + _CORNER * self._bound[k]:
            gap, point = [distance, *gap], [middle, *point]
        return _Kept(where, distance <= tolerance, distance, axis, gap, point, n)

    def _sharpened(self, k: int, n: Array, distance: float) -> Array:
        """Return the normal of a face that Coal's own, uncertain where the shapes just touch, may stand for."""
        closest, sharp = cos(min(_MOST_TURN, _FINE / max(abs(distance), 1e-300) + _LEAST_TURN)), n
        for side, sign in zip(self._sides[k], (1.0, -1.0), strict=True):
            normals = self._normals[side]
            if normals is None:
                continue
            R = self._pose[side].getRotation()
            along, normal = most_facing(normals, R.T.dot(sign * n))
            if along > closest:
                closest, sharp = along, sign * R.dot(normal)
        return sharp

    def _measure(self, k: int) -> tuple[float, Array, Array]:
        """Return signed distance, unit normal, and a point midway of one pair, whose depth is asked for twice."""
        a, b = self._sides[k]
        (fine, robust), (result, second) = self._requests, self._results
        result.clear()
        distance = self._distance[k](self._pose[a], self._pose[b], fine, result)
        if distance < 0.0:
            if {type(self._placed[a].shape), type(self._placed[b].shape)} == {Sphere, Cylinder}:
                return self._ball_at_cylinder(a, b)
            second.clear()
            check = self._distance[k](self._pose[a], self._pose[b], robust, second)
            # every direction bounds the depth from above: of two answers the deeper one is wrong
            if distance < check - _AGREEMENT * self._bound[k]:
                distance, result = check, second
            if not abs(distance) < 1e100:
                return self._overlap(k)
        return distance, np.array(result.normal), 0.5 * (result.getNearestPoint1() + result.getNearestPoint2())

    def _overlap(self, k: int) -> tuple[float, Array, Array]:
        """Return what `_measure` does, of a pair for which Coal finds nothing."""
        a, b = (self._placed[side].shape for side in self._sides[k])
        if not (isinstance(a, Box | Hull) and isinstance(b, Box | Hull)):
            raise MbviError(f"{self.names[k]}: Coal finds no penetration depth; take a smaller step or simpler shapes")
        first, second = (
            np.concatenate([pose.getRotation().T, pose.getTranslation()[None]])
            for pose in (self._pose[side] for side in self._sides[k])
        )
        return overlap(a, first, b, second)

    def _ball_at_cylinder(self, a: int, b: int) -> tuple[float, Array, Array]:
        swapped = isinstance(self._placed[a].shape, Sphere)
        ball, cylinder = (a, b) if swapped else (b, a)
        centre, R = self._pose[ball].getTranslation(), self._pose[cylinder].getRotation()
        size, radius = self._placed[cylinder].shape, self._placed[ball].shape.bound
        assert isinstance(size, Cylinder)
        distance, way = out_of_cylinder(
            R.T @ (centre - self._pose[cylinder].getTranslation()), size.radius, size.length
        )
        out = R @ way
        return distance - radius, -out if swapped else out, centre - 0.5 * (distance + radius) * out


class _PatchFinder:
    """The polygon two flat faces share, each of its corners with a gap of its own.

    Coal gives one depth for the whole patch; the gap of a corner is measured between the two surfaces along the normal.
    Its own search for the contact, whose normal is noise where faces just touch, is left out: both are given.
    """

    def __init__(self, geometry: list, placed: list[PlacedShape]) -> None:
        self._geometry, self._placed = geometry, placed
        self._functors: dict[tuple[int, int], tuple] = {}
        self._contacts, self._patch = coal.CollisionResult(), coal.ContactPatchResult()

    def find(
        self, sides: tuple[int, int], poses: tuple, point: Array, normal: Array, distance: float
    ) -> tuple[Array, Array] | None:
        """Return points, shape (k, 3), and gaps, shape (k,), of two or more points, or None."""
        a, b = sides
        geometry = self._geometry[a], self._geometry[b]
        if sides not in self._functors:
            request = coal.ContactPatchRequest()
            request.setPatchTolerance(_PATCH_DEPTH * min(self._placed[k].shape.bound for k in sides))
            self._functors[sides] = coal.ComputeContactPatch(*geometry), request
        patch_of, request = self._functors[sides]
        self._contacts.clear()
        self._patch.clear()
        self._contacts.addContact(coal.Contact(*geometry, -1, -1, point, normal, distance))
        patch_of(*poses, self._contacts, request, self._patch)
        if not self._patch.numContactPatches():
            return None
        patch = self._patch.getContactPatch(0)
        if patch.size() < 2:
            return None
        points = np.array([patch.getPoint(i) for i in range(patch.size())])
        way_a = self._way_out(a, poses[0], points, normal)
        way_b = self._way_out(b, poses[1], points, -normal)
        return points + 0.5 * (way_a - way_b)[:, None] * normal, -(way_a + way_b)

    def _way_out(self, k: int, pose: coal.Transform3s, points: Array, direction: Array) -> Array:
        R = pose.getRotation()
        shape = self._placed[k].shape
        assert not isinstance(shape, Sphere | Ellipsoid)
        return shape.exit((points - pose.getTranslation()) @ R, R.T @ direction)

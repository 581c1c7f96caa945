"""Distances of pairs of convex shapes by Coal, refined to rounding where that succeeds.

Coal's tolerances are absolute: it gets each shape in the unit of its pair, a power of two about as large as the pair.
Functors and geometries are made when the distance of a pair is first computed.
"""

from __future__ import annotations

from typing import Any

import coal
import numpy as np

from ..arguments import Array
from ..errors import MbviError
from .pair_distances import BELOW
from .polyhedra import Polyhedron
from .polyhedron_overlap import overlap
from .refined_distance import COAL, FAILED, FLAT, refined
from .separating_axis import SeparatingAxes, place_pair, place_shape
from .shape_table import ShapeTable
from .shapes import Convex

# Tolerances for Coal, in units of the pair's size. At Coal's default, normals of curved shapes are wrong in the third
# digit. At the fine one, about one penetration depth in some hundred is wrong by an order of magnitude, or not finite
_FINE, _ROBUST = 1e-9, 1e-6
# lengths below are relative to the bounding radius of the smaller shape
# how much deeper the fine answer may be than the robust one
_AGREEMENT = 1e-4


class CoalDistances:
    """Coal's distances of pairs of shapes.

    Parameters
    ----------
    table : ShapeTable
        The shapes.
    axes : SeparatingAxes
        Of these shapes and their pairs.
    """

    def __init__(self, table: ShapeTable, axes: SeparatingAxes) -> None:
        self._table, self._axes, self._geometries = table, axes, table.geometries
        self.bound = np.minimum(*table.bound[axes.shapes.sides.T])
        self.unit = np.ldexp(1.0, np.frexp(self.bound)[1])
        self._pairs: dict[int, tuple[Any, Any, list[int]]] = {}
        self._poses = coal.Transform3s(), coal.Transform3s()
        self._world = np.empty((2, 4, 3))
        self._fine, self._robust = coal.DistanceRequest(), coal.DistanceRequest()
        for request, accuracy in ((self._fine, _FINE), (self._robust, _ROBUST)):
            request.gjk_tolerance = request.epa_tolerance = accuracy
        self._results = coal.DistanceResult(), coal.DistanceResult()

    def approximate(self, places: Array, pair: int, normal: Array) -> float:
        """Return the distance of a pair to Coal's robust tolerance [m]; write its unit normal, shape (3,).

        `places`, shape (b, 4, 3), are the placements of the bodies of `axes`.
        """
        result = self._results[1]
        distance = self._ask(places, pair, self._robust, result)
        normal[:] = result.normal
        return distance

    def measure(self, places: Array, pair: int) -> tuple[float, Array, Array, int]:
        """Return signed distance, unit normal, midpoint and state of a pair; see `pair_distances`.

        The refinement starts from Coal's normal: at the robust tolerance first, then at the fine one. If both fail,
        Coal's own answer is returned.

        Raises
        ------
        MbviError
            If Coal finds no penetration depth, and the shapes are not two polyhedra.
        """
        bound, unit = float(self.bound[pair]), float(self.unit[pair])
        second, result = self._results
        distance = np.inf
        for request, answer in ((self._robust, second), (self._fine, result)):
            check, distance = distance, self._ask(places, pair, request, answer)
            normal = np.array(answer.normal)
            found, exact, point = refined(self._axes, places, pair, normal)
            if found != FAILED and exact >= distance - BELOW * bound:
                return exact, normal, point, found
        if distance < 0.0:
            # the depth is the least over all directions, so that the deeper of two answers is wrong
            if distance < check - _AGREEMENT * bound:
                distance, result = check, second
            if not abs(distance) < 1e100:
                return self.overlap(places, pair)
        middle = 0.5 * unit * np.asarray(result.getNearestPoint1() + result.getNearestPoint2())
        return distance, np.array(result.normal), middle, COAL

    def overlap(self, places: Array, pair: int) -> tuple[float, Array, Array, int]:
        """Return the same of two polyhedra that overlap, without Coal: all axes of faces and edges are tried."""
        sides = self._axes.shapes.sides[pair].tolist()
        one, other = (self._table.placed[side].shape for side in sides)
        if not (isinstance(one, Polyhedron) and isinstance(other, Polyhedron)):
            name = self._table.name(*sides)
            raise MbviError(f"{name}: Coal finds no penetration depth; take a smaller step or simpler shapes")
        place_pair(places, self._axes.shapes, pair, self._world)
        distance, normal = overlap(one, self._world[0], other, self._world[1])
        found, exact, point = refined(self._axes, places, pair, normal)
        return (distance, normal, point, FLAT) if found == FAILED else (exact, normal, point, found)

    def _ask(self, places: Array, pair: int, request: coal.DistanceRequest, result: coal.DistanceResult) -> float:
        known, unit = self._pairs.get(pair), float(self.unit[pair])
        if known is None:
            sides = self._axes.shapes.sides[pair].tolist()
            shapes = [self._geometry(self._table.placed[side].shape, unit) for side in sides]
            known = self._pairs[pair] = coal.ComputeDistance(*shapes), shapes, sides
        for world, pose, side in zip(self._world, self._poses, known[2], strict=True):
            # arrays are passed faster than tables
            place_shape(places, self._axes.frame, self._axes.shapes.fixed, side, world)
            pose.setTransform(world[:3].T, world[3] / unit)
        result.clear()
        return float(known[0](*self._poses, request, result) * unit)

    def _geometry(self, shape: Convex, unit: float) -> Any:
        key = id(shape), unit
        if key not in self._geometries:
            # the shape is kept, too, so that no other gets its number
            self._geometries[key] = shape.coal(unit), shape
        return self._geometries[key][0]

"""The family of shapes against half-spaces, by the points on which a shape can stand.

A polyhedron stands on its vertices, a capsule on its two end spheres, a cylinder on its rims. Each point is a row of
its own, whose gap and gradient are smooth functions of the configuration. On a rim or an ellipsoid the point is the
lowest one, which moves over the shape.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..compiled import kernel
from ..geometry.collinear import unique_along
from ..geometry.shapes import HalfSpace, PlacedShape
from ..geometry.support_points import lowest, stand
from ..system import System
from ..system.articulated import row
from .family import RowTable
from .pairs import Array, Contacts, PairCandidates, Pairs
from .rows import Rows

# sets of pairs whose gathered points are kept; beyond, all are gathered again
_MOST_SELECTIONS = 1000


class _ConstantPart(NamedTuple):
    """What stays the same in the rows of some active points: their pairs, e, and normals."""

    number: Array
    restitution: Array
    up: Array


@dataclass
class _Selection:
    """The support points of some pairs, gathered in arrays for kernels.

    Attributes
    ----------
    pair : ndarray of int, shape (k,)
        The pair of each point.
    bodies : ndarray of int, shape (b,), or None
        The bodies of these points; None for a single mechanism, whose kinematics holds the poses of all bodies.
    numbers : ndarray, shape (k, 17)
        The points as `geometry.support_points` describes them: columns 12-14 hold the normal of the half-space.
    owners : ndarray of int, shape (k, 2)
        Of each point: the place of its body in `bodies` (the body itself if that is None), and its pair.
    index : ndarray of int, shape (k + 1,)
        First how many points were within the tolerance at the last call, then which.
    constant : _ConstantPart
        The constant part of the rows of these points.
    """

    pair: Array
    bodies: Array | None
    numbers: Array
    owners: Array
    index: Array
    constant: _ConstantPart


@kernel(
    "Tuple((i8, b1, b1))(f8[:,:,::1], f8[:,::1], f8[:,::1], i8[:,::1], f8[:,::1], f8, f8[::1], i8[::1], f8[::1],"
    " f8[:,::1], f8[:,::1])"
)
def half_space_rows(
    poses: Array, columns: Array, support: Array, owners: Array, numbers: Array, tolerance: float,
    clearance: Array, index: Array, gap: Array, point: Array, rows: Array,
) -> tuple[int, bool, bool]:  # fmt: skip
    """Write gaps, points and gradients of the points within the tolerance, if they are the points of the last call.

    Parameters
    ----------
    poses, columns, support
        As of `Kinematics`.
    owners, numbers, index
        As of `_Selection`; `index` is written.
    tolerance : float
        Gap at and below which a point is active [m].
    clearance : ndarray, shape (n,)
        Of all pairs; receives the least gap of each pair here.
    gap, point, rows : ndarray, shapes (c,), (c, 3), (c, nv)
        For as many points as `index` counts.

    Returns
    -------
    count : int
        How many points are within the tolerance.
    any_empty : bool
        Whether a pair has none.
    same : bool
        Whether they are the points of the last call; only then gap, point and rows are written in full.
    """
    out = np.empty(4)
    count, any_empty, same, room = 0, False, True, len(gap)
    for i in range(len(owners)):
        clearance[owners[i, 1]] = np.inf
    for i in range(len(owners)):
        body, pair = owners[i, 0], owners[i, 1]
        lowest(poses, body, numbers, i, out)
        clearance[pair] = min(clearance[pair], out[3])
        if out[3] <= tolerance:
            same = same and count < room and index[1 + count] == i
            index[1 + count] = i
            if same:
                point[count, 0], point[count, 1], point[count, 2], gap[count] = out[0], out[1], out[2], out[3]
                row(columns, support[0], support[body], out, numbers[i, 12:15], rows[count])
            count += 1
    same = same and count == index[0]
    index[0] = count
    for i in range(len(owners)):
        any_empty = any_empty or clearance[owners[i, 1]] > tolerance
    return count, any_empty, same


class HalfSpaceContacts(Pairs):
    """Half-spaces of the world (first) against shapes of moving bodies (second).

    Parameters
    ----------
    system : System
        What moves the bodies.
    walls : sequence of HalfSpace
        The half-space of each pair.
    shapes : sequence of PlacedShape
        The shape of each pair.
    names, restitution
        As `Pairs`.
    lines : ndarray, shape (n, 3), optional
        In a planar scene the plane's normal in the frame of each shape's body; of points on one line along it only the
        first is kept.

    Attributes
    ----------
    collinear_points : int
        How many support points are left out for that reason.
    """

    def __init__(
        self,
        system: System,
        walls: Sequence[HalfSpace],
        shapes: Sequence[PlacedShape],
        names: Sequence[str],
        restitution: Array,
        lines: Array | None = None,
    ) -> None:
        self.collinear_points = 0
        super().__init__(system, [None] * len(shapes), shapes, names, restitution)
        # for a single mechanism `half_space_rows` computes gaps, points and gradients in one call
        self._one_mechanism = system.single_mechanism
        numbers, owner = [np.zeros((0, 17))], []
        for pair, (wall, placed) in enumerate(zip(walls, shapes, strict=True)):
            centres, half_axes, radius = placed.shape.support_points()
            points = centres @ placed.rotation.T + placed.position
            # columns of rotation diag(half axes), one after the other
            axes = (placed.rotation * half_axes[:, None, :]).transpose(0, 2, 1).reshape(-1, 9)
            if lines is not None:
                # a rim with its centre on such a line may be left out too: its lowest point is another fixed point
                kept = unique_along(points, lines[pair])
                self.collinear_points += len(points) - len(kept)
                points, axes = points[kept], axes[kept]
            rest = np.tile([*wall.normal, radius, wall.offset + radius], (len(points), 1))
            numbers.append(np.concatenate([points, axes, rest], axis=1))
            owner.extend([pair] * len(points))
        self._numbers, self.owner = np.concatenate(numbers), np.array(owner, dtype=np.int64)
        self._points: dict[bytes, _Selection] = {}
        self._selections: dict[bytes, _Selection] = {}
        # the last selection and its pairs: often the next query has the same array
        self._selection: _Selection
        self._pairs: Array | None = None

    def describe(self) -> str:
        """Return one line of `Problem.report()`, in words."""
        return f"{self.size} pairs of a shape and a half-space"

    def _select(self, pairs: Array) -> _Selection:
        """Return the points of some pairs, gathered; they are kept, since a run has few different sets of pairs."""
        if pairs is self._pairs:
            return self._selection
        key = pairs.tobytes()
        found = self._selections.get(key)
        if found is None:
            if len(self._selections) >= _MOST_SELECTIONS:
                self._selections.clear()
            found = self._selections[key] = self._gather(pairs)
        self._pairs, self._selection = pairs, found
        return found

    def _gather(self, pairs: Array) -> _Selection:
        wanted = np.zeros(self.size, bool)
        wanted[pairs] = True
        return self._gather_points(wanted[self.owner].nonzero()[0])

    def _gather_points(self, points: Array) -> _Selection:
        pair = self.owner[points]
        body = self._second_body[pair]
        bodies, frame = (None, body) if self._one_mechanism else np.unique(body, return_inverse=True)
        return _Selection(
            pair,
            bodies,
            self._numbers[points],
            np.array([frame, pair], dtype=np.int64).T.copy(),
            np.zeros(len(pair) + 1, np.int64),
            _ConstantPart(np.zeros(0), np.zeros(0), np.zeros((0, 3))),
        )

    def row_table(self, t: float, q: Array) -> RowTable:
        """Return the table of the rows: one for each point that a shape can stand on."""
        pair = self.owner
        smooth = np.ones(len(pair), bool)
        return RowTable(pair, self.restitution[pair], smooth, self.reach()[pair], self.thickness[pair])

    def _row_contacts(self, q: Array, points: Array) -> Contacts:
        """Return the contacts of some rows of `row_table`, which are points in ascending order."""
        key = points.tobytes()
        selection = self._points.get(key)
        if selection is None:
            if len(self._points) >= _MOST_SELECTIONS:
                self._points.clear()
            selection = self._points[key] = self._gather_points(points)
        return self._point_contacts(q, selection)

    def measure(self, q: Array, pairs: Array, tolerance: float) -> Contacts:
        return self._point_contacts(q, self._select(pairs))

    def row_bias(self, t: float, q: Array, v: Array, points: Array) -> Array:
        """Return (dJ/dt) v of some points; NaN for those that move along their bodies, on rims and ellipsoids."""
        numbers = self._numbers[points]
        bias = self.system.point_bias(q, v, self._second_body[self.owner[points]], numbers[:, :3].copy())
        return np.where(numbers[:, 3:12].any(axis=1), np.nan, np.vecdot(bias, numbers[:, 12:15]))

    def _point_contacts(self, q: Array, selection: _Selection) -> Contacts:
        """Return a contact for each point of a selection, whatever its gap."""
        gap, point = np.empty(len(selection.pair)), np.empty((len(selection.pair), 3))
        if selection.bodies is None:
            places = self.system.kinematics(q).poses
        else:
            places = self.system.placements(q, selection.bodies)
        stand(places, selection.owners, selection.numbers, gap, point)
        return Contacts(selection.pair, gap, point, np.ascontiguousarray(selection.numbers[:, 12:15]))

    def _rows(self, q: Array, pairs: Array, tolerance: float, candidates: PairCandidates) -> Rows | None:
        if not self._one_mechanism:
            return super()._rows(q, pairs, tolerance, candidates)
        selection = self._selection if pairs is self._pairs else self._select(pairs)
        poses, columns, support = self.system.kinematics(q)
        owners, numbers, index = selection.owners, selection.numbers, selection.index
        # if other points than at the last call are within the tolerance, the kernel is called again with room for them
        while True:
            number, restitution, up = selection.constant
            size = len(number)
            gap, point, rows = np.empty(size), np.empty((size, 3)), np.empty((size, self.system.nv))
            count, any_empty, same = half_space_rows(
                poses, columns, support, owners, numbers, tolerance, candidates.clearance, index, gap, point, rows
            )  # fmt: skip
            if same:
                candidates.any_empty = any_empty
                return Rows(number, gap, rows, restitution, point, up) if count else None
            near = index[1 : 1 + count]
            pair, up = selection.pair[near], np.ascontiguousarray(numbers[near, 12:15])
            selection.constant = _ConstantPart(pair, self.restitution[pair], up)

"""The family of shapes against half-spaces, by the points on which a shape can stand.

A polyhedron stands on its vertices, a capsule on its two end balls, a cylinder on its rims: each point is a row of its
own, whose gap and gradient are smooth functions of the configuration. On a rim or an ellipsoid one point moves along
with what is lowest.
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

_MOST_SELECTIONS = 1000


class _Near(NamedTuple):
    """What is the same for some near points at every step: their rows' numbers, e, and normals."""

    number: Array
    restitution: Array
    up: Array


@dataclass
class _Selection:
    """The points of some pairs, gathered.

    Attributes
    ----------
    pair : ndarray of int, shape (k,)
        The pair of each point.
    bodies : ndarray of int, shape (b,), or None
        The bodies there are, where not all are placed at once.
    numbers : ndarray, shape (k, 17)
        Of each point: its place in the body, or the centre of the rim or ellipsoid it moves on [m]; the half axes of
        that in the body, one column after the other, zero for a point that is fixed; the half-space's normal; the
        radius of the ball around the point, and that plus the half-space's offset [m].
    owners : ndarray of int, shape (k, 2)
        Which of the bodies each point belongs to, and its pair.
    index : ndarray of int, shape (k + 1,)
        How many points were within the tolerance when last looked at, and which.
    near : _Near
        What is known of these.
    """

    pair: Array
    bodies: Array | None
    numbers: Array
    owners: Array
    index: Array
    near: _Near


@kernel(
    "Tuple((i8, b1, b1))(f8[:,:,::1], f8[:,::1], f8[:,::1], i8[:,::1], f8[:,::1], f8, f8[::1], i8[::1], f8[::1],"
    " f8[:,::1], f8[:,::1])"
)
def _touch(
    poses: Array, columns: Array, support: Array, owners: Array, numbers: Array, tolerance: float,
    budget: Array, index: Array, gap: Array, point: Array, rows: Array,
) -> tuple[int, bool, bool]:  # fmt: skip
    """Write gaps, points and gradients of the points within the tolerance, if they are those of the last time.

    Parameters
    ----------
    poses, columns, support
        As of `Kinematics`.
    owners, numbers, index
        As of `_Selection`; `index` is written.
    tolerance : float
        Gap at and below which a point is active [m].
    budget : ndarray, shape (n,)
        Of all pairs; the least gap is written for those here.
    gap, point, rows : ndarray, shapes (c,), (c, 3), (c, nv)
        For as many points as `index` counts.

    Returns
    -------
    count : int
        How many points are within the tolerance.
    vain : bool
        Whether a pair has none.
    same : bool
        Whether they are those of the last time; only then are gap, point and rows written in full.
    """
    out = np.empty(4)
    count, vain, same, room = 0, False, True, len(gap)
    for i in range(len(owners)):
        budget[owners[i, 1]] = np.inf
    for i in range(len(owners)):
        body, pair = owners[i, 0], owners[i, 1]
        lowest(poses, body, numbers, i, out)
        budget[pair] = min(budget[pair], out[3])
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
        vain = vain or budget[owners[i, 1]] > tolerance
    return count, vain, same


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
        Where all moves in a plane, its normal as each shape's body has it; of points in line with it one is taken.

    Attributes
    ----------
    in_line : int
        How many points are not.
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
        self.in_line = 0
        super().__init__(system, [None] * len(shapes), shapes, names, restitution)
        # one kernel does it all for a single mechanism
        self._one_mechanism = hasattr(system, "kinematics")
        numbers, owner = [np.zeros((0, 17))], []
        for pair, (wall, placed) in enumerate(zip(walls, shapes, strict=True)):
            centres, half_axes, radius = placed.shape.support_points()
            points = centres @ placed.rotation.T + placed.position
            # columns of rotation diag(half axes), one after the other
            swell = (placed.rotation * half_axes[:, None, :]).transpose(0, 2, 1).reshape(-1, 9)
            if lines is not None:
                # a rim's centre in line with points of it: others of these are the lowest then
                kept = unique_along(points, lines[pair])
                self.in_line += len(points) - len(kept)
                points, swell = points[kept], swell[kept]
            rest = np.tile([*wall.normal, radius, wall.offset + radius], (len(points), 1))
            numbers.append(np.concatenate([points, swell, rest], axis=1))
            owner.extend([pair] * len(points))
        self._numbers, self.owner = np.concatenate(numbers), np.array(owner, dtype=np.int64)
        self._points: dict[bytes, _Selection] = {}
        self._selections: dict[bytes, _Selection] = {}
        # the last selection, and its pairs, which may be the same array at the next query
        self._selection: _Selection
        self._pairs: Array | None = None

    def describe(self) -> str:
        """Return one line of `Problem.report()`, in words."""
        return f"{self.size} pairs of a shape and a half-space"

    def _select(self, pairs: Array) -> _Selection:
        """Gather the points of the asked pairs; the same few sets of pairs come again and again."""
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
        due = np.zeros(len(self.names), bool)
        due[pairs] = True
        return self._gather_points(due[self.owner].nonzero()[0])

    def _gather_points(self, chosen: Array) -> _Selection:
        pair = self.owner[chosen]
        body = self._second_body[pair]
        bodies, frame = (None, body) if self._one_mechanism else np.unique(body, return_inverse=True)
        return _Selection(
            pair,
            bodies,
            self._numbers[chosen],
            np.array([frame, pair], dtype=np.int64).T.copy(),
            np.zeros(len(pair) + 1, np.int64),
            _Near(np.zeros(0), np.zeros(0), np.zeros((0, 3))),
        )

    def row_table(self, t: float, q: Array) -> RowTable:
        """Return the table of the rows: one for each point that a shape can stand on."""
        pair = self.owner
        smooth = np.ones(len(pair), bool)
        return RowTable(pair, self.restitution[pair], smooth, self.reach()[pair], self.thickness[pair])

    def _row_contacts(self, q: Array, points: Array) -> Contacts:
        """Return the contacts of some of all the points, in ascending order."""
        key = points.tobytes()
        selection = self._points.get(key)
        if selection is None:
            if len(self._points) >= _MOST_SELECTIONS:
                self._points.clear()
            selection = self._points[key] = self._gather_points(points)
        return self._standing(q, selection)

    def measure(self, q: Array, pairs: Array, tolerance: float) -> Contacts:
        return self._standing(q, self._select(pairs))

    def row_bias(self, t: float, q: Array, v: Array, points: Array) -> Array:
        """Return (dJ/dt) v of some of all the points; NaN for those that move along their bodies."""
        numbers = self._numbers[points]
        bias = self.system.point_bias(q, v, self._second_body[self.owner[points]], numbers[:, :3].copy())
        return np.where(numbers[:, 3:12].any(axis=1), np.nan, np.vecdot(bias, numbers[:, 12:15]))

    def _standing(self, q: Array, selection: _Selection) -> Contacts:
        gap, point = np.empty(len(selection.pair)), np.empty((len(selection.pair), 3))
        if selection.bodies is None:
            places = self.system.kinematics(q).poses  # type: ignore[attr-defined]
        else:
            places = self.system.placements(q, selection.bodies)
        stand(places, selection.owners, selection.numbers, gap, point)
        return Contacts(selection.pair, gap, point, np.ascontiguousarray(selection.numbers[:, 12:15]))

    def _rows(self, q: Array, pairs: Array, tolerance: float, candidates: PairCandidates) -> Rows | None:
        if not self._one_mechanism:
            return super()._rows(q, pairs, tolerance, candidates)
        selection = self._selection if pairs is self._pairs else self._select(pairs)
        poses, columns, support = self.system.kinematics(q)  # type: ignore[attr-defined]
        owners, numbers, index = selection.owners, selection.numbers, selection.index
        while True:
            number, restitution, up = selection.near
            size = len(number)
            gap, point, rows = np.empty(size), np.empty((size, 3)), np.empty((size, self.system.nv))
            count, vain, same = _touch(
                poses, columns, support, owners, numbers, tolerance, candidates.clearance, index, gap, point, rows
            )  # fmt: skip
            if same:
                candidates.any_empty = vain
                return Rows(number, gap, rows, restitution, point, up) if count else None
            near = index[1 : 1 + count]
            pair, up = selection.pair[near], np.ascontiguousarray(numbers[near, 12:15])
            selection.near = _Near(pair, self.restitution[pair], up)

"""Shapes against half-spaces, by the points they can stand on: exact, smooth, and all of a flat face at once.

A polyhedron stands on its vertices, a capsule on its two end balls, a cylinder on its rims: each point is a row of its
own, whose gap and gradient are smooth functions of the configuration. On a rim or an ellipsoid one point moves along
with what is lowest.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..compiled import kernel
from ..system import System, articulated
from . import pairs
from .active import Rows
from .pairs import Array, Contacts, Pairs, chosen, sift_plain
from .shapes import HalfSpace, PlacedShape

_MOST_SELECTIONS = 1000
# a rim tilted by less than this is level: any point of it will do
_LEVEL = 1e-9


class _Selection(NamedTuple):
    """The points of some pairs, gathered: what `_stand` is told of each."""

    pair: Array
    bodies: Array
    frame: Array
    local: Array
    swell: Array
    up: Array
    radius: Array
    level: Array


def _stand_plain(
    places: Array, frame: Array, local: Array, swell: Array, up: Array, radius: Array, level: Array,
    gap: Array, point: Array, pair: Array, tolerance: float, budget: Array, index: Array,
) -> tuple[int, bool]:  # fmt: skip
    """Write gaps and contact points of points of bodies above half-spaces.

    Parameters
    ----------
    places : ndarray, shape (b, 4, 3)
        Where the bodies are: columns of the rotation, then the origin.
    frame : ndarray of int, shape (k,)
        Which of them each point belongs to.
    local : ndarray, shape (k, 3)
        The points in their bodies, or the centres of the rims and ellipsoids they move on.
    swell : ndarray, shape (k, 3, 3)
        The half axes of these in their bodies, as columns; zero for a point that is fixed.
    up : ndarray, shape (k, 3)
        Normals of the half-spaces.
    radius, level : ndarray, shape (k,)
        Radius of the ball around each point, and that plus the half-space's offset [m].
    gap, point : ndarray, shapes (k,) and (k, 3)
        Receive the results.
    pair, tolerance, budget, index
        As of `sift`, which this ends with.
    """
    R, origin = places[frame, :3], places[frame, 3]
    toward = np.matvec(swell.transpose(0, 2, 1), np.matvec(R, up))
    length = np.sqrt(np.vecdot(toward, toward))[:, None]
    tilted = length > _LEVEL * np.abs(swell).max(axis=(1, 2), initial=0.0)[:, None]
    lowest = np.where(tilted, -toward / np.where(tilted, length, 1.0), np.array([1.0, 0.0, 0.0]))
    world = np.matvec(R.transpose(0, 2, 1), local + np.matvec(swell, lowest)) + origin
    gap[:] = np.vecdot(world, up) - level
    point[:] = world - radius[:, None] * up
    return sift_plain(pair, gap, tolerance, budget, index)


@kernel(
    "Tuple((i8, b1))(f8[:,:,::1], i8[::1], f8[:,::1], f8[:,:,::1], f8[:,::1], f8[::1], f8[::1], f8[::1], f8[:,::1],"
    " i8[::1], f8, f8[::1], i8[::1])",
    plain=_stand_plain,
)
def _stand(
    places: Array,
    frame: Array,
    local: Array,
    swell: Array,
    up: Array,
    radius: Array,
    level: Array,
    gap: Array,
    point: Array,
    pair: Array,
    tolerance: float,
    budget: Array,
    index: Array,
) -> tuple[int, bool]:
    for i in range(len(frame)):
        P, B = places[frame[i]], swell[i]
        x, y, z = local[i, 0], local[i, 1], local[i, 2]
        if B[0, 0] != 0.0 or B[1, 0] != 0.0 or B[2, 0] != 0.0:
            u = P[0, 0] * up[i, 0] + P[0, 1] * up[i, 1] + P[0, 2] * up[i, 2]
            v = P[1, 0] * up[i, 0] + P[1, 1] * up[i, 1] + P[1, 2] * up[i, 2]
            w = P[2, 0] * up[i, 0] + P[2, 1] * up[i, 1] + P[2, 2] * up[i, 2]
            a = B[0, 0] * u + B[1, 0] * v + B[2, 0] * w
            b = B[0, 1] * u + B[1, 1] * v + B[2, 1] * w
            c = B[0, 2] * u + B[1, 2] * v + B[2, 2] * w
            length = np.sqrt(a * a + b * b + c * c)
            if length > _LEVEL * np.abs(B).max():
                a, b, c = -a / length, -b / length, -c / length
            else:
                a, b, c = 1.0, 0.0, 0.0
            x += B[0, 0] * a + B[0, 1] * b + B[0, 2] * c
            y += B[1, 0] * a + B[1, 1] * b + B[1, 2] * c
            z += B[2, 0] * a + B[2, 1] * b + B[2, 2] * c
        gap[i] = -level[i]
        for k in range(3):
            where = x * P[0, k] + y * P[1, k] + z * P[2, k] + P[3, k]
            gap[i] += where * up[i, k]
            point[i, k] = where - radius[i] * up[i, k]
    return pairs.sift(pair, gap, tolerance, budget, index)


def _touch_plain(
    poses: Array, columns: Array, support: Array, frame: Array, local: Array, swell: Array, up: Array, radius: Array,
    level: Array, gap: Array, point: Array, pair: Array, first: Array, second: Array, tolerance: float, budget: Array,
    index: Array, rows: Array,
) -> tuple[int, bool]:  # fmt: skip
    """Do what `_stand` does and, if all points are within the tolerance, write their rows, as `separation` does."""
    count, vain = _stand_plain(
        poses, frame, local, swell, up, radius, level, gap, point, pair, tolerance, budget, index
    )  # fmt: skip
    if count == len(gap):
        articulated.separation_plain(columns, support, first, second, point, up, rows)
    return count, vain


@kernel(
    "Tuple((i8, b1))(f8[:,:,::1], f8[:,::1], f8[:,::1], i8[::1], f8[:,::1], f8[:,:,::1], f8[:,::1], f8[::1], f8[::1],"
    " f8[::1], f8[:,::1], i8[::1], i8[::1], i8[::1], f8, f8[::1], i8[::1], f8[:,::1])",
    plain=_touch_plain,
)
def _touch(
    poses: Array, columns: Array, support: Array, frame: Array, local: Array, swell: Array, up: Array, radius: Array,
    level: Array, gap: Array, point: Array, pair: Array, first: Array, second: Array, tolerance: float, budget: Array,
    index: Array, rows: Array,
) -> tuple[int, bool]:  # fmt: skip
    count, vain = _stand(poses, frame, local, swell, up, radius, level, gap, point, pair, tolerance, budget, index)
    if count == len(gap):
        articulated.separation(columns, support, first, second, point, up, rows)
    return count, vain


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
    """

    def __init__(
        self,
        system: System,
        walls: Sequence[HalfSpace],
        shapes: Sequence[PlacedShape],
        names: Sequence[str],
        restitution: Array,
    ) -> None:
        super().__init__(system, [None] * len(shapes), shapes, names, restitution)
        # there one kernel does it all
        self._one_mechanism = hasattr(system, "kinematics")
        self._wall_normal = np.array([w.normal for w in walls], dtype=float).reshape(-1, 3)
        self._wall_offset = np.array([w.offset for w in walls], dtype=float)
        points, swell, radii, owner = [np.zeros((0, 3))], [np.zeros((0, 3, 3))], [], []
        for pair, placed in enumerate(shapes):
            centres, half_axes, radius = placed.shape.standing_points()
            points.append(centres @ placed.rotation.T + placed.position)
            swell.append(placed.rotation * half_axes[:, None, :])
            radii.extend([radius] * len(centres))
            owner.extend([pair] * len(centres))
        self._points, self._swell = np.concatenate(points), np.concatenate(swell)
        self._radius, self._owner = np.array(radii, dtype=float), np.array(owner, dtype=np.int64)
        self._selections: dict[bytes, _Selection] = {}
        # the last of them, whose pairs may be the same array again
        self._pairs: Array | None = None
        self._selection: _Selection

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
        chosen = np.flatnonzero(np.isin(self._owner, pairs))
        pair, radius = self._owner[chosen], self._radius[chosen]
        bodies, frame = np.unique(self._second_body[pair], return_inverse=True)
        return _Selection(
            pair,
            bodies,
            frame.astype(np.int64),
            self._points[chosen],
            self._swell[chosen],
            self._wall_normal[pair],
            radius,
            self._wall_offset[pair] + radius,
        )

    def _stand_at(self, q: Array, due: Array, tolerance: float) -> tuple[Contacts, Array, int, bool]:
        """Return all contacts of some pairs, which of them are within the tolerance, how many, and what `sift` says."""
        pair, bodies, frame, local, swell, up, radius, level = self._select(due)
        k = len(level)
        gap, point, index = np.empty(k), np.empty((k, 3)), np.empty(k, np.int64)
        places = self.system.placements(q, bodies)
        count, vain = _stand(
            places, frame, local, swell, up, radius, level, gap, point, pair, tolerance, self._budget, index
        )  # fmt: skip
        return Contacts(pair, gap, point, up), index, count, vain

    def rows(self, q: Array, due: Array, tolerance: float) -> tuple[Rows | None, bool]:
        if not self._one_mechanism:
            return super().rows(q, due, tolerance)
        poses, columns, support = self.system.kinematics(q)  # type: ignore[attr-defined]
        pair, _, _, local, swell, up, radius, level = self._select(due)
        number, first, second, restitution = self._sides_of(pair)
        k = len(level)
        gap, point, index, rows = np.empty(k), np.empty((k, 3)), np.empty(k, np.int64), np.empty((k, self.system.nv))
        count, vain = _touch(
            poses, columns, support, second, local, swell, up, radius, level, gap, point, pair, first, second,
            tolerance, self._budget, index, rows,
        )  # fmt: skip
        if count == k:
            return Rows(number, gap, rows, restitution, point, up), vain
        if not count:
            return None, vain
        near = index[:count]
        point, up = point.take(near, 0), up.take(near, 0)
        rows = self.system.separation_rows(q, first.take(near), second.take(near), point, up)
        return Rows(number.take(near), gap.take(near), rows, restitution.take(near), point, up), vain

    def near(self, q: Array, due: Array, tolerance: float) -> tuple[Contacts | None, bool]:
        contacts, index, count, vain = self._stand_at(q, due, tolerance)
        return chosen(contacts, index, count), vain

    def contacts(self, q: Array, due: Array, tolerance: float) -> Contacts:
        return self._stand_at(q, due, tolerance)[0]

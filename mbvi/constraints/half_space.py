"""Shapes against half-spaces, by the points they can stand on: exact, smooth, and all of a flat face at once.

A polyhedron stands on its vertices, a capsule on its two end balls, a cylinder on its rims: each point is a row of its
own, whose gap and gradient are smooth functions of the configuration.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..system import System
from .pairs import Array, Contacts, Pairs
from .shapes import HalfSpace, PlacedShape

_MOST_SELECTIONS = 1000


class _Selection(NamedTuple):
    """The points of some pairs, gathered: pair, body and frame of each, in the body (`local`) and against the wall."""

    pair: Array
    bodies: list[int]
    frame: Array
    one_each: bool
    local: Array
    up: Array
    ball: Array
    level: Array
    moving: dict[int, Array]


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
        self._shapes = tuple(shapes)
        self._wall_normal = np.array([w.normal for w in walls], dtype=float).reshape(-1, 3)
        self._wall_offset = np.array([w.offset for w in walls], dtype=float)
        points, radii, owner = [], [], []
        # pairs whose lowest points move over the surface, with where those stand in the stack of points
        self._moving: dict[int, slice] = {}
        for pair, placed in enumerate(shapes):
            fixed, radius = placed.shape.standing_points()
            points.append(fixed @ placed.rotation.T + placed.position)
            count = len(fixed)
            if hasattr(placed.shape, "lowest"):
                spare = 1 if not count else 2
                start = sum(map(len, points))
                self._moving[pair] = slice(start, start + spare)
                points.append(np.zeros((spare, 3)))
                count += spare
            radii.extend([radius] * count)
            owner.extend([pair] * count)
        self._points = np.concatenate(points) if points else np.zeros((0, 3))
        self._radius, self._owner = np.array(radii), np.array(owner, dtype=np.intp)
        self._selections: dict[bytes, _Selection] = {}

    def _select(self, pairs: Array) -> _Selection:
        """Gather the points of the asked pairs; the same few sets of pairs come again and again."""
        key = pairs.tobytes()
        found = self._selections.get(key)
        if found is None:
            if len(self._selections) >= _MOST_SELECTIONS:
                self._selections.clear()
            found = self._selections[key] = self._gather(pairs)
        return found

    def _gather(self, pairs: Array) -> _Selection:
        chosen = np.flatnonzero(np.isin(self._owner, pairs))
        pair = self._owner[chosen]
        bodies, frame = np.unique(self._second_body[pair], return_inverse=True)
        up = self._wall_normal[pair]
        moving = {}
        for p in pairs.tolist():
            if p in self._moving:
                count = self._moving[p].stop - self._moving[p].start
                moving[p] = np.flatnonzero(pair == p)[-count:]
        return _Selection(
            pair,
            [int(b) for b in bodies],
            frame,
            len(bodies) == len(chosen),
            self._points[chosen],
            up,
            self._radius[chosen][:, None] * up,
            self._wall_offset[pair] + self._radius[chosen],
            moving,
        )

    def contacts(self, q: Array, pairs: Array, tolerance: float) -> Contacts:
        chosen = self._select(pairs)
        R, origin = self.system.placements(q, chosen.bodies)
        if chosen.moving:
            self._move_lowest(R, chosen)
        if not chosen.one_each:
            R, origin = R.take(chosen.frame, 0), origin.take(chosen.frame, 0)
        world = np.matvec(R, chosen.local)
        world += origin
        gap = np.vecdot(world, chosen.up)
        gap -= chosen.level
        world -= chosen.ball
        return Contacts(chosen.pair, gap, world, chosen.up)

    def _move_lowest(self, R: Array, chosen: _Selection) -> None:
        for pair, place in chosen.moving.items():
            placed = self._shapes[pair]
            up = placed.rotation.T @ (R[chosen.frame[place[0]]].T @ self._wall_normal[pair])
            lowest = placed.shape.lowest(up)  # type: ignore[union-attr]
            if len(lowest):
                chosen.local[place] = lowest @ placed.rotation.T + placed.position
            else:
                # a cylinder upright: its rims are level, any point of them will do
                chosen.local[place] = chosen.local[place[0] - 1]

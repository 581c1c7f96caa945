"""Shapes against half-spaces, by the points they can stand on: exact, smooth, and all of a flat face at once.

A polyhedron stands on its vertices, a capsule on its two end balls, a cylinder on its rims: each point is a row of its
own, whose gap and gradient are smooth functions of the configuration.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..system import System
from .pairs import Array, Contacts, Pairs
from .shapes import HalfSpace, PlacedShape


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
        self._asked: bytes | None = None

    def _select(self, pairs: Array) -> None:
        """Gather the points of the asked pairs; they are mostly those of the step before."""
        key = pairs.tobytes()
        if key == self._asked:
            return
        self._asked = key
        chosen = np.flatnonzero(np.isin(self._owner, pairs))
        self._chosen = chosen
        self._pair = self._owner[chosen]
        bodies, self._frame = np.unique(self._second_body[self._pair], return_inverse=True)
        self._bodies = [int(b) for b in bodies]
        self._one_each = len(bodies) == len(chosen)
        self._local = self._points[chosen]
        self._up = self._wall_normal[self._pair]
        self._ball = self._radius[chosen][:, None] * self._up
        self._level = self._wall_offset[self._pair] + self._radius[chosen]
        self._places = {p: np.flatnonzero(self._pair == p)[-(s.stop - s.start) :] for p, s in self._moving.items()}
        self._places = {p: place for p, place in self._places.items() if place.size}

    def contacts(self, q: Array, pairs: Array, tolerance: float) -> Contacts:  # noqa: D102
        self._select(pairs)
        R, origin = self.system.placements(q, self._bodies)
        if self._places:
            self._move_lowest(R)
        if not self._one_each:
            R, origin = R.take(self._frame, 0), origin.take(self._frame, 0)
        world = np.matmul(R, self._local[:, :, None])[:, :, 0]
        world += origin
        gap = np.einsum("ij,ij->i", world, self._up)
        gap -= self._level
        return Contacts(self._pair, gap, world - self._ball, self._up)

    def _move_lowest(self, R: Array) -> None:
        for pair, place in self._places.items():
            placed = self._shapes[pair]
            up = placed.rotation.T @ (R[self._frame[place[0]]].T @ self._wall_normal[pair])
            lowest = placed.shape.lowest(up)  # type: ignore[union-attr]
            if len(lowest):
                self._local[place] = lowest @ placed.rotation.T + placed.position
            else:
                # a cylinder upright: its rims are level, any point of them will do
                self._local[place] = self._local[place[0] - 1]

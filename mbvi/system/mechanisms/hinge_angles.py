"""The angles of hinges between bodies, and their gradients."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..free.sparse_rows import dense
from ..system import Array, System


class HingeAngles(NamedTuple):
    """How far the second bodies of hinges are turned about them.

    Attributes
    ----------
    bodies : ndarray of int, shape (2, n)
        First and second body of each hinge; 0 is the world.
    frames : ndarray, shape (2, n, 4, 3)
        Frame of the hinge in the first and in the second body: its axes in rows, of which it turns about the third,
        then its origin. The angle is zero where both have the same axes.
    """

    bodies: Array
    frames: Array

    def at(self, system: System, q: Array) -> Array:
        """Return the angles within (-pi, pi], shape (n,) [rad]."""
        (x, y, _, _), (turned, *_) = self._axes(system, q)
        return np.arctan2(np.einsum("ij,ij->i", turned, y), np.einsum("ij,ij->i", turned, x))

    def gradients(self, system: System, q: Array) -> Array:
        """Return the gradients of the angles, shape (n, nv)."""
        # the rate of a point on one axis along the next one, less that of the origin, is the angular velocity
        (x, y, _, origin), _ = self._axes(system, q)
        first, second = self.bodies
        rows = [dense(system.separation_rows(q, first, second, p, y)) for p in (origin + x, origin)]
        return rows[0] - rows[1]

    def _axes(self, system: System, q: Array) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
        """Return axes and origins of the frames on the first and the second bodies in the world, each (n, 3)."""
        found = []
        for bodies, frames in zip(self.bodies, self.frames, strict=True):
            poses = np.tile(np.vstack([np.eye(3), np.zeros(3)]), (len(bodies), 1, 1))
            moving = np.flatnonzero(bodies)
            if moving.size:
                poses[moving] = system.placements(q, bodies[moving])
            axes = frames[:, :3] @ poses[:, :3]
            origin = np.einsum("ij,ijk->ik", frames[:, 3], poses[:, :3]) + poses[:, 3]
            found.append((*axes.transpose(1, 0, 2), origin))
        return found[0], found[1]

"""The family of limits of hinges that close loops: lower <= angle of the second body about the axis <= upper."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...system import System
from ...system.free.sparse_rows import dense
from ..family import ConstraintFamily
from ..rows import Array


class HingeLimits(ConstraintFamily):
    """Limits of the angles of hinges between bodies, the lower ones first.

    Parameters
    ----------
    system : System
        The system.
    bodies : ndarray of int, shape (2, n)
        First and second body of each hinge; 0 is the world.
    frames : ndarray, shape (2, n, 4, 3)
        Frame of the hinge in the first and in the second body: its axes in rows, of which it turns about the third,
        then its origin. The angle is zero where both have the same axes, and within (-pi, pi].
    limits : ndarray, shape (2, n)
        Lower and upper limits [rad].
    names : sequence of str
        Names of the hinges.
    restitution : float
        e of all.
    lever : float
        The factor by which an angle becomes a length [m/rad].
    """

    of_joints = True

    def __init__(
        self, system: System, bodies: Array, frames: Array, limits: Array, names: Sequence[str], restitution: float,
        lever: float,
    ) -> None:  # fmt: skip
        self._system, self._bodies, self._frames, self._limits = system, bodies, frames, limits
        self.size = 2 * len(names)
        self.names = tuple(f"{name} {side} limit" for side in ("lower", "upper") for name in names)
        self.restitution, self.lever = restitution, lever

    def gap(self, t: float, q: Array) -> Array:
        """Return the angles from the lower and to the upper limits, shape (2 n,) [rad]."""
        (x, y, _, _), (turned, *_) = self._axes(q)
        angle = np.arctan2(np.einsum("ij,ij->i", turned, y), np.einsum("ij,ij->i", turned, x))
        return np.concatenate([angle - self._limits[0], self._limits[1] - angle])

    def gradient(self, t: float, q: Array) -> Array:
        """Return the gradients of the angles and their negatives, shape (2 n, nv)."""
        # the rate of a point on one axis along the next one, less that of the origin, is the angular velocity
        (x, y, _, origin), _ = self._axes(q)
        first, second = self._bodies
        rows = [dense(self._system.separation_rows(q, first, second, p, y)) for p in (origin + x, origin)]
        turning = rows[0] - rows[1]
        return np.concatenate([turning, -turning])

    def describe(self) -> str:
        """Return one line of `Problem.report()`, in words."""
        return f"{self.size} limits of hinges"

    def _axes(self, q: Array) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
        """Return axes and origins of the frames on the first and the second bodies in the world, each (n, 3)."""
        found = []
        for bodies, frames in zip(self._bodies, self._frames, strict=True):
            poses = np.tile(np.vstack([np.eye(3), np.zeros(3)]), (len(bodies), 1, 1))
            moving = np.flatnonzero(bodies)
            if moving.size:
                poses[moving] = self._system.placements(q, bodies[moving])
            axes = frames[:, :3] @ poses[:, :3]
            origin = np.einsum("ij,ijk->ik", frames[:, 3], poses[:, :3]) + poses[:, 3]
            found.append((*axes.transpose(1, 0, 2), origin))
        return found[0], found[1]

"""Walls with a prescribed motion: any family, evaluated in the frame that moves with its walls."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..arguments import all_finite
from ..errors import DivergedError
from ..geometry.motion import Motion
from ..system import System
from .family import ConstraintFamily
from .rows import Array, Rows


class MovingFrame:
    """A system as it looks from a frame with a prescribed motion, when it was last looked at.

    Parameters
    ----------
    system : System
        What moves the bodies.
    motion : Motion
        How the frame moves.
    where : slice
        The part of q that holds centres of spheres.
    """

    def __init__(self, system: System, motion: Motion, where: slice) -> None:
        self._system, self._motion, self._where = system, motion, where
        self.nq, self.nv, self.bodies = system.nq, system.nv, system.bodies

    def look(self, t: float, q: Array) -> Array:
        """Look at the system at (t, q); return q with the spheres' centres as the frame sees them."""
        turn, place = self._motion.pose(t)
        self._turn, self._place = np.asarray(turn), np.asarray(place)
        self._u, self._w = self._motion.twist(t)
        flat = np.concatenate([self._turn.ravel(), self._place, self._u, self._w])
        if not all_finite(flat):
            raise DivergedError(
                f"the motion {self._motion!r} is not finite at t = {t:.9g} s: correct its pose or twist"
            )
        self._q, seen = q, q.copy()
        seen[self._where] = ((q[self._where].reshape(-1, 3) - self._place) @ self._turn).reshape(-1)
        return seen

    def placements(self, q: Array, bodies: Array) -> Array:
        """Return where bodies are in the frame; see `System`. The configuration is that last looked at."""
        places = self._system.placements(self._q, bodies)
        places[:, 3] -= self._place
        return places @ self._turn

    def separation_rows(self, q: Array, first: Array, second: Array, point: Array, normal: Array) -> Any:
        """Return gradients at points and along normals of the frame; see `System`."""
        return self._system.separation_rows(self._q, first, second, *self.world(point, normal))

    def reach(self, body: int, centre: Array, radius: float) -> Array:
        """Return how far each velocity can carry a point of a body; see `System`."""
        return self._system.reach(body, centre, radius)

    def world(self, point: Array, normal: Array) -> tuple[Array, Array]:
        """Return points and normals of the frame in the world, shapes (k, 3)."""
        return point @ self._turn.T + self._place, normal @ self._turn.T

    def rate(self, point: Array, normal: Array) -> Array:
        """Return how fast the frame moves away at points of the world, against normals out of it, shape (k,)."""
        return -np.vecdot(normal, self._u + np.cross(self._w, point))


class MovingWalls(ConstraintFamily):
    """A family of walls that move together; a wall is the first of every pair.

    Parameters
    ----------
    seen : MovingFrame
        The system that the constraint was made for.
    constraint : ConstraintFamily
        The same walls, as if they stood still.

    Notes
    -----
    It has no envelope: walls travel while q stays the same.
    """

    moving = True

    def __init__(self, seen: MovingFrame, constraint: ConstraintFamily) -> None:
        self.seen, self.constraint = seen, constraint
        self.size, self.restitution, self.smooth = constraint.size, constraint.restitution, constraint.smooth

    def name(self, number: int) -> str:
        """Return the name of one pair."""
        return self.constraint.name(number)

    def describe(self) -> str:
        """Return one line of `Problem.report()`, in words."""
        return f"{self.constraint.describe()}, with a prescribed motion"

    def contacts(self, t: float, q: Array, tolerance: float) -> Rows | None:
        """Return the rows within the tolerance, or None."""
        rows = self.constraint.contacts(t, self.seen.look(t, q), tolerance)
        if rows is None:
            return None
        point, normal = self.seen.world(rows.point, rows.normal)
        return rows._replace(point=point, normal=normal, rate=self.seen.rate(point, normal))

    def gap(self, t: float, q: Array) -> Array:
        """Return the signed distance of every pair, shape (m,) [m]."""
        return np.asarray(self.constraint.gap(t, self.seen.look(t, q)))

    def gradient(self, t: float, q: Array) -> Array:
        """Return the gradient of every pair's distance, shape (m, nv)."""
        return np.asarray(self.constraint.gradient(t, self.seen.look(t, q)))

    def rate(self, t: float, q: Array) -> Array:
        """Return df/dt of every pair at a fixed q, shape (m,) [m/s]."""
        point, normal = self.constraint.nearest_points(self.seen.look(t, q))
        return self.seen.rate(*self.seen.world(point, normal))

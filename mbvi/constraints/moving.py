"""Walls with a prescribed motion: constraints of the world, looked at from the frame that moves."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..arguments import all_finite
from ..errors import DivergedError
from ..geometry.motion import Motion
from ..system import System
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


class MovingWalls:
    """A constraint of walls that move together; a wall is the first of every pair.

    Parameters
    ----------
    seen : MovingFrame
        The system that the constraint was made for.
    constraint : Constraint
        Its walls standing still.
    """

    def __init__(self, seen: MovingFrame, constraint: Any) -> None:
        self.seen, self.constraint = seen, constraint
        self.size = constraint.size if hasattr(constraint, "size") else len(constraint.names)

    @property
    def restitution(self) -> Array:
        """Restitution of its pairs."""
        return np.asarray(self.constraint.restitution)

    def name(self, number: int) -> str:
        """Return the name of one pair."""
        named = self.constraint
        return str(named.name(number) if hasattr(named, "name") else named.names[number])

    def active(self, t: float, q: Array, tolerance: float, travel: Array | None) -> Rows | None:
        """Return the rows within the tolerance, or None."""
        # what walls travel is in no budget
        rows = self.constraint.active(t, self.seen.look(t, q), tolerance, None)
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
        place = self.seen.look(t, q)
        if hasattr(self.constraint, "nearest"):
            found = self.constraint.nearest(place, np.arange(self.size))
        else:
            # these have one row a pair
            found = self.constraint.active(t, place, np.inf, None)
        return self.seen.rate(*self.seen.world(found.point, found.normal))

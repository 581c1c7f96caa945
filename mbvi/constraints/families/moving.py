"""Walls with a prescribed motion: any family, evaluated in the frame that moves with its walls."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...arguments import all_finite
from ...errors import DivergedError
from ...geometry.motion import Motion
from ...system import System
from ...system.system import Part
from ..family import ConstraintFamily
from ..rebuilt import Rebuilt
from ..rotations import rotation_rows
from ..rows import Array, Rows
from ..tangents import Tangents, axes_of
from .spheres import SphereCentres


class MovingFrame(Rebuilt):
    """A system in the coordinates of a frame with a prescribed motion, at the time and q of the last `set_state`.

    Walls that move with the frame stand still in it: families made for still walls evaluate them without change.

    Parameters
    ----------
    system : System
        What moves the bodies.
    motion : Motion
        How the frame moves.
    where : SphereCentres
        Where centres of spheres are in q.
    """

    # poses come from `placements` alone
    single_mechanism = False

    def __init__(self, system: System, motion: Motion, where: SphereCentres) -> None:
        self._system, self.motion, self._where = system, motion, where
        self.nq, self.nv, self.bodies = system.nq, system.nv, system.bodies

    def set_state(self, t: float, q: Array) -> Array:
        """Set time and configuration; return q with the centres of spheres in coordinates of the frame."""
        turn, place = self.motion.pose(t)
        self._turn, self._place = np.asarray(turn), np.asarray(place)
        self._velocity, self._spin = self.motion.twist(t)
        flat = np.concatenate([self._turn.ravel(), self._place, self._velocity, self._spin])
        if not all_finite(flat):
            raise DivergedError(f"the motion {self.motion!r} is not finite at t = {t:.9g} s: correct its pose or twist")
        self._q, inside = q, q.copy()
        self._where.of(inside)[:] = (self._where.of(q) - self._place) @ self._turn
        return inside

    def placements(self, q: Array, bodies: Array) -> Array:
        """Return the placements of bodies in the frame, at the configuration of the last `set_state`; see `System`."""
        places = self._system.placements(self._q, bodies)
        places[:, 3] -= self._place
        return places @ self._turn

    def separation_rows(self, q: Array, first: Array, second: Array, point: Array, normal: Array) -> Any:
        """Return gradients for points and normals in coordinates of the frame; see `System`."""
        return self._system.separation_rows(self._q, first, second, *self.world(point, normal))

    def reach(self, body: int, centre: Array, radius: float) -> Array:
        """Return the most that each velocity moves a point of a body; see `System`."""
        return self._system.reach(body, centre, radius)

    def located_parts(self) -> list[Part]:
        """Return what the system consists of; see `System`."""
        return self._system.located_parts()

    def world(self, point: Array, normal: Array) -> tuple[Array, Array]:
        """Return points and normals in the world from those in the frame, shapes (k, 3)."""
        return point @ self._turn.T + self._place, normal @ self._turn.T

    def motion_after(self, time: float, point: Array, t: float, q: Array) -> tuple[Array, Array]:
        """Return the velocities that points of the walls at t have `time` later, shape (k, 3), and the spin then.

        The points, shape (k, 3), are where they are in the world at t; meanwhile they move with the walls.
        """
        self.set_state(t, q)
        inside = (point - self._place) @ self._turn
        self.set_state(t + time, q)
        return self.velocity(self.world(inside, inside)[0]), self._spin

    def at_place(self, t: float, q: Array, rows: Rows, bodies: tuple[Array, Array]) -> Rows:
        """Return rows with the gradients and rates that contacts at the same points and normals have at (t, q).

        `bodies` are the first and the second body of each, where the walls are the world.
        """
        self.set_state(t, q)
        contact = rows.point, rows.normal
        return rows._replace(jacobian=self.separation_in_world(*bodies, *contact), rate=self.rate(*contact))

    def in_world(self, poses: Array) -> Array:
        """Return poses in the world from those in the frame, shape (..., 4, 3)."""
        poses = poses @ self._turn.T
        poses[..., 3, :] += self._place
        return poses

    def rate(self, point: Array, normal: Array) -> Array:
        """Return df/dt of gaps between walls of the frame and bodies that stand still, shape (k,) [m/s].

        Points and normals are in the world; the normals point out of the walls.
        """
        return -np.vecdot(normal, self.velocity(point))

    def velocity(self, point: Array) -> Array:
        """Return the velocities of points of the walls, shape (k, 3) [m/s]."""
        x, y, z = np.asarray(self._spin).tolist()
        # np.cross takes several times as long
        return np.asarray(self._velocity + point @ np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]))

    @property
    def spin(self) -> Array:
        """Angular velocity of the walls, shape (3,) [rad/s]."""
        return self._spin

    def separation_in_world(self, first: Array, second: Array, point: Array, normal: Array) -> Any:
        """Return gradients for points and normals in the world; see `System.separation_rows`."""
        return self._system.separation_rows(self._q, first, second, point, normal)


class MovingWalls(Rebuilt, ConstraintFamily):
    """A family of walls that move together; a wall is the first of every pair.

    Parameters
    ----------
    frame : MovingFrame
        The frame of the walls, for which the family was made.
    constraint : ConstraintFamily
        The family of the walls in that frame, where they stand still.

    Notes
    -----
    It has no envelope, and is queried at every step: a gap can fall while q stays the same.
    """

    moving = True
    at_rest: ConstraintFamily

    def __init__(self, frame: MovingFrame, constraint: ConstraintFamily) -> None:
        self.frame, self.at_rest = frame, constraint
        self.size, self.restitution, self.smooth = constraint.size, constraint.restitution, constraint.smooth
        self.friction = constraint.friction

    def rebuilt_with(self, old: Any, new: Any) -> MovingWalls:
        """Return a copy with another object in the place of one argument of the frame."""
        frame = self.frame.rebuilt_with(old, new)
        assert isinstance(self.at_rest, Rebuilt)
        return MovingWalls(frame, self.at_rest.rebuilt_with(self.frame, frame))

    def name(self, number: int) -> str:
        """Return the name of one pair."""
        return self.at_rest.name(number)

    def bending_envelope(self) -> Array | None:
        """Return the envelope of the walls if they stood still, shape (nv,)."""
        return self.at_rest.bending_envelope()

    def changes_of_walls(self, times: tuple[float, float, float], q: Array, points: Array) -> Array:
        """Return by how much points of the walls change their velocity, shape (k,) [m/s]; see the base class."""
        speeds = [self.frame.motion_after(t - times[1], points, times[1], q)[0] for t in times]
        return np.asarray(np.linalg.norm(np.diff(speeds, axis=0), axis=2).max(axis=0))

    def friction_of(self, numbers: Array) -> Array:
        """Return the coefficients of friction of some pairs, shape (k,)."""
        return self.at_rest.friction_of(numbers)

    def tangents(self, t: float, q: Array, rows: Rows, friction: Array) -> Tangents:
        """Return the tangents of some rows; those of the walls move with them."""
        self.frame.set_state(t, q)
        axes, first, second = axes_of(rows.normal), *self.at_rest.bodies_of(rows.constraint)
        first, second, point = (np.repeat(part, 2, axis=0) for part in (first, second, rows.point))
        jacobian = self.frame.separation_in_world(first, second, point, axes.reshape(-1, 3))
        rate = -np.vecdot(axes, self.frame.velocity(rows.point)[:, None])
        return Tangents(friction, axes, jacobian, rate.ravel())

    def rotations(self, t: float, q: Array, rows: Rows, axes: Array) -> tuple[Any, Array]:
        """Return the rows and the rates at v = 0 of angular velocities relative to the walls; see `rotation_rows`."""
        self.frame.set_state(t, q)
        bodies = self.at_rest.bodies_of(rows.constraint)
        found = rotation_rows(self.frame.separation_in_world, bodies, rows, axes)
        about = np.concatenate([rows.normal[:, None], axes], axis=1)
        return found, -(about @ self.frame.spin).ravel()

    def poses_of(self, numbers: Array, t: float, q: Array) -> Array | None:
        """Return the poses of walls, that of the frame, and of bodies; see the base class."""
        found = self.at_rest.poses_of(numbers, t, self.frame.set_state(t, q))
        return None if found is None else self.frame.in_world(found)

    @property
    def count(self) -> int:
        """How many constraints there are."""
        return self.at_rest.count

    def describe(self) -> str:
        """Return one line of `Problem.report()`, in words."""
        return f"{self.at_rest.describe()}, with a prescribed motion"

    def contacts(self, t: float, q: Array, tolerance: float) -> Rows | None:
        """Return the rows within the tolerance, or None."""
        rows = self.at_rest.contacts(t, self.frame.set_state(t, q), tolerance)
        if rows is None:
            return None
        point, normal = self.frame.world(rows.point, rows.normal)
        return rows._replace(point=point, normal=normal, rate=self.frame.rate(point, normal))

    def gap(self, t: float, q: Array) -> Array:
        """Return the signed distance of every pair, shape (m,) [m]."""
        return np.asarray(self.at_rest.gap(t, self.frame.set_state(t, q)))

    def gradient(self, t: float, q: Array) -> Array:
        """Return the gradient of every pair's distance, shape (m, nv)."""
        return np.asarray(self.at_rest.gradient(t, self.frame.set_state(t, q)))

    def rate(self, t: float, q: Array) -> Array:
        """Return df/dt of every pair at a fixed q, shape (m,) [m/s]."""
        point, normal = self.at_rest.nearest_points(self.frame.set_state(t, q))
        return self.frame.rate(*self.frame.world(point, normal))

"""Systems of bodies that move in a plane: q is that of three dimensions, v holds two velocities and a turning rate.

The velocities of a body in the plane are constant combinations of its velocities in space: those of its centre are in
the world's axes, and its rotation axis, the normal of the plane, is fixed in the body. So M is constant and diagonal,
and no body turns out of the plane.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import pinocchio as pin
from scipy.sparse import block_diag, csr_array

from ...compiled import plain_array
from ...projection import DiagonalMetric
from ...projection.row_speeds import times
from ..system import Array, System
from .bodies import FreeBodies, Spheres
from .sparse_rows import MOST_DENSE, rows_of_two
from .turning import planar_separation_rows


class PlanarSpheres(Spheres):
    """Frictionless spheres in a plane: two degrees of freedom each.

    Parameters
    ----------
    masses, gravity, names
        As `Spheres`.
    axes : ndarray, shape (3, 3)
        In its rows two axes of the world in their order, and their cross product.
    """

    def __init__(self, masses: Array, gravity: Array, names: tuple[str, ...], axes: Array) -> None:
        super().__init__(masses, gravity, names)
        self.nv = 2 * len(masses)
        self.sparse = self.nv > MOST_DENSE
        self.axes, self._along = axes, _columns(axes)
        self._metric = DiagonalMetric(np.repeat(masses, 2))
        # indices in q of the coordinates that velocities change
        self._places = np.add.outer(np.arange(0, self.nq, 3), np.arange(3)[self._along]).ravel()
        self._pull = np.tile(gravity[self._along], len(masses))
        self._weight = masses[:, None] * gravity

    @cached_property
    def in_space(self) -> csr_array:
        """The matrix that maps v to the velocities of centres in space, shape (3 n, nv)."""
        return csr_array(block_diag([np.eye(3)[:, self._along]] * len(self._weight)))

    def integrate(self, q: Array, dv: Array) -> Array:
        new = q.copy()
        new[self._places] += dv
        return new

    def difference(self, q0: Array, q1: Array) -> Array:
        return (q1 - q0).take(self._places)

    def potential_energy(self, t: float, q: Array) -> float:
        return float(-(q.reshape(-1, 3) * self._weight).sum())

    def separation_rows(self, q: Array, first: Array, second: Array, point: Array, normal: Array) -> Array | csr_array:
        rows = normal[:, self._along]
        return rows_of_two(self.nv, self.sparse, first, second, -rows, rows)

    def reach(self, body: int, centre: Array, radius: float) -> Array:
        reach = np.zeros(self.nv)
        reach[2 * body - 2 : 2 * body] = 1.0
        return reach


class PlanarBodies(FreeBodies):
    """Free rigid bodies in a plane: three degrees of freedom each.

    Parameters
    ----------
    masses, inertias, gravity, names
        As `FreeBodies`.
    axes : ndarray, shape (3, 3)
        As `PlanarSpheres`.
    normals : ndarray, shape (n, 3)
        The plane's normal in each body's axes.
    """

    def __init__(
        self, masses: Array, inertias: Array, gravity: Array, names: tuple[str, ...], axes: Array, normals: Array
    ) -> None:
        super().__init__(masses, inertias, gravity, names)
        self.nv = 3 * len(masses)
        self.sparse = self.nv > MOST_DENSE
        self.axes, self._along, self.normals = axes, _columns(axes), normals
        # directions of the velocities, in the order of the world's axes, and the rotation axis
        self._directions = np.vstack([np.eye(3)[self._along], axes[2]])
        self.moments = np.einsum("ki,kij,kj->k", normals, inertias, normals)
        diagonal = np.stack([masses, masses, self.moments], axis=1).ravel()
        self._metric = DiagonalMetric(diagonal)
        pull = np.zeros((len(masses), 3))
        pull[:, :2] = gravity[self._along]
        self._falling = pull
        self._diagonal = diagonal
        self.hold(np.zeros(len(masses), bool))

    def hold(self, held: Array) -> None:
        self._pull = np.where(held[:, None], 0.0, self._falling).ravel()
        self._load = self._diagonal * self._pull

    def integrate(self, q: Array, dv: Array) -> Array:
        return super().integrate(q, times(self.in_space, dv))

    integrate_each, difference_each = System.integrate_each, System.difference_each

    @cached_property
    def in_space(self) -> csr_array:
        """The matrix that maps v to the velocities of bodies in space, shape (6 n, nv)."""
        across = np.eye(3)[:, self._along]
        return csr_array(block_diag([part for normal in self.normals for part in (across, normal[:, None])]))

    def difference(self, q0: Array, q1: Array) -> Array:
        full = super().difference(q0, q1).reshape(-1, 6)
        dv = np.empty((len(full), 3))
        dv[:, :2] = full[:, :3][:, self._along]
        dv[:, 2] = np.vecdot(full[:, 3:], self.normals)
        return dv.reshape(-1)

    def force(self, t: float, q: Array, v: Array) -> Array:
        return self._load

    def free_velocity(self, t: float, q: Array, v: Array, h: float) -> Array:
        return v + h * self._pull

    # their axis of rotation is fixed, and no gyroscopic torque acts along it
    coast, pushed_velocity = System.coast, System.pushed_velocity

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        return self._pull

    def chart_rate(self, q: Array, dv: Array, v: Array) -> Array:
        return v

    def separation_rows(self, q: Array, first: Array, second: Array, point: Array, normal: Array) -> Array | csr_array:
        rows = np.empty((2, len(point), 3))
        q, kernel_arguments = plain_array(q), (self._directions, plain_array(point), plain_array(normal))
        for side, own, sign in zip((first, second), rows, (-1.0, 1.0), strict=True):
            planar_separation_rows(q, np.ascontiguousarray(side, np.int64), sign, *kernel_arguments, own)
        return rows_of_two(self.nv, self.sparse, first, second, *rows)

    def point_bias(self, q: Array, v: Array, bodies: Array, points: Array) -> Array:
        return super().point_bias(q, times(self.in_space, v), bodies, points)

    def reach(self, body: int, centre: Array, radius: float) -> Array:
        reach = np.zeros(self.nv)
        reach[3 * body - 3 : 3 * body - 1], reach[3 * body - 1] = 1.0, radius + float(np.linalg.norm(centre))
        return reach

    def are_lengths(self) -> Array:
        return np.tile([True, True, False], self.independent_bodies)


def _columns(axes: Array) -> slice:
    """Return the indices of the coordinates along two axes of the world, in ascending order."""
    first, second = np.argmax(axes[:2], axis=1).tolist()
    return slice(first, second + 1, second - first)


def planar_base(model: pin.Model, pose: pin.SE3, axes: Array) -> pin.Model:
    """Return a mechanism whose free base moves in a plane only.

    Parameters
    ----------
    model : pinocchio.Model
        A mechanism whose first joint is free.
    pose : pinocchio.SE3
        Initial pose of the base, from which the angle of its joint is counted.
    axes : ndarray, shape (3, 3)
        As `PlanarSpheres`.
    """
    across = float(axes[2] @ pose.translation) * axes[2]
    inner = pin.SE3(axes @ pose.rotation, np.zeros(3))
    flat = pin.Model()
    flat.name, flat.gravity = model.name, model.gravity
    flat.addJoint(0, pin.JointModelPlanar(), pin.SE3(axes.T.copy(), across), model.names[1])
    flat.appendBodyToJoint(1, model.inertias[1], inner)
    for joint in range(2, model.njoints):
        parent, place = model.parents[joint], model.jointPlacements[joint]
        flat.addJoint(parent, model.joints[joint], inner * place if parent == 1 else place, model.names[joint])
        flat.appendBodyToJoint(joint, model.inertias[joint], pin.SE3.Identity())
    # behind the base both have the same joints
    flat.lowerPositionLimit[4:], flat.upperPositionLimit[4:] = (
        model.lowerPositionLimit[7:], model.upperPositionLimit[7:]
    )  # fmt: skip
    flat.damping[3:], flat.armature[3:] = model.damping[6:], model.armature[6:]
    return flat

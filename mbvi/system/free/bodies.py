"""Systems of many free bodies in flat arrays: six degrees of freedom each, three for a frictionless sphere."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from ...compiled import plain_array
from ...projection import BodiesMetric, DiagonalMetric, FreeMotion, Metric
from ..system import Array, System
from .coasting import coast
from .sparse_rows import MOST_DENSE, rows_from, rows_of_two
from .spinning import free_velocities, links_of_bodies
from .turning import (
    accelerations,
    chart_rates,
    differences,
    integrate,
    placements,
    separation_rows,
    sparse_separation_rows,
)


class Spheres(System):
    """Frictionless homogeneous spheres, whose rotation is left out because nothing depends on it.

    Parameters
    ----------
    masses : ndarray, shape (n,)
        Masses [kg].
    gravity : ndarray, shape (3,)
        Acceleration of gravity [m/s^2].
    names : sequence of str
        One for each sphere.

    Attributes
    ----------
    masses, gravity
        As given.
    sparse : bool
        Whether its rows are sparse: where it has many bodies, or is part of a system that has many.

    Notes
    -----
    q holds the centres, v their velocities, in the world.
    """

    free_bodies = True
    can_be_sparse = True

    def __init__(self, masses: Array, gravity: Array, names: tuple[str, ...]) -> None:
        self.nq = self.nv = 3 * len(masses)
        self.independent_bodies = len(masses)
        self.velocity_dependent = False
        self.sparse = self.nv > MOST_DENSE
        self.bodies = ("world", *names)
        self.masses, self.gravity = masses, gravity
        self._metric = DiagonalMetric(np.repeat(masses, 3))
        self._pull = np.tile(gravity, len(masses))

    def integrate(self, q: Array, dv: Array) -> Array:
        return q + dv

    def difference(self, q0: Array, q1: Array) -> Array:
        return q1 - q0

    def metric(self, q: Array) -> Metric:
        return self._metric

    def force(self, t: float, q: Array, v: Array) -> Array:
        return self._metric.diagonal * self._pull

    def free_velocity(self, t: float, q: Array, v: Array, h: float) -> Array:
        return v + h * self._pull

    def free_motion(self, t: float, q: Array, v: Array, h: float) -> FreeMotion:
        return FreeMotion(self.free_velocity(t, q, v, h), self._metric)

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        return self._pull

    def chart_rate(self, q: Array, dv: Array, v: Array) -> Array:
        return v

    def kinetic_energy(self, q: Array, v: Array) -> float:
        return float(0.5 * v @ (self._metric.diagonal * v))

    def potential_energy(self, t: float, q: Array) -> float:
        return float(-q @ (self._metric.diagonal * self._pull))

    def placements(self, q: Array, bodies: Array) -> Array:
        places = np.empty((len(bodies), 4, 3))
        places[:, :3] = np.eye(3)
        places[:, 3] = q.reshape(-1, 3)[bodies - 1]
        return places

    def separation_rows(self, q: Array, first: Array, second: Array, point: Array, normal: Array) -> Array | csr_array:
        return rows_of_two(self.nv, self.sparse, first, second, -normal, normal)

    def point_bias(self, q: Array, v: Array, bodies: Array, points: Array) -> Array:
        return np.zeros((len(points), 3))

    def reach(self, body: int, centre: Array, radius: float) -> Array:
        reach = np.zeros(self.nv)
        reach[3 * body - 3 : 3 * body] = 1.0
        return reach

    def go_straight(self) -> Array:
        return np.ones(self.nv, bool)

    def describe(self) -> str:
        n = self.independent_bodies
        return f"{n} sphere{'s' * (n > 1)}, {self.nv // n} degrees of freedom{' each' * (n > 1)}"


class FreeBodies(System):
    """Free rigid bodies.

    Parameters
    ----------
    masses : ndarray, shape (n,)
        Masses [kg].
    inertias : ndarray, shape (n, 3, 3)
        Inertia about the centre of mass in the body's own axes [kg m^2].
    gravity : ndarray, shape (3,)
        Acceleration of gravity [m/s^2].
    names : sequence of str
        One for each body.

    Attributes
    ----------
    masses, inertias, gravity
        As given.
    sparse : bool
        Whether its rows are sparse: where it has many bodies, or is part of a system that has many.
    pull : float
        Acceleration of free fall [m/s^2].

    Notes
    -----
    Per body, q holds the centre of mass in the world and the quaternion (x, y, z, w); v holds the velocity of the
    centre of mass in the world and the angular velocity in the body's axes, so that M is constant. The retraction is
    that of R^3 x SO(3): the centre moves along a line, the body turns about a fixed axis. Gyroscopic torques of a step
    keep the energy of rotation; see `spin`, and `coast_spin` for `Centered`.
    """

    free_bodies = True
    can_be_sparse = True
    can_hold = True
    velocity_dependent = False

    def __init__(self, masses: Array, inertias: Array, gravity: Array, names: tuple[str, ...]) -> None:
        n = self.independent_bodies = len(masses)
        self.nq, self.nv = 7 * n, 6 * n
        self.sparse = self.nv > MOST_DENSE
        self.bodies = ("world", *names)
        self.masses, self.inertias, self.gravity = masses, np.array(inertias, float, order="C"), gravity
        self._inverses = np.linalg.inv(self.inertias)
        self._links = links_of_bodies(self.masses, self.inertias)
        self._lengths = np.tile([True, True, True, False, False, False], n)
        blocks = np.zeros((n, 6, 6))
        blocks[:, :3, :3] = masses[:, None, None] * np.eye(3)
        blocks[:, 3:, 3:] = inertias
        self._metric: Metric = BodiesMetric(blocks)
        self._weight = masses[:, None] * gravity
        # the weight of bodies that are not held
        self._acting = self._weight
        self._pull = self._acting / masses[:, None]
        self.pull = float(np.linalg.norm(gravity))

    def hold(self, held: Array) -> None:
        self._acting = np.where(held[:, None], 0.0, self._weight)
        self._pull = self._acting / self.masses[:, None]

    def integrate(self, q: Array, dv: Array) -> Array:
        new = np.empty(self.nq)
        integrate(plain_array(q), plain_array(dv), new)
        return new

    # bodies of several configurations are as many bodies
    def integrate_each(self, q: Array, dv: Array) -> Array:
        new = np.empty(q.size)
        integrate(plain_array(q.ravel()), plain_array(dv.ravel()), new)
        return new.reshape(q.shape)

    def difference_each(self, q0: Array, q1: Array) -> Array:
        dv = np.empty(q0.size // 7 * 6)
        differences(plain_array(q0.ravel()), plain_array(q1.ravel()), dv)
        return dv.reshape(len(q0), -1)

    def difference(self, q0: Array, q1: Array) -> Array:
        dv = np.empty(6 * self.independent_bodies)
        differences(plain_array(q0), plain_array(q1), dv)
        return dv

    def metric(self, q: Array) -> Metric:
        return self._metric

    def force(self, t: float, q: Array, v: Array) -> Array:
        g = np.empty((len(self.masses), 6))
        spin = v.reshape(-1, 6)[:, 3:]
        momentum = np.einsum("kij,kj->ki", self.inertias, spin)
        g[:, :3] = self._acting
        g[:, 3] = momentum[:, 1] * spin[:, 2] - momentum[:, 2] * spin[:, 1]
        g[:, 4] = momentum[:, 2] * spin[:, 0] - momentum[:, 0] * spin[:, 2]
        g[:, 5] = momentum[:, 0] * spin[:, 1] - momentum[:, 1] * spin[:, 0]
        return g.reshape(-1)

    def free_velocity(self, t: float, q: Array, v: Array, h: float) -> Array:
        out = np.empty(self.nv)
        links = self._links
        free_velocities(plain_array(v), self._pull, links.axes, links.factors, h, links.state, out)
        return out

    def coast(self, v: Array, h: float) -> tuple[Array, Array]:
        displacement, after = np.empty(self.nv), np.empty(self.nv)
        coast(self._links, h, plain_array(v), displacement, after)
        return displacement, after

    def pushed_velocity(self, t: float, q: Array, v: Array, h: float) -> Array:
        pushed = v.copy()
        pushed.reshape(-1, 6)[:, :3] += h * self._pull
        return pushed

    def free_motion(self, t: float, q: Array, v: Array, h: float) -> FreeMotion:
        return FreeMotion(self.free_velocity(t, q, v, h), self._metric)

    def centered_motion(self, t: float, q: Array, v: Array, h: float, at: Array) -> FreeMotion:
        # no force depends on v
        return FreeMotion(self.pushed_velocity(t, q, v, h), self._metric)

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        out = np.empty(self.nv)
        accelerations(plain_array(v), self._pull, self.inertias, self._inverses, out)
        return out

    def chart_rate(self, q: Array, dv: Array, v: Array) -> Array:
        rate = np.empty(self.nv)
        chart_rates(plain_array(dv), plain_array(v), rate)
        return rate

    def kinetic_energy(self, q: Array, v: Array) -> float:
        return float(0.5 * v @ self._metric.apply(v))

    def potential_energy(self, t: float, q: Array) -> float:
        return float(-(q.reshape(-1, 7)[:, :3] * self._weight).sum())

    def placements(self, q: Array, bodies: Array) -> Array:
        places = np.empty((len(bodies), 4, 3))
        placements(plain_array(q), np.ascontiguousarray(bodies, np.int64), places)
        return places

    def separation_rows(self, q: Array, first: Array, second: Array, point: Array, normal: Array) -> Array | csr_array:
        m, q = len(point), plain_array(q)
        first, second = np.ascontiguousarray(first, np.int64), np.ascontiguousarray(second, np.int64)
        point, normal = plain_array(point), plain_array(normal)
        if self.sparse:
            data, columns, starts = np.empty(12 * m), np.empty(12 * m, np.int32), np.empty(m + 1, np.int32)
            count = sparse_separation_rows(
                q, first, second, point, normal, data, columns.view(np.uint32), starts.view(np.uint32)
            )
            return rows_from(data[:count], columns[:count], starts, (m, self.nv))
        rows = np.empty((2, m, 6))
        for side, own, sign in zip((first, second), rows, (-1.0, 1.0), strict=True):
            separation_rows(q, side, sign, point, normal, own)
        return rows_of_two(self.nv, False, first, second, *rows)

    def point_bias(self, q: Array, v: Array, bodies: Array, points: Array) -> Array:
        spin = v.reshape(-1, 6)[bodies - 1, 3:]
        bias = spin * np.vecdot(spin, points)[:, None] - points * np.vecdot(spin, spin)[:, None]
        return np.vecmat(bias, self.placements(q, bodies)[:, :3])

    def reach(self, body: int, centre: Array, radius: float) -> Array:
        reach = np.zeros(self.nv)
        reach[6 * body - 6 : 6 * body - 3] = 1.0
        reach[6 * body - 3 : 6 * body] = radius + float(np.linalg.norm(centre))
        return reach

    def are_lengths(self) -> Array:
        return self._lengths.copy()

    def go_straight(self) -> Array:
        return self.are_lengths()

    def unit_groups(self) -> list[Array]:
        return [7 * np.arange(self.independent_bodies)[:, None] + np.arange(3, 7)]

    def describe(self) -> str:
        n = self.independent_bodies
        return f"{n} free bod{'ies' if n > 1 else 'y'}, {self.nv // n} degrees of freedom{' each' * (n > 1)}"

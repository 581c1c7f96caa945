"""The paper's own setting: M(q) and g(t, q, v) given as functions on R^d."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..errors import InputError
from ..projection import DenseMetric, Metric, Push, as_metric
from .system import Array

# nodes and weights of Gauss and Legendre on [0, 1]
_NODES, _WEIGHTS = (0.5 * (np.polynomial.legendre.leggauss(16)[0] + 1), 0.5 * np.polynomial.legendre.leggauss(16)[1])


class LagrangianSystem:
    """A system of d generalised coordinates, M(q) dv/dt = g(t, q, v) (equation 1).

    Parameters
    ----------
    mass : callable
        mass(q) -> M, shape (d, d), symmetric positive definite.
    force : callable
        force(t, q, v) -> g, shape (d,), the terms quadratic in v included.
    dim : int
        d.
    potential : callable, optional
        potential(q) -> potential energy [J]. Without it the energy takes minus the work of g(t, ., 0) along the
        straight line from the origin to q, which is the potential where g at rest has one.

    Raises
    ------
    InputError
        If an argument is not of its kind; at the first call, if M or g has another shape.
    """

    def __init__(
        self,
        mass: Callable[[Array], Array],
        force: Callable[[float, Array, Array], Array],
        dim: int,
        potential: Callable[[Array], float] | None = None,
    ) -> None:
        if not callable(mass) or not callable(force):
            raise InputError("mass and force must be functions: mass(q) -> (d, d), force(t, q, v) -> (d,)")
        if int(dim) != dim or dim < 1:
            raise InputError(f"dim must be a positive integer; got {dim!r}")
        self.nq = self.nv = int(dim)
        self.bodies: tuple[str, ...] = ("world",)
        self._mass, self._force, self._potential = mass, force, potential

    def integrate(self, q: Array, dv: Array) -> Array:
        return q + dv

    def difference(self, q0: Array, q1: Array) -> Array:
        return q1 - q0

    def metric(self, q: Array) -> Metric:
        M = np.asarray(self._mass(q), dtype=float)
        return as_metric(M, self.nv) if M.ndim != 2 or len(M) != self.nv else DenseMetric(M)

    velocity_dependent = True

    def check(self, t: float, q: Array, v: Array) -> None:
        """Raise `InputError` unless M(q) and g(t, q, v) have their shapes and M its symmetry."""
        as_metric(np.asarray(self._mass(q), dtype=float), self.nv)
        self.force(t, q, v)

    def force(self, t: float, q: Array, v: Array) -> Array:
        g = np.asarray(self._force(t, q, v), dtype=float)
        if g.shape != (self.nv,):
            raise InputError(f"force returned shape {g.shape}; ({self.nv},) is asked for")
        return g

    def free_velocity(self, t: float, q: Array, v: Array, h: float) -> Array:
        return self.push(t, q, v, h).free

    def push(self, t: float, q: Array, v: Array, h: float) -> Push:
        metric = self.metric(q)
        return Push(v + metric.unwhiten(metric.whiten(h * self.force(t, q, v))), metric)

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        metric = self.metric(q)
        return metric.unwhiten(metric.whiten(self.force(t, q, v)))

    def chart_rate(self, q: Array, dv: Array, v: Array) -> Array:
        return v

    def kinetic_energy(self, q: Array, v: Array) -> float:
        return float(0.5 * v @ np.asarray(self._mass(q), dtype=float) @ v)

    def potential_energy(self, t: float, q: Array) -> float:
        if self._potential is not None:
            return float(self._potential(q))
        rest = np.zeros(self.nv)
        work = sum(w * (self.force(t, s * q, rest) @ q) for s, w in zip(_NODES, _WEIGHTS, strict=True))
        return -float(work)

    def placements(self, q: Array, bodies: Array) -> Array:
        raise InputError("a LagrangianSystem has no bodies: its constraints are GapFunctions")

    def separation_rows(self, q: Array, first: Array, second: Array, point: Array, normal: Array) -> Array:
        return np.zeros((len(point), self.nv))

    def point_bias(self, q: Array, v: Array, bodies: Array, points: Array) -> Array:
        return np.zeros((len(points), 3))

    def reach(self, body: int, centre: Array, radius: float) -> Array:
        return np.zeros(self.nv)

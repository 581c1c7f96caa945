"""The paper's own setting: M(q) and g(t, q, v) given as functions on R^d."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..arguments import all_finite, function, integer, optional, returned
from ..errors import InputError
from ..projection import DenseMetric, FreeMotion, Metric
from .given import called, not_finite, short
from .system import Array, System

# nodes and weights of Gauss and Legendre on [0, 1]
_NODES, _WEIGHTS = (0.5 * (np.polynomial.legendre.leggauss(16)[0] + 1), 0.5 * np.polynomial.legendre.leggauss(16)[1])

# largest difference between M and its transpose, relative to the largest entry
_ASYMMETRIC = 1e-9


class LagrangianSystem(System):
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
        potential(q) -> potential energy [J]. Without it the potential energy is minus the work of g(t, ., 0) along the
        straight line from the origin to q, which is exact where g at rest has a potential.

    Raises
    ------
    InputError
        If an argument has a wrong type. At any call, if M or g has another shape or is no real number, or if M is not
        symmetric positive definite.
    DivergedError
        At any call, if M or g is not finite.
    """

    def __init__(
        self,
        mass: Callable[[Array], Array],
        force: Callable[[float, Array, Array], Array],
        dim: int,
        potential: Callable[[Array], float] | None = None,
    ) -> None:
        self._mass = function(mass, "mass", "mass(q) -> (d, d)")
        self._force = function(force, "force", "force(t, q, v) -> (d,)")
        self._potential = optional(function, potential, "potential", "potential(q) -> float")
        self.nq = self.nv = integer(dim, "dim", 1)
        # time of the last step, for error messages
        self._t: float | None = None
        # the bytes of the last M, and its factor: M is often constant
        self._known: tuple[bytes, DenseMetric] | None = None

    def __repr__(self) -> str:
        return f"LagrangianSystem(mass={called(self._mass)}, force={called(self._force)}, dim={self.nv})"

    def integrate(self, q: Array, dv: Array) -> Array:
        return q + dv

    def difference(self, q0: Array, q1: Array) -> Array:
        return q1 - q0

    def integrate_each(self, q: Array, dv: Array) -> Array:
        return q + dv

    def difference_each(self, q0: Array, q1: Array) -> Array:
        return q1 - q0

    def metric(self, q: Array) -> Metric:
        M, size = returned(self._mass(q), f"mass ({called(self._mass)})"), self.nv
        if M.shape != (size, size):
            raise InputError(f"mass ({called(self._mass)}) returned shape {M.shape}; ({size}, {size}) is expected")
        key = M.tobytes()
        if self._known is None or key != self._known[0]:
            # a copy, because the user may change the array
            self._known = key, self._factorised(M.copy(), q)
        return self._known[1]

    def _factorised(self, M: Array, q: Array) -> DenseMetric:
        if not np.isfinite(M).all():
            raise not_finite(f"mass ({called(self._mass)})", M, self._t, q)
        if M.tobytes() != M.T.tobytes() and np.abs(M - M.T).max() > _ASYMMETRIC * np.abs(M).max():
            raise InputError(f"mass ({called(self._mass)}) is not symmetric{self._when()}, q = {short(q)}: {short(M)}")
        try:
            return DenseMetric(M)
        except InputError as error:
            raise InputError(
                f"mass ({called(self._mass)}) is not positive definite{self._when()}, q = {short(q)}: {short(M)}; "
                "check masses, inertias and the coordinates' redundancy"
            ) from error

    def _when(self) -> str:
        return "" if self._t is None else f" near t = {self._t:.9g} s"

    def check(self, t: float, q: Array, v: Array) -> None:
        self.metric(q)
        self.force(t, q, v)

    def functions(self) -> tuple[Callable[..., Any], ...]:
        return self._mass, self._force

    def force(self, t: float, q: Array, v: Array) -> Array:
        g = returned(self._force(t, q, v), f"force ({called(self._force)})")
        if g.shape != (self.nv,):
            raise InputError(f"force ({called(self._force)}) returned shape {g.shape}; ({self.nv},) is expected")
        if not all_finite(g):
            raise not_finite(f"force ({called(self._force)})", g, t, q, v)
        return g

    def free_velocity(self, t: float, q: Array, v: Array, h: float) -> Array:
        return self.free_motion(t, q, v, h).free

    def free_motion(self, t: float, q: Array, v: Array, h: float) -> FreeMotion:
        self._t = t
        metric = self.metric(q)
        return FreeMotion(v + metric.unwhiten(metric.whiten(h * self.force(t, q, v))), metric)

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        self._t = t
        metric = self.metric(q)
        return metric.unwhiten(metric.whiten(self.force(t, q, v)))

    def chart_rate(self, q: Array, dv: Array, v: Array) -> Array:
        return v

    def kinetic_energy(self, q: Array, v: Array) -> float:
        return float(0.5 * v @ returned(self._mass(q), "mass(q)") @ v)

    def potential_energy(self, t: float, q: Array) -> float:
        if self._potential is not None:
            return float(returned(self._potential(q), "potential(q)"))
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

"""The smooth motion between events: the embedded pair of Dormand and Prince, each step in a chart of its own."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..constraints import SmoothRows
from ..problem import Problem
from ..projection import Metric
from ..system import System
from ..system.system import Array

# length of the differences that give (dJ/dt) v: both errors of order four are at rounding there [m, rad]
_DIFFERENCE = 1e-3
# singular values of the Delassus matrix below this are none
_DEPENDENT = 1e-10
_POWERS = np.arange(1, 5)


class Stride(NamedTuple):
    """One step of the smooth motion.

    Attributes
    ----------
    t, h : float
        Its start and length [s].
    q0, v0 : ndarray, shapes (nq,) and (nv,)
        State at the start.
    q, v, a : ndarray, shapes (nq,), (nv,) and (nv,)
        State and acceleration at the end.
    travel : ndarray, shape (nv,)
        Bound of what each coordinate of the chart travelled.
    error : ndarray, shape (2, nv)
        Difference of the two orders, of the chart's coordinates and of v.
    dense : ndarray, shape (2, nv, 4)
        Polynomials of both in the share of the step.
    """

    t: float
    h: float
    q0: Array
    v0: Array
    q: Array
    v: Array
    a: Array
    travel: Array
    error: Array
    dense: Array

    def at(self, system: System, share: float) -> tuple[Array, Array]:
        """Return (q, v) at a share of the step, of order four."""
        dq, dv = self.h * (self.dense @ share**_POWERS)
        return system.integrate(self.q0, dq), self.v0 + dv


def pushed(metric: Metric, J: Array, missing: Array) -> Array:
    """Return M^-1 J' p of the least p that gives every row what it is missing, of dependent rows too."""
    turned = metric.solve_rows(J)
    return np.asarray(np.linalg.lstsq(J @ turned.T, missing, rcond=_DEPENDENT)[0] @ turned)


class Flow:
    """Accelerations with closed contacts, and steps of order five.

    Parameters
    ----------
    problem : Problem
        What moves.
    rows : SmoothRows
        Its constraints.
    """

    def __init__(self, problem: Problem, rows: SmoothRows) -> None:
        # imported here for its weight
        from scipy.integrate import RK45

        self.system, self.rows = problem.system, rows
        self._a, self._b, self._c, self._e, self._p = RK45.A, RK45.B, RK45.C, RK45.E, RK45.P

    def bend(self, t: float, q: Array, v: Array, index: Array) -> Array:
        """Return (dJ/dt) v of some rows, shape (k,): how fast their rates change at constant v."""
        speed = float(np.linalg.norm(v))
        if speed == 0.0 or not index.size:
            return np.zeros(len(index))
        s = _DIFFERENCE / max(speed, _DIFFERENCE)
        rates = [self.rows.gradients(t, self.system.integrate(q, k * s * v), index) @ v for k in (-2.0, -1.0, 1.0, 2.0)]
        return (rates[0] - 8 * rates[1] + 8 * rates[2] - rates[3]) / (12 * s)

    def reactions(self, t: float, q: Array, v: Array, closed: Array) -> tuple[Array, Metric, Array, Array]:
        """Return the free acceleration, M, J and what J a of the closed rows must be to keep them closed."""
        free = self.system.acceleration(t, q, v)
        return free, self.system.metric(q), self.rows.gradients(t, q, closed), -self.bend(t, q, v, closed)

    def acceleration(self, t: float, q: Array, v: Array, closed: Array) -> Array:
        """Return dv/dt with the given rows kept closed."""
        if not closed.size:
            return self.system.acceleration(t, q, v)
        free, metric, J, wanted = self.reactions(t, q, v, closed)
        return free + pushed(metric, J, wanted - J @ free)

    def step(self, t: float, q: Array, v: Array, a: Array, h: float, closed: Array) -> Stride:
        """Take one step of length h from (t, q, v) with acceleration a."""
        K = np.empty((2, 7, len(v)))
        K[0, 0], K[1, 0] = v, a
        for i in range(1, 7):
            weights = self._a[i, :i] if i < 6 else self._b
            dq, dv = h * np.einsum("j,kjn->kn", weights, K[:, :i])
            place, speed = self.system.integrate(q, dq), v + dv
            K[0, i] = self.system.chart_rate(q, dq, speed)
            K[1, i] = self.acceleration(t + (self._c[i] if i < 6 else 1.0) * h, place, speed, closed)
        travel = 1.2 * abs(h) * np.abs(K[0]).max(axis=0)
        error = h * np.einsum("j,kjn->kn", self._e, K)
        dense = np.einsum("kjn,jp->knp", K, self._p)
        return Stride(t, h, q, v, place, speed, K[1, 6].copy(), travel, error, dense)

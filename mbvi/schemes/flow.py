"""The smooth motion between events: the embedded pair of Dormand and Prince, each step in a chart of its own."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack

from ..constraints import SmoothRows
from ..problem import Problem
from ..projection import Metric
from ..system import System
from ..system.system import Array

# singular values of the Delassus matrix below this are none
_DEPENDENT = 1e-10
# pivots of its factor, in lengths of the rows, above which these are independent beyond doubt
_INDEPENDENT = 1e-3
_POWERS = np.arange(1, 5)
# what a coordinate may travel beyond the fastest of the stages
_MARGIN = 1.2


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

    def prolonged(self, system: System, time: float) -> Stride:
        """Return the step with its end moved by a time so short that a parabola leads there."""
        q = system.integrate(self.q, time * self.v + 0.5 * time**2 * self.a)
        return self._replace(h=self.h + time, q=q, v=self.v + time * self.a)


def pushed(metric: Metric, J: Array, missing: Array) -> Array:
    """Return M^-1 J' p of the least p that gives every row what it is missing, of dependent rows too."""
    turned = metric.solve_rows(J)
    G = J @ turned.T
    factor, p, info = lapack.dposv(G, missing)
    if info or (factor.diagonal() < _INDEPENDENT * np.sqrt(G.diagonal())).any():
        p = np.linalg.lstsq(G, missing, rcond=_DEPENDENT)[0]
    return np.asarray(p @ turned)


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
        self._e, self._p = RK45.E, RK45.P
        # the last stage is the result, which is the first of the next step
        self._weights = np.zeros((7, 6))
        self._weights[:6, :5], self._weights[6] = RK45.A, RK45.B
        self._c = [*RK45.C.tolist(), 1.0]

    def reactions(self, t: float, q: Array, v: Array, closed: Array) -> tuple[Array, Metric, Array, Array]:
        """Return the free acceleration, M, J and what J a of the closed rows must be to keep them closed."""
        free = self.system.acceleration(t, q, v)
        return free, self.system.metric(q), self.rows.gradients(t, q, closed), -self.rows.bias(t, q, v, closed)

    def acceleration(self, t: float, q: Array, v: Array, closed: Array) -> Array:
        """Return dv/dt with the given rows kept closed."""
        if not closed.size:
            return self.system.acceleration(t, q, v)
        free, metric, J, wanted = self.reactions(t, q, v, closed)
        return free + pushed(metric, J, wanted - J @ free)

    def step(self, t: float, q: Array, v: Array, a: Array, h: float, closed: Array) -> Stride:
        """Take one step of length h from (t, q, v) with acceleration a."""
        nv, weights = len(v), h * self._weights
        # of each stage the rate of the chart's coordinates, then the acceleration
        K = np.empty((7, 2 * nv))
        K[0, :nv], K[0, nv:] = v, a
        for i in range(1, 7):
            moved = weights[i, :i].dot(K[:i])
            dq, speed = moved[:nv], v + moved[nv:]
            place = self.system.integrate(q, dq)
            K[i, :nv] = self.system.chart_rate(q, dq, speed)
            K[i, nv:] = self.acceleration(t + self._c[i] * h, place, speed, closed)
        travel = _MARGIN * abs(h) * np.abs(K[:, :nv]).max(axis=0)
        error, dense = (h * self._e.dot(K)).reshape(2, nv), K.T.dot(self._p).reshape(2, nv, 4)
        return Stride(t, h, q, v, place, speed, K[6, nv:], travel, error, dense)

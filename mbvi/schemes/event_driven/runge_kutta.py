"""Runge-Kutta steps of order eight for the smooth motion between events.

The unknowns of a step are coordinates of a chart: the tangent vector dq from the configuration at its start.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from scipy.linalg import lapack

from ...compiled import plain_array
from ...constraints.mechanism.held_rows import HeldRows, write_scales
from ...problem import Problem
from ...projection import Metric
from ...system import System
from ...system.mechanisms.loop_margin import with_equalities
from ...system.system import Array
from .rows.contact_rows import SmoothRows
from .stages import SmoothMotion, accelerate, margins_along, stages_of
from .turning import turning_columns
from .whole_step import take_whole_step, write_dense_output

# singular values of the Delassus matrix below this count as zero
DEPENDENT = 1e-10
# pivots of its Cholesky factor, relative to the lengths of the rows, above which rows are certainly independent
_INDEPENDENT = 1e-3
# degree of the dense output
DEGREE = 7
_POWERS = np.arange(1, DEGREE + 1)
# largest turn of a body within a step [rad]: its chart ends at a whole turn, near which rounding grows without bound
_MOST_TURN = 4.0
# accelerations below this are denormal numbers and count as zero
_DENORMAL = 1e-290
# safety factor of the travel of a coordinate, which is computed from the largest rate of all stages
MARGIN = 1.2


def slopes_at(coefficients: Array, share: float) -> Array:
    """Return the derivatives of polynomials at a share of a step, shape (k,), of coefficients of shape (k, 7)."""
    return np.asarray(coefficients @ (_POWERS * share ** (_POWERS - 1)))


class RungeKuttaStep(NamedTuple):
    """One step of the smooth motion.

    Attributes
    ----------
    t, h : float
        Its start and length [s].
    q0, v0 : ndarray, shapes (nq,) and (nv,)
        State at the start.
    q, v : ndarray, shapes (nq,) and (nv,)
        State at the end.
    a : ndarray, shape (nv,) or (2 nv,)
        `Flow.acceleration` at the end.
    travel : ndarray, shape (nv,)
        Bound of the travel of each coordinate of the chart.
    rates : ndarray, shape (16, nv + len(a))
        For each stage the rates of the chart's coordinates, then the acceleration; the last three stages belong to the
        dense output. Implicit steps have seven stages.
    error : ndarray, shape (nv + len(a),)
        Estimated errors of the chart's coordinates, of v, and, where contacts are closed, of v without contact forces.
    dense : ndarray, shape (2, nv, 7)
        Coefficients of the chart's coordinates and of v - v0, both over h, as polynomials in the share of the step; NaN
        before `Flow.with_dense_output`.
    """

    t: float
    h: float
    q0: Array
    v0: Array
    q: Array
    v: Array
    a: Array
    travel: Array
    rates: Array
    error: Array
    dense: Array

    def at(self, system: System, share: float) -> tuple[Array, Array]:
        """Return (q, v) at a share of the step, by polynomials of degree seven."""
        dq, dv = self.h * (self.dense @ share**_POWERS)
        return system.integrate(self.q0, dq), self.v0 + dv

    def acceleration(self, share: float) -> Array:
        """Return dv/dt of the dense output at a share of the step, shape (nv,)."""
        return slopes_at(self.dense[1], share)

    def cut(self, system: System, share: float) -> RungeKuttaStep:
        """Return the part of the step up to a share of it, by its dense output; the last acceleration is the step's."""
        q, v = self.at(system, share)
        return self._replace(h=share * self.h, q=q, v=v, dense=self.dense * share ** (_POWERS - 1))

    def prolonged(self, system: System, time: float) -> RungeKuttaStep:
        """Return the step with its end moved by a short time, in which the motion is a parabola."""
        a = self.a[: len(self.v)]
        q = system.integrate(self.q, time * self.v + 0.5 * time**2 * a)
        return self._replace(h=self.h + time, q=q, v=self.v + time * a)


class Modes(Protocol):
    """Modes of closed contacts with friction, as `friction.modes.ContactModes` has them."""

    def acceleration(self, t: float, q: Array, v: Array, closed: Array) -> Array:
        """Return what `Flow.acceleration` does, in the present modes."""


class ContactEquations(NamedTuple):
    """What decides on the accelerations of closed rows.

    Attributes
    ----------
    free : ndarray, shape (nv,)
        The acceleration without contact forces.
    metric : Metric
        M.
    J : ndarray, shape (k, nv)
        Gradients.
    wanted : ndarray, shape (k,)
        The values of J a that keep the rows closed.
    scale : ndarray, shape (k,)
        The size of the terms of J a - wanted.
    """

    free: Array
    metric: Metric
    J: Array
    wanted: Array
    scale: Array


def velocity_change(metric: Metric, J: Array, change: Array) -> Array:
    """Return M^-1 J' p for the least p that changes J v by `change`; rows may depend on each other."""
    inverse_mass_rows = metric.solve_rows(J)
    return np.asarray(least_percussion(J @ inverse_mass_rows.T, change) @ inverse_mass_rows)


def least_percussion(G: Array, change: Array) -> Array:
    """Return the least p with G p = change, G the Delassus matrix of rows that may depend on each other."""
    factor, p, info = lapack.dposv(G, change)
    if info or (factor.diagonal() < _INDEPENDENT * np.sqrt(G.diagonal())).any():
        p = np.linalg.lstsq(G, change, rcond=DEPENDENT)[0]
    return np.asarray(p)


def _reached(motion: SmoothMotion) -> tuple[Array, Array]:
    """Return the state of the last stage."""
    place = motion.q.copy()
    # read-only, so that results computed for this array remain valid
    place.setflags(write=False)
    return place, motion.v.copy()


class Flow:
    """Accelerations with closed contacts, and steps of order eight.

    Parameters
    ----------
    problem : Problem
        The problem with its system.
    rows : SmoothRows
        The rows of its constraints.

    Attributes
    ----------
    modes : Modes or None
        Modes of closed contacts; None where the problem has no friction.
    kernels : MechanismStages or None
        What takes the stages of one mechanism.
    has_loops : bool
        Whether the system has equalities.

    Notes
    -----
    Dormand and Prince's method of order 8 with its two error estimates and its dense output, which needs three more
    stages (Hairer, Norsett, Wanner 1993, II.5 and II.6). Each step has its own chart (Munthe-Kaas 1999).
    """

    def __init__(self, problem: Problem, rows: SmoothRows) -> None:
        # imported here because it is slow to import
        from scipy.integrate import DOP853

        self.system, self.rows = problem.system, rows
        self.kernels = stages_of(rows)
        self.modes: Modes | None = None
        self._turning, self.has_loops = turning_columns(problem.system), bool(with_equalities(problem.system))
        n = DOP853.n_stages
        # the stages, the result, which is the first stage of the next step, and those of the dense output
        self._weights = np.zeros((n + 4, n + 4))
        self._weights[:n, :n], self._weights[n, :n], self._weights[n + 1 :, : n + 3] = (
            DOP853.A, DOP853.B, DOP853.A_EXTRA[:, : n + 3],
        )  # fmt: skip
        self._nodes = [*DOP853.C.tolist(), 1.0, *DOP853.C_EXTRA.tolist()]
        self._stages, self._error_weights = n, np.array([DOP853.E5, DOP853.E3])
        self._dense_weights = np.ascontiguousarray(_dense_polynomials(DOP853.B, DOP853.D))

    def longest(self, v: Array) -> float:
        """Return the longest step from a velocity v [s]: no body turns too far in it."""
        if not len(self._turning):
            return np.inf
        rate = float(np.sqrt((np.append(v, 0.0)[self._turning] ** 2).sum(axis=1).max()))
        return _MOST_TURN / rate if rate > 0.0 else np.inf

    def contact_equations(self, t: float, q: Array, v: Array, closed: Array) -> ContactEquations:
        """Return what decides on the accelerations of closed rows."""
        found = self._accelerate(t, q, v, closed)
        if found is not None:
            motion, held = found
            scale = np.empty(len(closed))
            write_scales(held, motion.free, scale)
            free, J, wanted = motion.free.copy(), held.rows[len(v) :].copy(), held.wanted.copy()
            return ContactEquations(free, self.system.metric(q), J, wanted, scale)
        unheld = self.system.unheld_acceleration(t, q, v)
        free = self.system.held_acceleration(q, v, unheld)
        J, wanted = self.rows.gradients(t, q, closed), -self.rows.bias(t, q, v, closed)
        # where equalities hold a body nearly still, what is left of its acceleration has the rounding of all of it
        scale = np.abs(J) @ np.maximum(np.abs(free), np.abs(unheld)) + np.abs(wanted) + _DENORMAL
        return ContactEquations(free, self.system.metric(q), J, wanted, scale)

    def acceleration(self, t: float, q: Array, v: Array, closed: Array) -> Array:
        """Return dv/dt with the given rows kept closed, followed by dv/dt without contact forces if there are any rows.

        The error of both is controlled: closed contacts keep bodies in place and would hide how their forces vary.
        """
        if closed.size and self.modes is not None:
            return self.modes.acceleration(t, q, v, closed)
        found = self._accelerate(t, q, v, closed)
        if found is not None:
            motion, _ = found
            return np.concatenate([motion.kept, motion.free]) if closed.size else motion.free.copy()
        if not closed.size:
            return self.system.acceleration(t, q, v)
        free, metric, J, wanted, _ = self.contact_equations(t, q, v, closed)
        return np.concatenate([free + velocity_change(metric, J, wanted - J @ free), free])

    def step(self, t: float, q: Array, v: Array, a: Array, h: float, closed: Array) -> RungeKuttaStep:
        """Take one step of length h from (t, q, v), where `acceleration` is a."""
        nv, n = len(v), self._stages
        # `RungeKuttaStep.rates`
        K = np.empty((n + 4, nv + len(a)))
        K[0, :nv], K[0, nv:] = v, a
        found = self._constant(closed)
        if found is not None:
            motion, held = found
            fastest, error = np.empty(nv), np.empty(nv + len(a))
            take_whole_step(motion, held, self._weights, self._error_weights, h, q, v, K, fastest, error)
            travel, end = MARGIN * abs(h) * fastest, _reached(motion)
            return RungeKuttaStep(t, h, q, v, *end, K[n, nv:], travel, K, error, _NO_DENSE)
        q1, v1 = self._take(t, q, v, h, K, 1, n + 1, closed)
        travel = MARGIN * abs(h) * np.abs(K[: n + 1, :nv]).max(axis=0)
        fifth, third = np.abs(h * self._error_weights.dot(K[: n + 1]))
        both = np.sqrt(fifth**2 + 0.01 * third**2)
        # the combination of two estimates, of order five and three, is of order seven
        error = fifth * np.divide(fifth, both, out=np.zeros_like(both), where=both != 0.0)
        return RungeKuttaStep(t, h, q, v, q1, v1, K[n, nv:], travel, K, error, _NO_DENSE)

    def with_dense_output(self, step: RungeKuttaStep, closed: Array) -> RungeKuttaStep:
        """Return the step with its dense output."""
        v, K = step.v0, step.rates
        found = self._constant(closed)
        if found is not None:
            dense = np.empty((2, len(v), DEGREE))
            first = self._stages + 1
            write_dense_output(*found, self._weights, self._dense_weights, step.h, step.q0, v, K, first, dense)
            return step._replace(dense=dense)
        self._take(step.t, step.q0, v, step.h, K, self._stages + 1, len(K), closed)
        return step._replace(dense=self.polynomials(K[:, : 2 * len(v)]).reshape(2, len(v), DEGREE))

    def polynomials(self, rates: Array) -> Array:
        """Return the coefficients of what some rates of all stages, shape (16, k), add up to over h, shape (k, 7)."""
        return np.asarray(rates.T.dot(self._dense_weights))

    def _constant(self, closed: Array) -> tuple[SmoothMotion, HeldRows] | None:
        """Return the records of motion with some closed rows if no control acts and kernels know all, else None."""
        if self.kernels is None or not self.kernels.unforced or (closed.size and self.modes is not None):
            return None
        held = self.kernels.held(closed)
        return None if held is None else (self.kernels.motion, held)

    def _accelerate(self, t: float, q: Array, v: Array, closed: Array) -> tuple[SmoothMotion, HeldRows] | None:
        """Compute accelerations by a kernel; return its records, or None where it does not know all that it needs."""
        held = None if self.kernels is None else self.kernels.held(closed)
        if self.kernels is None or held is None:
            return None
        motion = self.kernels.motion
        motion.torque[:] = self.kernels.torque(t, q, v)
        accelerate(motion, held, plain_array(q), plain_array(v))
        return motion, held

    def force_margins(self, step: RungeKuttaStep, closed: Array, shares: Array, margin: float) -> Array:
        """Return the forces of closed contacts, if none may open, at n shares of a step, shape (n, k).

        They are accelerations, plus a margin relative to the terms of these.
        """
        found, out = self._constant(closed), np.empty((len(shares), len(closed)))
        if found is not None:
            margins_along(*found, step.dense, step.h, shares, step.q0, step.v0, margin, out)
            return out
        for i, share in enumerate(shares.tolist()):
            q, v = step.at(self.system, share)
            free, metric, J, wanted, scale = self.contact_equations(step.t + share * step.h, q, v, closed)
            G = J @ metric.solve_rows(J).T
            out[i] = least_percussion(G, wanted - J @ free) * G.diagonal() + margin * scale
        return out

    def _take(
        self, t: float, q: Array, v: Array, h: float, K: Array, first: int, end: int, closed: Array
    ) -> tuple[Array, Array]:
        """Write rows `first` to `end` - 1 of K, the rates of these stages; return the last one's q and v."""
        weights = h * self._weights
        for i in range(first, end):
            place, speed = self._stage(t, q, v, h, K, weights, i, closed)
        return place, speed

    def _stage(
        self, t: float, q: Array, v: Array, h: float, K: Array, weights: Array, i: int, closed: Array
    ) -> tuple[Array, Array]:
        """Write row i of K, the rates of stage i; return its configuration and velocity."""
        nv = len(v)
        change = weights[i, :i].dot(K[:i])
        dq, speed = change[:nv], v + change[nv : 2 * nv]
        place = self.system.integrate(q, dq)
        if self.has_loops:
            # beside a dead centre what is not tangent would change accelerations by itself over the distance
            speed = self.system.tangent(place, speed)
        K[i, :nv] = self.system.chart_rate(q, dq, speed)
        K[i, nv:] = self.acceleration(t + self._nodes[i] * h, place, speed, closed)
        return place, speed


# the dense output of a step before it is computed
_NO_DENSE = np.full((2, 1, DEGREE), np.nan)


def _dense_polynomials(b: Array, d: Array) -> Array:
    """Return the matrix from the rates of the stages to coefficients of x, x^2, ..., x^7, shape (16, 7)."""
    n = len(b)
    whole, first, last = np.zeros((3, n + 4))
    whole[:n], first[0], last[n] = b, 1.0, 1.0
    parts = np.array([whole, first - whole, 2.0 * whole - first - last, *d])
    basis, term = np.zeros((DEGREE, DEGREE)), np.polynomial.Polynomial([0.0, 1.0])
    for k in range(DEGREE):
        # x, x (1 - x), x^2 (1 - x), ...
        basis[k, : k + 1] = term.coef[1:]
        term = term * np.polynomial.Polynomial([1.0, -1.0] if k % 2 == 0 else [0.0, 1.0])
    return parts.T @ basis

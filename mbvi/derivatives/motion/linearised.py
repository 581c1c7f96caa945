"""The linearised smooth motion dX/dt = A X, and the linearised law of an impact, in the tangent space."""

from __future__ import annotations

import numpy as np

from ...problem import Problem
from ...schemes.event_driven.friction.modes import ContactModes
from ...schemes.event_driven.motion_state import SLOW
from ...schemes.event_driven.rows.contact_rows import SmoothRows
from ...schemes.event_driven.runge_kutta import Flow, RungeKuttaStep, least_percussion
from ...system.mechanisms.articulated import ArticulatedSystem
from ...system.mechanisms.loop_margin import with_equalities
from ...system.parts import velocity_units
from ...system.system import Array, System, located_parts
from ..parameters.parameters import Parameters
from .accelerations import Accelerations
from .differences import STEP, along, along_both
from .friction import ChosenModes, FrictionDerivatives
from .linear_law import LinearLaw
from .point_rows import PointRows

# singular values of a Delassus matrix below this part of the largest count as zero
_DEPENDENT = 1e-10


class Linearised:
    """Derivatives along a motion.

    Variations of q are tangent vectors at q: the varied configuration is `system.integrate(q, dq)`.

    Parameters
    ----------
    problem : Problem
        A problem of its own, whose caches no run uses.
    parameters : Parameters
        The parameters by which it is differentiated, m in all.

    Attributes
    ----------
    units : ndarray, shape (2 nv,)
        The unit of each variation: lengths of the scene and radians, for velocities per second.
    friction : FrictionDerivatives or None
        Derivatives with friction; None where the problem has none.
    """

    def __init__(self, problem: Problem, parameters: Parameters) -> None:
        self.parameters = parameters
        self.system = problem.system
        self.rows = SmoothRows(problem.constraints, problem.t0, problem.q0, problem.length)
        self.flow = Flow(problem, self.rows)
        units = velocity_units(self.system, problem.length)
        self.units = np.tile(units, 2)
        self._steps = STEP * units
        self._free, self._points = Accelerations(self.system, self._steps), PointRows(self.system)
        self._turning = _turning(self.system, problem.q0)
        self.friction: FrictionDerivatives | None = None
        if problem.constraints.frictional:
            modes = ContactModes(self.flow, self.rows, SLOW * problem.length)
            frictions = parameters.frictions(len(problem.constraints))
            self.friction = FrictionDerivatives(self, modes, self._steps, frictions, problem.constraints.name)
            self.flow.modes = modes
        n = self.system.nv
        # dq/dt = v, and the rest of A
        self._empty = np.zeros((2 * n, 2 * n + parameters.count))
        self._empty[:n, n : 2 * n] = np.eye(n)
        self._keeps = bool(with_equalities(self.system))

    def kinks(self, step: RungeKuttaStep) -> list[float]:
        """Return the shares of a step, ascending, at which A jumps."""
        return self._free.kinks(step)

    def _keeping(self, q: Array, v: Array) -> Array:
        """Return the projection of variations onto those that keep the equalities, shape (2 nv, 2 nv)."""
        n = len(v)
        P = np.eye(2 * n)
        if self._keeps:
            P[:n, :n] = np.stack([self.system.tangent(q, one) for one in np.eye(n)], axis=1)
            by_q = along(lambda dq: self.system.tangent(self.system.integrate(q, dq), v), self._steps)
            P[n:, :n], P[n:, n:] = by_q @ P[:n, :n], P[:n, :n]
        return P

    def choose(self, modes: ChosenModes | None) -> None:
        """Set the modes of closed contacts with friction."""
        if self.friction is not None and modes is not None:
            self.friction.modes.choose(*modes)

    def matrix(self, t: float, q: Array, v: Array, closed: Array) -> Array:
        """Return A with the given rows kept closed, by the state and the parameters, shape (2 nv, 2 nv + m)."""
        n = len(v)
        A = self._empty.copy()
        for own, constants in self._turning:
            A[own, own] = constants @ v[own]
        if closed.size and self.friction is not None:
            A[n:] = self.friction.accelerations(t, q, v, closed)
        elif closed.size:
            A[n:] = self._held(t, q, v, closed)
        else:
            a = self.system.acceleration(t, q, v) if self.parameters.count else np.zeros(n)
            A[n:] = self.at_constant_force(t, q, v, a, np.zeros(n))
        return A

    def at_constant_force(self, t: float, q: Array, v: Array, a: Array, force: Array) -> Array:
        """Return the derivative of the acceleration a under a constant generalised force, (nv, 2 nv + m)."""
        out = self._free.jacobian(t, q, v, force)
        return np.hstack([out, self.parameters.accelerations(t, q, v, a)]) if self.parameters.count else out

    def momenta(self, q: Array, w: Array) -> Array:
        """Return the derivative of M w by q at a constant w, shape (nv, nv)."""
        return self._free.momenta(q, w)

    def _held(self, t: float, q: Array, v: Array, closed: Array) -> Array:
        """Return the derivative of accelerations with closed contacts by (q, v) and parameters, (nv, 2 nv + m)."""
        n = len(v)
        free, metric, J, wanted, _ = self.flow.contact_equations(t, q, v, closed)
        W = metric.solve_rows(J)
        G = J @ W.T
        forces = least_percussion(G, wanted - J @ free)
        a = free + forces @ W
        # derivatives at constant contact forces, then of the forces, which keep J a + (dJ/dt) v zero
        out = self.at_constant_force(t, q, v, a, forces @ J)
        gradients, bias_by_q = self.rows_by_q(t, q, v, closed)
        pushed = np.einsum("ijk,i->kj", gradients, forces)
        out[:, :n] += self.system.metric(q).solve_rows(pushed).T
        opening = J @ out
        opening[:, :n] += np.einsum("ijk,j->ik", gradients, a) + bias_by_q
        # (dJ/dt) v is the derivative of the gradients along v, times v
        opening[:, n : 2 * n] += gradients @ v + np.einsum("ijk,j->ik", gradients, v)
        return np.asarray(out - W.T @ np.linalg.lstsq(G, opening, rcond=_DEPENDENT)[0])

    def rows_by_q(self, t: float, q: Array, v: Array, index: Array) -> tuple[Array, Array]:
        """Return the derivatives by q of the gradients of some rows, shape (k, nv, nv), and of their bias, (k, nv)."""
        table = self.rows.body_points(index)
        known = self._points.known(table)
        if known.all():
            return self._points.by_q(q, v, table)
        n, k = len(v), len(index)
        gradients, biases = np.empty((k, n, n)), np.empty((k, n))
        gradients[known], biases[known] = self._points.by_q(q, v, table[known])
        others = index[~known]

        def both(dq: Array) -> Array:
            there = self.system.integrate(q, dq)
            return np.column_stack([self.rows.gradients(t, there, others), self.rows.bias(t, there, v, others)])

        # reach is zero for velocities that do not move a body of the row
        moved = (self.rows.reach[others] != 0.0).any(axis=0)
        found = along(both, np.where(moved, self._steps, 0.0))
        gradients[~known], biases[~known] = found[:, :-1], found[:, -1]
        return gradients, biases

    def law(self, t: float, q: Array, v: Array, rows: Array, hit: Array, e: Array) -> LinearLaw:
        """Return the law (8) on rows that all bear a percussion, with its derivatives.

        Parameters
        ----------
        t, q, v
            Time [s] and state before.
        rows : ndarray of int, shape (k,)
            The rows.
        hit : ndarray of bool, shape (k,)
            Whether each closes; the rates of the others become zero.
        e : ndarray, shape (k,)
            Their restitution.
        """
        if self._keeps:
            return self._held_law(t, q, v, rows, hit, e)
        factor = np.where(hit, 1.0 + e, 1.0)
        J, metric = self.rows.gradients(t, q, rows), self.system.metric(q)
        W = metric.solve_rows(J)
        inverse = np.linalg.pinv(J @ W.T, rcond=_DEPENDENT, hermitian=True)
        share, rates, onto = W.T @ inverse, J @ v, np.eye(len(v))
        percussion = -inverse @ (factor * rates)
        jump = percussion @ W
        # M w = J' p and J w = -factor J v vary together
        gradients, _ = self.rows_by_q(t, q, v, rows)
        missing = np.einsum("ijk,i->jk", gradients, percussion) - self._free.momenta(q, jump)
        loose = self.system.metric(q).solve_rows(np.ascontiguousarray(missing.T)).T
        target = np.einsum("ijk,ij->ik", gradients, -jump - factor[:, None] * v)
        by_q = loose + share @ (target - J @ loose)
        # gradients and the rates after the impact do not depend on parameters
        by_p = (onto - share @ J) @ self.parameters.jumps(q, jump)
        return LinearLaw(v + jump, by_q, onto - share @ (factor[:, None] * J), -share * (hit * rates), by_p)

    def _held_law(self, t: float, q: Array, v: Array, rows: Array, hit: Array, e: Array) -> LinearLaw:
        """Return `law` of a system with equalities, along variations that keep them, by differences."""
        factor = np.where(hit, 1.0 + e, 1.0)

        def after(q: Array, v: Array) -> Array:
            J = self.rows.gradients(t, q, rows)
            return v - self._response(q, J) @ (factor * (J @ v))

        J = self.rows.gradients(t, q, rows)
        inverse = self._response(q, J)
        both, jump = along_both(after, self.system, q, v, self._steps), after(q, v) - v
        by_p = (np.eye(len(v)) - inverse @ J) @ self.parameters.jumps(q, jump)
        by_q, by_v = np.hsplit(both, 2)
        return LinearLaw(v + jump, by_q, by_v, -inverse * (hit * (J @ v)), by_p)

    def _response(self, q: Array, J: Array) -> Array:
        """Return the least velocities, shape (nv, k), that change the rate of one row each by one; see `law`."""
        W = self.system.metric(q).solve_rows(J)
        return np.asarray(W.T @ np.linalg.pinv(J @ W.T, rcond=_DEPENDENT, hermitian=True))

    def tangents(
        self, t: float, q: Array, v: Array, closed: Array, gaps: Array, starts: bool = True
    ) -> tuple[Array, Array]:
        """Return the variations that keep some rows closed and at rest, and contacts that stick sticking.

        Parameters
        ----------
        t, q, v
            Time [s] and state.
        closed : ndarray of int, shape (k,)
            The rows.
        gaps : ndarray, shape (k, p)
            Variations of their gaps by something else than q.
        starts : bool
            Whether contacts without slip are kept from sliding, even if they slide in what follows.

        Returns
        -------
        ndarray, shape (2 nv, 2 nv)
            The projection onto those where no gap varies.
        ndarray, shape (2 nv, p)
            The least ones that make up for the variations of the gaps.
        """
        n, kept = len(v), self._keeping(q, v)
        if not closed.size:
            return kept, np.zeros((2 * n, gaps.shape[1]))
        J = self.rows.gradients(t, q, closed)
        share = self._response(q, J)
        onto, moved = np.eye(n) - share @ J, -share @ gaps
        gradients, _ = self.rows_by_q(t, q, v, closed)
        if self.friction is not None:
            # velocities along tangents vanish too, places do not
            J, gradients = self.friction.with_sticking(t, q, v, closed, J, gradients, starts)
            share = self._response(q, J)
        P = np.zeros((2 * n, 2 * n))
        P[:n, :n], P[n:, n:] = onto, np.eye(n) - share @ J
        turned = -share @ np.einsum("ijk,j->ik", gradients, v)
        P[n:, :n] = turned
        P = P @ _first(onto, kept)
        return P, np.vstack([moved, turned @ moved])


def _first(onto: Array, kept: Array) -> Array:
    """Return what projects variations of places, then keeps equalities."""
    n = len(onto)
    first = np.eye(2 * n)
    first[:n, :n] = onto @ kept[:n, :n]
    after = kept.copy()
    after[:n, :n] = np.eye(n)
    return after @ first


def _turning(system: System, q: Array) -> list[tuple[slice, Array]]:
    """Return the velocities whose tangent vectors turn with the motion, and the tensors C of that.

    Along a motion a variation dq of q changes at the rate dv + C v dq. It is minus the commutator of v and dq, which is
    the part of a chart's rate that is odd in the chart's coordinate: differences over any length give it exactly.
    """
    found = []
    for part in located_parts(system):
        own, here = part.system, q[part.q : part.q + part.system.nq]
        for first, width in _groups(own):
            constants = np.zeros((width, width, width))
            for k in range(width):
                for j in range(width):
                    x, v = np.zeros(own.nv), np.zeros(own.nv)
                    x[first + k], v[first + j] = 1.0, 1.0
                    change = own.chart_rate(here, x, v) - own.chart_rate(here, -x, v)
                    constants[:, k, j] = change[first : first + width]
            if constants.any():
                start = part.v + first
                found.append((slice(start, start + width), constants))
    return found


def _groups(system: System) -> list[tuple[int, int]]:
    """Return the first velocity and the number of those that turn together: of a joint, of a body, or all."""
    if isinstance(system, ArticulatedSystem):
        return [(joint.idx_v, joint.nv) for joint in list(system.model.joints)[1:] if joint.nv > 1]
    width = system.nv // system.independent_bodies
    return [(first, width) for first in range(0, system.nv, width)]

"""Carries variations along a run of `EventDriven`: over its smooth steps, impacts and releases."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import deepcopy
from itertools import pairwise
from typing import NoReturn

import numpy as np

from ..errors import SensitivityError
from ..problem import Problem
from ..schemes.event_driven.impact_event import ImpactEvent
from ..schemes.event_driven.integrator import EventDrivenIntegrator
from ..schemes.event_driven.motion_state import NO_ROWS
from ..schemes.event_driven.runge_kutta import RungeKuttaStep
from ..system.system import Array
from .directions import Directions
from .fixed_steps import LocatedSteps
from .impacts import LocatedImpact, Saltation
from .motion.linearised import Linearised
from .near_misses import NearMisses

# what a run is followed by
Followed = EventDrivenIntegrator | LocatedSteps

# largest error of one step of the variations, relative to the tolerance and to the largest entry of a column; the least
# one that the rounding of differences allows; and the most parts into which a step is divided for it
_LOCAL, _ROUNDING, _MOST_PARTS = 0.3, 1e-10, 64
# nodes at which the matrices of a step, or of a part of one, are computed
_NODES = 5
# entries that count as small of what one size of a parameter changes
LEAST = 1e-3
# jump of accelerations that rounding explains, relative to the largest one
_JUMP = 1e-6


class Variation:
    """Variations X of the state, shape (2 nv, p), along a run.

    Parameters
    ----------
    problem : Problem
        The problem that runs.
    tolerance : float
        That of the scheme.
    varied : Directions
        The columns of the variations.

    Attributes
    ----------
    matrices : list of ndarray, shape (2 nv, p)
        The variations at each recorded state of the run.
    closed_at_start : ndarray of int
        Rows that are closed at the start.
    approximate : bool
        Whether the motion is known to a step of fixed length only: variations then take one step of order two for each,
        and accelerations may jump at a release.

    Notes
    -----
    dX/dt = A X + B P along the dense output of the run, with the rates B P by the parameters, by the tableau of order
    eight that made its steps. A and B P are polynomials through Gauss's nodes, which is of order ten; what their
    leading terms change estimates its error. A step whose error is too large for X is divided.
    """

    def __init__(self, problem: Problem, tolerance: float, varied: Directions) -> None:
        # imported here because it is slow to import
        from scipy.integrate import DOP853

        self._A, self._b, self._c = DOP853.A[:12, :12], DOP853.B, DOP853.C[:12]
        self._nodes, self._interpolation = _interpolation(self._c)
        self._errors = np.array([DOP853.E5[:12], DOP853.E3[:12]])
        self._linear = Linearised(deepcopy(problem), varied.parameters)
        self._tolerance, self._varied = max(_LOCAL * tolerance, _ROUNDING), varied
        self._least = np.where(varied.of_parameters, LEAST, 1e-300)
        self._saltation = Saltation(self._linear, varied, problem.length, float(np.sqrt(tolerance)), self._refuse)
        self.approximate = False
        self._misses = NearMisses(self._linear, self._saltation, self._refuse)
        self._name = problem.constraints.name
        self._varies_start = bool(varied.start.any() or varied.by_gap.any())
        self.matrices, self._X = [varied.start], varied.start
        self._closed = self._held = self.closed_at_start = NO_ROWS
        # gaps up to this are at an event [m]
        self._touching = 0.0
        # the largest acceleration so far, with and without contact forces
        self._fastest = 0.0
        # the state at the end of the last step, and the impact after it whose contacts are not known yet
        self._end: tuple[float, Array, Array] | None = None
        self._pending: tuple[ImpactEvent, Array] | None = None

    def __call__(self, part: RungeKuttaStep | ImpactEvent, integrator: Followed) -> None:
        """Follow a smooth step or an impact of the run."""
        if integrator.fallbacks:
            self._refuse("contacts whose gradients jump take steps of Paoli here", integrator.event_rows, integrator.t)
        involved, rows = np.union1d(integrator.closed, integrator.event_rows), integrator.rows
        pairs = rows.pair[involved[involved >= len(rows.all)]]
        if pairs.size:
            self._refuse("polyhedra touch each other", pairs, integrator.t)
        if isinstance(part, ImpactEvent):
            self._begin_impact(part, integrator)
            return
        self._begin_step(part.t, part.q0, part.v0, integrator)
        self._step(part)
        self._touching = 10.0 * integrator.touching
        self._misses.step(part, self._closed, self._held, self._touching)
        self._end = part.t + part.h, integrator.q, integrator.v
        self.matrices.append(self._X)

    def finish(self) -> None:
        """Refuse an impact at the end of the run, where the velocity is that before or after it."""
        assert self._end is not None
        t, q, v = self._end
        rows = self._linear.rows
        near = np.flatnonzero(rows.lower_bounds(t, q, rows.all) * rows.lever <= self._touching)
        near = near[rows.gaps(t, q, near) * rows.lever[near] <= self._touching]
        near = np.setdiff1d(near, np.union1d(self._closed, self._held))
        closing = near[rows.gradients(t, q, near) @ v < 0.0]
        if self._pending is not None or closing.size:
            closing = closing if self._pending is None else self._pending[1]
            self._refuse("the run ends at an impact: let it end before or after", closing, t)

    def _refuse(self, reason: str, rows: Array, t: float) -> NoReturn:
        numbers = np.unique(self._linear.rows.number[rows]).tolist()
        raise SensitivityError(reason, t, tuple(map(self._name, numbers)))

    def _begin_impact(self, event: ImpactEvent, integrator: Followed) -> None:
        rows = integrator.rows
        jumping = np.flatnonzero(~rows.smooth & np.isin(rows.number, event.number))
        if jumping.size:
            self._refuse("the gradients of polyhedra jump there", jumping, event.t)
        if self._pending is not None:
            self._refuse("two impacts at one instant", integrator.event_rows, event.t)
        if self._end is None and self._varies_start:
            reason = "the run starts with an impact: by the state and walls it has a derivative on one side only"
            self._refuse(reason, integrator.event_rows, event.t)
        self._pending = event, integrator.event_rows
        # the matrix after it is known once the contacts are that stay closed
        self.matrices.append(self._X)

    def _begin_step(self, t: float, q: Array, v: Array, integrator: Followed) -> None:
        """Carry the variations over what happened since the last step, of which a new one starts."""
        closed, held = integrator.closed, integrator.held
        if self._pending is not None:
            event, rows = self._pending
            self._pending = None
            impact = LocatedImpact(
                t, q, event.before, v, rows, event.rates[0], self._closed, self._held, closed
            )  # fmt: skip
            self._X = self._saltation.carried(impact, self._X)
            self.matrices[-1] = self._X
        elif self._end is None:
            self._start(t, q, v, integrator)
        elif not np.array_equal(closed, self._closed):
            self._change(q, v, closed)
        self._closed, self._held = closed, held

    def _start(self, t: float, q: Array, v: Array, integrator: Followed) -> None:
        """Restrict the variations to those that keep closed what is closed at the start."""
        touching = np.setdiff1d(integrator.event_rows, integrator.closed)
        J = self._linear.rows.gradients(t, q, touching)
        slow = np.abs(J @ v) < self._saltation.slowest(touching, J, v)
        by_p = self._varied.by_p.any()
        if slow.any() and (self._varies_start or by_p):
            self._refuse("it touches at the start and is about to open", touching[slow], t)
        self.closed_at_start = integrator.closed
        closed = integrator.closed
        if by_p and closed.size:
            self._saltation.check_forces(t, q, v, closed, closed, "parameters")
        gaps = self._varied.by_gap[self._linear.rows.number[closed]]
        onto, moved = self._linear.tangents(t, q, v, closed, gaps)
        off = self._linear.rows.gradients(t, q, closed) @ moved[: len(v)] + gaps
        if np.abs(off).max(initial=0.0) > _JUMP * np.abs(gaps).max(initial=0.0):
            self._refuse("moved walls leave no room for what rests between them", closed, t)
        self._X = self.matrices[0] = onto @ self._X + moved

    def _change(self, q: Array, v: Array, closed: Array) -> None:
        """Refuse a change of closed contacts at which accelerations jump: at a release they do not."""
        assert self._end is not None
        t, n = self._end[0], len(v)
        new = np.setdiff1d(closed, np.union1d(self._closed, self._held))
        if new.size:
            self._refuse("it comes to rest without an impact", new, t)
        if self.approximate:
            return
        before, after = (self._linear.flow.acceleration(t, q, v, rows)[:n] for rows in (self._closed, closed))
        if np.abs((after - before) / self._linear.units[:n]).max() > _JUMP * self._fastest:
            self._refuse("contact forces jump at a release", np.setxor1d(closed, self._closed), t)

    def _step(self, step: RungeKuttaStep) -> None:
        """Carry the variations over a smooth step, in as many parts as their error needs."""
        accelerations = step.rates[:, len(step.v) :].reshape(len(step.rates), -1, len(step.v))
        self._fastest = max(self._fastest, float(np.abs(accelerations / self._linear.units[: len(step.v)]).max()))
        if step.h > 0.0:
            self._smooth(step)

    def _smooth(self, step: RungeKuttaStep) -> None:
        """Carry the variations over a step."""
        units, by_p = self._linear.units[:, None], self._varied.by_p
        # in units of the scene, so that no unit of length matters
        scaling = units.T / units

        def matrices(shares: Array) -> Array:
            A = self.rates(step, shares, self._closed)
            n = len(units)
            return np.concatenate([scaling * A[..., :n], (A[..., n:] @ by_p) / units], axis=-1)

        def applied(matrices: Array, X: Array) -> Array:
            return matrices[..., : len(units)] @ X + matrices[..., len(units) :]

        ends = [0.0, *self.kinks(step), 1.0]
        self._X = units * self.integrated(step, ends, matrices, applied, self._X / units, self._least)

    def kinks(self, step: RungeKuttaStep) -> list[float]:
        """Return the shares of a step, ascending, at which `rates` jump."""
        # a step of order two does not feel them
        return [] if self.approximate else self._linear.kinks(step)

    def rates(self, step: RungeKuttaStep, shares: Array, closed: Array) -> Array:
        """Return `Linearised.matrix` at some shares of a step, one after the other."""
        system, linear = self._linear.system, self._linear
        return np.array([
            linear.matrix(step.t + share * step.h, *step.at(system, share), closed) for share in shares.tolist()
        ])  # fmt: skip

    def integrated(
        self,
        step: RungeKuttaStep,
        ends: Sequence[float],
        matrices: Callable[[Array], Array],
        applied: Callable[[Array, Array], Array],
        X: Array,
        least: Array | float,
    ) -> Array:
        """Return X after some stretches of a step, each taken in as many equal parts as its error needs.

        Parameters
        ----------
        step : RungeKuttaStep
            The step.
        ends : sequence of float
            The shares of it at which stretches begin and end, ascending; matrices are smooth within each.
        matrices : callable
            matrices(shares) -> array, shape (k, a, b): what depends on the time.
        applied : callable
            applied(matrix, X) -> dX/dt, for matrices and X with any leading axes.
        X : ndarray, shape (n, p)
            X at its start.
        least : ndarray, shape (p,), or float
            Entries of each column up to this are small.
        """
        for first, last in pairwise(ends):
            length = last - first
            if self.approximate:
                h, middle = length * step.h, matrices(np.array([first + 0.5 * length]))[0]
                X = X + h * applied(middle, X + 0.5 * h * applied(middle, X))
                continue
            parts, found = 1, None
            while found is None and parts <= _MOST_PARTS:
                shares = first + length * (np.arange(parts)[:, None] + self._nodes) / parts
                found = self._parts(length * step.h / parts, shares, matrices, applied, X, least)
                parts *= 2
            if found is None:
                self._refuse("the variations change too fast to be integrated", NO_ROWS, step.t)
            X = found
        return X

    def _parts(
        self,
        h: float,
        shares: Array,
        matrices: Callable[[Array], Array],
        applied: Callable[[Array, Array], Array],
        X: Array,
        least: Array | float,
    ) -> Array | None:
        """Return X after some parts of length h, of whose nodes `shares` are given; None if the error is too large."""
        # twice the same: with the matrices, and with those without the leading terms of their polynomials
        K = np.empty((len(self._c), 2, *X.shape))
        # the same numbers, one stage a row
        flat = K.reshape(len(K), -1)
        for nodes in shares:
            at_nodes = matrices(nodes)
            M = (self._interpolation @ at_nodes.reshape(_NODES, -1)).reshape(2, -1, *at_nodes.shape[1:])
            both = np.stack([X, X])
            for i in range(len(self._c)):
                K[i] = applied(M[:, i], both + h * (self._A[i, :i] @ flat[:i]).reshape(both.shape) if i else both)
            fifth, third = np.abs(h * (self._errors @ flat)).reshape(2, *both.shape)[:, 0].max(axis=1)
            X, rough = both + h * (self._b @ flat).reshape(both.shape)
            scale = np.sqrt(fifth**2 + 0.01 * third**2)
            error = fifth * np.divide(fifth, scale, out=np.zeros_like(scale), where=scale != 0.0)
            error = np.maximum(error, np.abs(X - rough).max(axis=0))
            # written so that a NaN is refused too
            if not (error <= self._tolerance * np.maximum(np.abs(X).max(axis=0), least)).all():
                return None
        return X


def _interpolation(shares: Array) -> tuple[Array, Array]:
    """Return Gauss's nodes in (0, 1), and what makes values at some shares of those at the nodes.

    The second, shape (2, k, nodes), has the polynomial through the nodes, then the one without its leading term, which
    is the nearest of its degree.
    """
    from numpy.polynomial import legendre

    nodes, weights = legendre.leggauss(_NODES)
    terms = (np.arange(_NODES) + 0.5)[:, None] * legendre.legvander(nodes, _NODES - 1).T * weights
    there = legendre.legvander(2.0 * shares - 1.0, _NODES - 1)
    return 0.5 * (nodes + 1.0), np.stack([there @ terms, there[:, :-1] @ terms[:-1]])

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
from .impacts import Saltation
from .located_impact import ImpactFriction, LocatedImpact
from .motion.friction import ChosenModes
from .motion.linear_steps import LinearMethod, LinearSteps
from .motion.linearised import Linearised
from .near_misses import NearMisses
from .slip_changes import SlipChanges

# what a run is followed by
Followed = EventDrivenIntegrator | LocatedSteps

# largest error of one step of the variations, relative to the tolerance and to the largest entry of a column; and the
# least one that the rounding of differences allows
_LOCAL, _ROUNDING = 0.3, 1e-10
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
    problem, varied
        As given.
    matrices : list of ndarray, shape (2 nv, p)
        The variations at each recorded state of the run.
    closed_at_start : ndarray of int
        Rows that are closed at the start.
    still_at_start : ndarray of bool, or None
        Which of them have no slip; None without friction.
    approximate : bool
        Whether the motion is known to a step of fixed length only: variations then take one step of order two for each,
        and accelerations may jump at a release.
    """

    def __init__(self, problem: Problem, tolerance: float, varied: Directions) -> None:
        self._linear = Linearised(deepcopy(problem), varied.parameters)
        self._method = LinearMethod(max(_LOCAL * tolerance, _ROUNDING))
        self.problem, self.varied = problem, varied
        self._least = np.where(varied.of_parameters, LEAST, 1e-300)
        self._saltation = Saltation(self._linear, varied, problem.length, float(np.sqrt(tolerance)), self._refuse)
        self.approximate = False
        self._misses = NearMisses(self._linear, self._saltation, tolerance * problem.length, self._refuse)
        self._name = problem.constraints.name
        self._varies_start = bool(varied.start.any() or varied.by_gap.any())
        self.matrices, self._X = [varied.start], varied.start
        self._closed = self._held = self.closed_at_start = NO_ROWS
        self.still_at_start: Array | None = None
        self._modes: ChosenModes | None = None
        self._slips = SlipChanges(self._linear, varied, self._refuse)
        self._last_impact = -np.inf, NO_ROWS
        # gaps up to this are at an event [m]
        self._touching = 0.0
        # the largest acceleration so far, with and without contact forces
        self._fastest = 0.0
        # the state at the end of the last step, and the impact after it whose contacts are not known yet
        self._end: tuple[float, Array, Array] | None = None
        self._pending: tuple[ImpactEvent, Array] | None = None

    @property
    def known(self) -> list[Array]:
        """The matrices but that after an impact that is not followed yet."""
        return self.matrices if self._pending is None else self.matrices[:-1]

    def __call__(self, part: RungeKuttaStep | ImpactEvent, integrator: Followed) -> None:
        """Follow a smooth step or an impact of the run."""
        if integrator.fallbacks:
            reason = "steps of Paoli are taken here: gradients of contacts jump, or friction leaves accelerations open"
            self._refuse(reason, integrator.event_rows, integrator.t)
        involved, rows = np.union1d(integrator.closed, integrator.event_rows), integrator.rows
        pairs = rows.pair[involved[involved >= len(rows.all)]]
        if pairs.size:
            self._refuse("polyhedra touch each other", pairs, integrator.t)
        if isinstance(part, ImpactEvent):
            self._begin_impact(part, integrator)
            return
        self._begin_step(part.t, part.q0, part.v0, integrator)
        self._step(part)
        self._slips.stopped = -1 if integrator.modes is None else integrator.modes.stopped
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
            self._refuse("the gradients of these shapes jump there", jumping, event.t)
        # only rounding tells a gap that closes here from one that closed with those of the last impact
        struck = integrator.event_rows
        others = ~np.isin(struck, self._last_impact[1])
        speed = float(np.abs(event.rates[1] * rows.lever[struck])[others].max(initial=0.0))
        since = event.t - self._last_impact[0]
        if self._pending is not None or (others.any() and since * speed <= self._touching):
            self._refuse("two impacts at one instant", struck, event.t)
        self._last_impact = event.t, struck
        if self._end is None and self._varies_start:
            reason = "the run starts with an impact: by the state and walls it has a derivative on one side only"
            self._refuse(reason, integrator.event_rows, event.t)
        self._pending = event, integrator.event_rows
        # the matrix after it is known once the contacts are that stay closed
        self.matrices.append(self._X)

    def _begin_step(self, t: float, q: Array, v: Array, integrator: Followed) -> None:
        """Carry the variations over what happened since the last step, of which a new one starts."""
        closed, held, modes = integrator.closed, integrator.held, _modes_of(integrator)
        if self._pending is not None:
            event, rows = self._pending
            impact = LocatedImpact(
                t, q, event.before, v, rows, event.rates[0], self._closed, self._held, closed,
                _friction_of(event, self._modes, modes),
            )  # fmt: skip
            X = self._saltation.carried(impact, self._X)
            if not self.approximate:
                self._linear.choose(self._modes)
                self._misses.impact(impact)
            self._X = X
            self.matrices[-1], self._pending = self._X, None
        elif self._end is None:
            self._linear.choose(modes)
            self._start(t, q, v, integrator)
        elif not np.array_equal(closed, self._closed) or _differ(modes, self._modes):
            self._change(q, v, closed, modes)
        self._closed, self._held, self._modes = closed, held, modes
        self._linear.choose(modes)

    def _start(self, t: float, q: Array, v: Array, integrator: Followed) -> None:
        """Restrict the variations to those that keep closed what is closed at the start."""
        touching = np.setdiff1d(integrator.event_rows, integrator.closed)
        J = self._linear.rows.gradients(t, q, touching)
        slow = np.abs(J @ v) < self._saltation.slowest(touching, J, v)
        by_p = self.varied.by_p.any()
        if slow.any() and (self._varies_start or by_p):
            self._refuse("it touches at the start and is about to open", touching[slow], t)
        self.closed_at_start = integrator.closed
        if self._linear.friction is not None:
            self.still_at_start = self._linear.friction.still(t, q, v, integrator.closed)
        closed = integrator.closed
        if by_p and closed.size:
            self._saltation.check_forces(t, q, v, closed, closed, "parameters")
        gaps = self.varied.by_gap[self._linear.rows.number[closed]]
        onto, moved = self._linear.tangents(t, q, v, closed, gaps)
        off = self._linear.rows.gradients(t, q, closed) @ moved[: len(v)] + gaps
        if np.abs(off).max(initial=0.0) > _JUMP * np.abs(gaps).max(initial=0.0):
            self._refuse("moved walls leave no room for what rests between them", closed, t)
        self._X = self.matrices[0] = onto @ self._X + moved

    def _change(self, q: Array, v: Array, closed: Array, modes: ChosenModes | None) -> None:
        """Carry the variations over a change of contacts without an impact.

        At a release accelerations do not jump, nor where a contact begins to slip; where a slip stops they do.
        """
        assert self._end is not None
        t, n = self._end[0], len(v)
        new = np.setdiff1d(closed, np.union1d(self._closed, self._held))
        if new.size:
            self._refuse("it comes to rest without an impact", new, t)
        if self.approximate:
            return
        accelerations = []
        for rows, chosen in ((self._closed, self._modes), (closed, modes)):
            self._linear.choose(chosen)
            accelerations.append(self._linear.flow.acceleration(t, q, v, rows)[:n])
        before, after = accelerations
        if np.abs((after - before) / self._linear.units[:n]).max() <= _JUMP * self._fastest:
            return
        if self._modes is None or modes is None or self._slips.stopped < 0:
            self._refuse("contact forces jump at a release", np.setxor1d(closed, self._closed), t)
        self._X = self._slips.carried((t, q, v), after, (self._closed, self._modes), (closed, modes), self._X)

    def _step(self, step: RungeKuttaStep) -> None:
        """Carry the variations over a smooth step, in as many parts as their error needs."""
        accelerations = step.rates[:, len(step.v) :].reshape(len(step.rates), -1, len(step.v))
        self._fastest = max(self._fastest, float(np.abs(accelerations / self._linear.units[: len(step.v)]).max()))
        if step.h > 0.0:
            self._smooth(step)

    def _smooth(self, step: RungeKuttaStep) -> None:
        """Carry the variations over a step."""
        units, by_p = self._linear.units[:, None], self.varied.by_p
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
        if self.approximate:
            return []
        kinks, friction = self._linear.kinks(step), self._linear.friction
        return kinks if friction is None else sorted({*kinks, *friction.turning(step)})

    def rates(self, step: RungeKuttaStep, shares: Array, closed: Array) -> Array:
        """Return `Linearised.matrix` at some shares of a step, one after the other."""
        system, linear = self._linear.system, self._linear
        if linear.friction is not None and closed.size:
            middle = float(shares.mean())
            linear.friction.hold_directions(step.t + middle * step.h, *step.at(system, middle))
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
        """Return X after some stretches of a step, each divided where its error needs it.

        Parameters
        ----------
        step : RungeKuttaStep
            The step.
        ends : sequence of float
            The shares of it at which stretches begin and end, ascending; matrices are smooth within each.
        matrices, applied : callable
            See `LinearSteps`.
        X : ndarray, shape (n, p)
            X at its start.
        least : ndarray, shape (p,), or float
            Entries of each column up to this are small.
        """
        steps = LinearSteps(self._method, step.h, matrices, applied, least)
        for first, last in pairwise(ends):
            found = steps.rough(first, last, X) if self.approximate else steps.taken(first, last, X)
            if found is None:
                self._refuse("the variations change too fast to be integrated", NO_ROWS, step.t)
            X = found
        return X


def _modes_of(integrator: Followed) -> ChosenModes | None:
    modes = integrator.modes
    return None if modes is None else ChosenModes(modes.index.copy(), modes.sticks.copy(), modes.way.copy())


def _differ(one: ChosenModes | None, other: ChosenModes | None) -> bool:
    """Return whether contacts stick and slip in other ways, or begin to slip the other way."""
    if one is None or other is None or not np.array_equal(one.sticks, other.sticks):
        return one is not other
    return bool((np.vecdot(one.way, other.way)[~one.sticks] < 0.0).any())


def _friction_of(event: ImpactEvent, before: ChosenModes | None, after: ChosenModes | None) -> ImpactFriction | None:
    friction, e = event.friction, event.restitution
    if friction is None or before is None or after is None or e is None:
        return None
    return ImpactFriction(before, after, friction.tangential, friction.sticks, e)

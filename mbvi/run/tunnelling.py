"""No body passes another between two steps: a step that would is cut where they touch."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..constraints import ConstraintFamily
from ..errors import DivergedError
from ..problem import Problem
from ..projection import Projector
from ..schemes import Scheme, Step
from ..schemes.event_driven.root_finding import advanced
from ..schemes.observer import observer
from ..system.system import Array

# [m/s, rad/s], squared and summed; beyond this no step means anything
_RUNAWAY = 1e16
# how deep a cut step ends in what it meets, in units of what would be passed through
_DEEP = 1e-3
# cuts of one step, and the part of it that is not worth a step
_MOST_CUTS, _REST = 100, 1e-9


class TunnellingGuard:
    """Watches whether bodies travel further within a step than it takes to pass through each other.

    Parameters
    ----------
    problem : Problem
        What moves.
    scheme : Scheme
        What moves it: with v_i until its law acts, then with v_{i+1}.
    h : float
        Time step [s].

    Attributes
    ----------
    limit : float
        v . v below which nothing can pass anything, and no velocity runs away.
    observe : callable or None
        `observer` of the problem; steps that are cut are shown to it, the last one of a step is not.
    """

    def __init__(self, problem: Problem, scheme: Scheme, h: float) -> None:
        self._problem, self._scheme = problem, scheme
        self._jump = getattr(scheme, "jump", 1.0)
        self.observe = observer(problem)
        # the families of which something can be passed through
        least = {family: family.least_displacement() for family in problem.constraints.families}
        self._watched = [family for family in problem.constraints.families if np.isfinite(least[family])]
        self.limit = _RUNAWAY
        # how far each velocity takes any two bodies in a step, in units of the thinnest
        self._share = np.zeros(problem.system.nv)
        # the same of each pair
        self._ways: list[Array] = []
        # of many bodies each is looked at; no velocity up to this takes any of them as far as it is thick
        self._slow = 0.0
        for family in self._watched:
            share = family.passed_share()
            if share is None:
                self._share, self._ways = np.full(problem.system.nv, np.inf), []
                self._slow = min(least[one] for one in self._watched) / h
                break
            np.maximum(self._share, h * share.max(axis=1), out=self._share)
            self._ways.append(h * share)
        reach = float(self._share.dot(self._share))
        if reach > 0.0:
            self.limit = min(self.limit, 1.0 / reach)

    def steps(self, t: float, state: Step, h: float, projector: Projector) -> Iterator[Step]:
        """Yield the steps that lead from a state at t to t + h, more than one where something would be passed."""
        new = self._scheme.step(self._problem, t, state.q, state.v, h, projector)
        # what is slow at both ends passes nothing; written so that a NaN is followed
        slow = new.v.dot(new.v) < self.limit and state.v.dot(state.v) < self.limit
        return iter([new]) if slow else self.followed(t, state, new, h, projector)

    def followed(self, t: float, state: Step, new: Step, h: float, projector: Projector) -> Iterator[Step]:
        """Yield the steps that lead from a state at t to t + h, `new` if nothing is passed on the way there."""
        rest = h
        for _ in range(_MOST_CUTS):
            self._check(new, h)
            if self._none_passes(np.maximum(np.abs(state.v), np.abs(new.v))):
                break
            part = self._part(state, new, rest)
            if part == 1.0 or rest <= _REST * h:
                break
            cut = self._shortened(t + h - rest, state, part * rest, projector)
            self._check(cut, h)
            if self.observe is not None:
                self.observe(cut, part * rest)
            yield cut
            state, rest = cut, rest - part * rest
            new = self._shortened(t + h - rest, state, rest, projector)
        yield new

    def _shortened(self, t: float, state: Step, h: float, projector: Projector) -> Step:
        """Return the state at t + h, where h is not the length of the other steps."""
        if hasattr(self._scheme, "shortened"):
            new: Step = self._scheme.shortened(self._problem, t, state, h, projector)
            return new
        return self._scheme.step(self._problem, t, state.q, state.v, h, projector)

    def _none_passes(self, v: Array) -> bool:
        """Tell whether no pair travels as far as it is thick at speeds of up to v, shape (nv,)."""
        if not self._ways:
            return float(v.max(initial=0.0)) < self._slow
        return float(self._share.dot(v)) < 1.0 or all((v.dot(ways) < 1.0).all() for ways in self._ways)

    def _check(self, state: Step, h: float) -> None:
        # written so that a NaN is refused too
        if not state.v.dot(state.v) < _RUNAWAY:
            raise DivergedError(
                f"the velocity runs away at t = {state.t:.6g} s, to {np.abs(state.v).max():.3g}: the forces change too "
                f"fast for h = {h:g} s; take a smaller step, or give light links damping or more inertia"
            )

    def _part(self, state: Step, new: Step, h: float) -> float:
        """Return the part of a step after which something would be passed through, 1 if nothing is."""
        system, before = self._problem.system, self._jump * h * state.v
        middle = system.integrate(state.q, before)
        for q, way, start, length in (
            (state.q, before, 0.0, self._jump),
            (middle, system.difference(middle, new.q), self._jump, 1.0 - self._jump),
        ):
            share = self._first(q, way) if length > 0.0 else 1.0
            if share < 1.0:
                return start + share * length
        return 1.0

    def _first(self, q: Array, way: Array) -> float:
        """Return the share of a straight way at which the first body meets what it would pass through."""
        first = 1.0
        for family in self._watched:
            for k, travel, thickness in zip(*family.passable(q, way), strict=True):
                first = min(first, self._meets(family, q, way, np.array([k]), travel, thickness))
        return first

    def _meets(
        self, family: ConstraintFamily, q: Array, way: Array, pair: Array, travel: float, thickness: float
    ) -> float:
        """Return the share of the way at which a pair meets, 1 if it does not."""

        def gap(x: float) -> float:
            place = self._problem.system.integrate(q, x * way)
            return float(family.pair_gap(self._problem.t0, place, pair)[0])

        tolerance, start = self._problem.tolerance, gap(0.0)
        short = min(_DEEP * thickness / travel, 1.0)
        begin, near = 0.0, max(tolerance, 0.1 * _DEEP * thickness)
        if start <= tolerance:
            # the law has taken what touches, unless it acts where a step is on its way: then a short one
            begin, rise = short, gap(short) - start
            if rise < near:
                return short if rise < -near else 1.0
        x = begin + advanced(lambda x: gap(begin + x), 1.0 - begin, travel)
        return min(x + short, 1.0) if x < 1.0 and gap(x) <= near else 1.0

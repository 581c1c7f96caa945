"""Chooses the lengths of steps: accepts, shortens, cuts them where bodies land, and applies the law there."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from ...constraints.rows import take
from ...errors import DivergedError, ProjectionError
from ...problem import Problem
from ...projection import FreeMotion, Projector
from ...system.lagrangian import LagrangianSystem
from ...system.system import Array
from ..step import NO_RATES, Step, law
from .closed import Near, near_rows, returned
from .doubling import Doubled, doubled, held
from .holding import HoldingCentered
from .joints import JointSlips
from .judgement import Verdict, judged
from .landing import acceleration_at, flight_time, instants_within, landing_time, missed_time, stop_time
from .measure import Measure

# the first step [s]
_FIRST = 1e-3
# how much a step may grow and shrink, what is left of one that is tried again, and the part of the longest good one
_GROWTH, _SHRINK, _RETRY, _SAFE = 4.0, 0.2, 0.7, 0.85
# by how much each further step in a row at the shortest length is longer
_LONGER = 2.0
# part of the shortest step down to which steps are tried in which nothing lands, opens or stops: forces may be stiff
_FINEST = 1e-3
# parts of the time to a landing that are tried one after the other, should it come before it was predicted
_CUTS = 1.0, 0.97, 0.8, 0.5
# most impacts at one time: what opens may close again at up to e times its speed, which the law (8) allows
_MOST_STRIKES = 20
# v . v at which a run has diverged
_RUNAWAY = 1e16


# see `AdaptiveIntegrator`
Passed = Callable[[Step, Step, float], float]


class Stride(NamedTuple):
    """An accepted step.

    Attributes
    ----------
    t0, q0, v0 : float and ndarray, shapes (nq,) and (nv,)
        The state before.
    first, second : Step
        Its two halves; `second` ends at the state that the run goes on from.
    """

    t0: float
    q0: Array
    v0: Array
    first: Step
    second: Step


# see `AdaptiveIntegrator`
Stop = Callable[[Stride], float | None]


class Strike(NamedTuple):
    """An impact that takes no time.

    Attributes
    ----------
    step : Step
        Its rows and rates, and the state after it.
    """

    step: Step


@dataclass
class Counts:
    """What a run has done.

    Attributes
    ----------
    steps, rejected : int
        Steps accepted and rejected.
    located : int
        Impacts at whose time a step was cut.
    floor, floor_impacts : int
        Steps accepted at the shortest length although their error was too large, without an impact in them and with.
    longest_floor, first_floor : float
        The length of the longest of these, and when the first began [s].
    """

    steps: int = 0
    rejected: int = 0
    located: int = 0
    floor: int = 0
    floor_impacts: int = 0
    longest_floor: float = 0.0
    first_floor: float = 0.0

    def add_floor(self, t: float, h: float, lands: bool) -> None:
        """Count a step of length h from t [s] that was accepted although its error was too large."""
        if not self.floor + self.floor_impacts:
            self.first_floor = t
        self.floor, self.floor_impacts = self.floor + (not lands), self.floor_impacts + lands
        self.longest_floor = max(self.longest_floor, h)


class AdaptiveIntegrator:
    """Runs a problem with error control.

    Parameters
    ----------
    problem : Problem
        The problem.
    tolerance : float
        See `Adaptive`.
    projector : Projector
        Solves the projections.
    start : Step
        The initial state.
    passed : callable
        passed(before, after, h) is the part of a step after which a body would pass through another, 1 if none does.
    stop : callable, optional
        stop(stride) is the time within a step at which the motion shall end, None if it goes on.
    longest : float
        Longest step [s].

    Attributes
    ----------
    t, q, v
        The present state.
    counts : Counts
        What the run has done so far.
    """

    def __init__(
        self, problem: Problem, tolerance: float, projector: Projector, start: Step, passed: Passed,
        stop: Stop | None = None, longest: float = np.inf,
    ) -> None:  # fmt: skip
        self._longest = longest
        self._problem, self._projector, self._passed, self._stop = problem, projector, passed, stop
        self._measure = Measure(problem, tolerance)
        self._scheme = HoldingCentered(self._measure)
        self.t, self.q, self.v, self.counts = start.t, start.q, start.v, Counts()
        # length of the next step
        self._h = _FIRST
        # controls are evaluated at the start of a step
        self._order = 1 if problem.system.controlled or problem.system.loaded else 2
        # functions of the user may jump
        self._jumps = self._order == 1 or isinstance(problem.system, LagrangianSystem)
        # steps at the shortest length since the last that was not
        self._short = 0
        # whether the last step was cut because a body lands soon
        self._hunts = self._lands_soon = False

    def run(self, duration: float) -> Iterator[Stride | Strike]:
        """Yield the steps and impacts of a run from the present state on; a further one goes on where it ended."""
        end = self.t + duration
        rounding = 1e-13 * max(abs(end), duration)
        while end - self.t > rounding:
            near = near_rows(self._problem, self._measure, self.t, self.q, self.v)
            for _ in range(_MOST_STRIKES):
                if not near.striking:
                    break
                yield self._strike()
                near = near_rows(self._problem, self._measure, self.t, self.q, self.v)
            before = self.t, self.q, self.v, self._h, self._short, self._hunts, replace(self.counts)
            stride = self._stride(near, end)
            time = None if self._stop is None else self._stop(stride)
            if time is not None:
                end, self._stop = time, None
                if time < self.t:
                    # shorter steps lead there
                    self.t, self.q, self.v, self._h, self._short, self._hunts, self.counts = before
                    continue
            yield stride

    def _strike(self) -> Strike:
        """Apply the law where the state is, and put contacts to rest whose rebound is slow."""
        problem, measure, speed = self._problem, self._measure, self._measure.size(self.v)
        rows = problem.constraints.active(self.t, self.q, measure.gap)
        slow = rows.restitution * np.abs(rows.speeds(self.v)) <= measure.rest(rows.constraint, speed)
        rows = rows._replace(restitution=np.where(slow, 0.0, rows.restitution))
        motion = FreeMotion(self.v, problem.system.metric(self.q))
        try:
            applied = law(self._projector, self.v, motion, rows)
        except ProjectionError:
            with self._projector.acceptance.second_bound():
                applied = law(self._projector, self.v, motion, rows)
        v, rates, residual, slip, rows = applied
        step = Step(self.t, self.q, v, rows, rates, residual, slip)
        rest = measure.rest(rows.constraint, speed)
        closed, sticks = held(step, rows, rest)
        # rows that close now strike next
        closed &= step.after >= -rest
        found = returned(problem, self.t, self.q, v, take(rows, closed), sticks[closed], 4.0 * measure.gap)
        if found is not None:
            step = step._replace(q=found.q, v=found.v)
        self.q, self.v, self._hunts = step.q, step.v, False
        self.counts.located += 1
        return Strike(step)

    def _stride(self, near: Near, end: float) -> Stride:
        """Take one step, as long as its error allows."""
        problem, measure, projector = self._problem, self._measure, self._projector
        t, q, v, speed = self.t, self.q, self.v, self._measure.size(self.v)
        self._scheme.start_from(near.resting)
        rough = problem.system.has_joint_friction
        slips = JointSlips(problem, measure, t, q, v, _FIRST) if rough else None
        wanted, cuts, cut, growth = self._h, 0, False, _GROWTH
        floor = measure.shortest(speed) * _LONGER ** min(self._short, 60)
        while True:
            h = min(wanted, end - t, self._longest)
            if self._hunts and not cuts:
                # the remaining way to a landing
                time = landing_time(problem, measure, t, q, v, near.resting, h, projector)
                cuts = 1
                if time is not None:
                    cut, h = True, time
            h = end - t if end - t - h < 0.01 * h else h
            shortest = h <= floor
            try:
                with projector.acceptance.second_bound() if shortest else nullcontext():
                    found = doubled(problem, self._scheme, t, q, v, h, projector)
            except ProjectionError as error:
                if shortest:
                    raise error.after(t) from error
                self.counts.rejected, wanted, cut = self.counts.rejected + 1, 0.25 * h, False
                projector.forget()
                continue
            verdict = self._judged(found, near, slips, h, speed)
            keeps = verdict.sound and verdict.error <= measure.step
            if shortest and (keeps or not verdict.smooth or h <= _FINEST * floor):
                break
            missed = None
            if keeps and not verdict.lands:
                instants = instants_within(problem, measure, t, q, v, verdict.step, h)
                missed = missed_time(problem, measure, instants)
                if missed is None:
                    missed = flight_time(problem, measure, t, q, v, near.resting, instants)
            if keeps and missed is None:
                break
            self.counts.rejected += 1
            if missed is not None:
                # the next step ends within the overlap or the flight, where it is seen
                wanted, cut, growth = min(missed, 0.9 * h), False, 1.0
                continue
            time = self._event(verdict, near, slips, h) if cuts < len(_CUTS) else None
            cut = time is not None
            if time is not None:
                wanted, cuts = min(time, h) * _CUTS[cuts], cuts + 1
            else:
                wanted, growth = h * self._factor(verdict, _RETRY), 1.0
        new = verdict.step if keeps else found.second._replace(t=verdict.step.t)
        if not keeps:
            self.counts.add_floor(t, h, verdict.lands)
        self._short = max(self._short - 1, 0) if keeps else self._short + 1
        self.counts.steps += 1
        self.t, self.q, self.v = new.t, new.q, new.v
        # with the bound of the shortest, so that a run whose error is never small enough ends
        grown = h * (self._factor(verdict, growth) if keeps else _LONGER)
        # a step that was cut, or ends with the run, says little of the next
        self._h = max(grown, self._h) if cut or (h == end - t and h < wanted) else grown
        self._hunts = cut and self._lands_soon
        return Stride(t, q, v, found.first, new)

    def _event(self, verdict: Verdict, near: Near, slips: JointSlips | None, h: float) -> float | None:
        """Return the time to the landing or the stop of sliding within a step that was not accepted, None without."""
        problem, measure, t, q, v = self._problem, self._measure, self.t, self.q, self.v
        self._lands_soon = False
        if verdict.lands:
            time = landing_time(problem, measure, t, q, v, near.resting, h, self._projector)
            self._lands_soon = time is not None
            if time is not None:
                return time
        least = measure.slides(measure.size(v)) / problem.length
        return stop_time(problem, t, q, v, near.resting, slips, least, h, self._projector)

    def _judged(self, found: Doubled, near: Near, slips: JointSlips | None, h: float, speed: float) -> Verdict:
        """Return what is known of a step of length h; raise `DivergedError` where velocities grow without bound."""
        second = found.second
        # written so that a NaN raises too
        if not second.v.dot(second.v) < _RUNAWAY:
            raise DivergedError(
                f"the velocity runs away at t = {second.t:.6g} s, to {np.abs(second.v).max():.3g}: forces grow too fast"
            )
        speed = max(speed, self._measure.size(second.v))
        start = Step(self.t, self.q, self.v, self._problem.constraints.empty, NO_RATES, 0.0)
        if self._passed(start, second, h) < 1.0:
            return Verdict(second._replace(t=self.t + h), 0.0, 1.0, True, False, False)
        problem, measure, least = self._problem, self._measure, self._measure.slides(speed) / self._problem.length
        state = self.t, self.q, self.v
        verdict = judged(problem, measure, found, near.resting, state, h, speed, self._order, self._jumps)
        if slips is None:
            return verdict
        before = partial(acceleration_at, problem, self.t, self.q, self.v, near.resting, h, self._projector)
        error, turns = slips.hidden(found, before, h, least)
        error = max(verdict.error, error / max(1.0, speed))
        return verdict._replace(error=error, sound=verdict.sound and not turns)

    def _factor(self, verdict: Verdict, most: float) -> float:
        """Return by how much the next step is longer than the last one tried."""
        ratio = verdict.error / self._measure.step
        wanted = _SAFE * ratio**-verdict.power if ratio > 0.0 else most
        return float(min(max(wanted, _SHRINK), most))

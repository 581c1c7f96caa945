"""A motion on its way: smooth steps, located events, and which contacts are closed."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from typing import NamedTuple

import numpy as np

from ...constraints.rows import chosen
from ...errors import DivergedError
from ...problem import Problem
from ...projection import FreeMotion, Projector
from ...system.lengths import velocity_units
from ...system.system import Array
from ..paoli import Paoli
from ..step import Step, closes, still_rates
from .closing_events import Crossings
from .contact_rows import SmoothRows
from .observed import ObservedIntegrator
from .release_events import STAYS, complementarity, first_release
from .runge_kutta import DEGREE, Flow, RungeKuttaStep, pushed

# the part of the tolerance that one step may err by, and that a gap may be off
_LOCAL, _TOUCHING = 0.3, 0.01
# the rate that is none, in lengths of the scene a second [1/s]
_SLOW = 1e-14
# the height, in lengths of the scene, of a bounce that is put to rest
_BOUNCE = 1e-14
_SAFETY, _LEAST_FACTOR, _MOST_FACTOR, _ORDER = 0.8, 0.2, 10.0, 0.125
_FIRST_STEP, _LEAST_STEP = 1e-3, 1e-13
# steps taken anew until one ends at an event, and the part of a step within which a parabola leads there
_NEWTON, _CLOSE = 4, 1e-6
# the step after an event, in times that since the last and at least [s]
_AFTER, _LEAST_AFTER = 10.0, 1e-6
# impacts so near in time [s], between which no gap opens by more than so many times what counts as touching, accumulate
_BRIEF, _COLLAPSE = 1e-5, 1e3
# single impacts after which an accumulation is taken to have ended
_MOST_SINGLE = 10_000
# how long what strikes polyhedra must be off for, at least, for the smooth motion to go on [s]
_OFF = 1e-3
# events without progress in time after which the paper's step goes on, its length [s], and how many are taken before
# the smooth motion is tried again
_MOST_AT_ONCE, _FALLBACK_STEP, _FALLBACK_RUN = 50, 1e-4, 50
# after so many steps and events time must have gone on by so much of the duration
_PATIENCE, _PROGRESS = 3000, 1e-5
_NONE = np.zeros(0, np.int64)


class ImpactEvent(NamedTuple):
    """What an impact did.

    Attributes
    ----------
    t : float
        When [s].
    q, before, after : ndarray
        Configuration and velocities.
    number : ndarray of int, shape (k,)
        The constraints that took part.
    rates : ndarray, shape (3, k)
        Percussion, J v before and J v after of each.
    point, normal : ndarray, shape (k, 3)
        Where, in the world [m]; NaN where a constraint is no contact.
    """

    t: float
    q: Array
    before: Array
    after: Array
    number: Array
    rates: Array
    point: Array
    normal: Array


class EventDrivenIntegrator:
    """A motion on its way.

    Attributes
    ----------
    t, q, v
        Time [s] and state.
    closed : ndarray of int, shape (k,)
        The rows that are kept closed.
    depth : float
        Deepest penetration before the drift of closed contacts was taken out [m or rad].
    residual : float
        Relative KKT residual of the law that led to the state; 0 where none did.
    fallbacks : int
        Steps that the paper's scheme took.
    fallback : Step or None
        The step of the paper's scheme that the last stride stands for, if it does.
    """

    def __init__(self, problem: Problem, tolerance: float, projector: Projector) -> None:
        self.problem, self.tolerance, self.projector = problem, tolerance, projector
        self.system = problem.system
        if hasattr(self.system, "start"):
            self.system.start()
        self.t, self.q, self.v = problem.t0, problem.q0.copy(), problem.v0.copy()
        self.rows = SmoothRows(problem.constraints, self.t, self.q, problem.length)
        self._units = velocity_units(self.system, problem.length)
        self.flow, self.crossings = Flow(problem, self.rows), Crossings(self.system, self.rows)
        self.observed = ObservedIntegrator(problem, self.rows)
        self.closed, self.touching = _NONE, min(problem.tolerance, _TOUCHING * tolerance * problem.length)
        # the rows of the last event, and when steps were last counted
        self._struck, self._turns, self._marked = _NONE, 0, self.t
        self._struck_at, self.depth, self.residual, self.fallbacks = -np.inf, 0.0, 0.0, 0
        self.fallback: Step | None = None

    def run(self, duration: float) -> Iterator[RungeKuttaStep | ImpactEvent]:
        """Yield the steps of the smooth motion, and the impacts between them."""
        end, h, at_once = self.problem.t0 + duration, min(_FIRST_STEP, duration), 0
        yield from self._settle(self._touch(self.rows.all))
        a = self.flow.acceleration(self.t, self.q, self.v, self.closed)
        while self.t < end:
            self._watch(duration)
            length = min(h, end - self.t)
            try:
                stride, factor, share, first = self._attempt(a, length)
            except DivergedError as error:
                # what is not finite ahead of the state may be out of the motion's way
                self.crossings.forget()
                h = self._shorter(length, _LEAST_FACTOR, error)
                continue
            if stride is None:
                h = self._shorter(length, factor)
                continue
            event = share < 1.0
            if event:
                # the next event may be as near
                h = min(h, max(_AFTER * share * length, _LEAST_AFTER))
            at_once = at_once + 1 if event and stride.h < _LEAST_STEP * max(1.0, abs(self.t)) else 0
            self._arrive(stride, end)
            self.observed.stride(stride, self.closed, self.t, self.q)
            yield stride
            if event:
                left = at_once <= _MOST_AT_ONCE and (self.rows.smooth[first].all() or (yield from self._bounce()))
                if left:
                    yield from self._settle(self._touch(np.union1d(first, self.closed)))
                else:
                    yield from self._fall_back(end)
                    at_once = 0
            else:
                h = stride.h * factor
            # a control may act otherwise on what it has just been shown
            changed = event or self.closed.size or self.observed.seen
            a = self.flow.acceleration(self.t, self.q, self.v, self.closed) if changed else stride.a

    def _watch(self, duration: float) -> None:
        """Raise `DivergedError` where steps and events without number make no progress in time."""
        self._turns += 1
        if self._turns % _PATIENCE:
            return
        if self.t - self._marked < _PROGRESS * duration:
            names = sorted({self.problem.constraints.name(int(k)) for k in self.rows.number[self._struck]})
            raise DivergedError(
                f"{_PATIENCE} steps and events since t = {self._marked:.9g} s led to t = {self.t:.9g} s only, the last "
                f"on {', '.join(names[:5]) or 'no constraint'}: gaps or forces change too fast there, or contradict "
                "each other; take a scheme of fixed steps, such as Centered"
            )
        self._marked = self.t

    def _attempt(self, a: Array, h: float) -> tuple[RungeKuttaStep | None, float, float, Array]:
        """Take a step of at most length h, up to the first event.

        Returns
        -------
        stride : RungeKuttaStep or None
            The step; None if its error is too large.
        factor : float
            By which the next step may differ from h.
        share : float
            The part of h after which the event is, 1 if there is none.
        first : ndarray of int
            The row that closes there, if one does.
        """
        stride = self.flow.step(self.t, self.q, self.v, a, h, self.closed)
        error = self._error(stride)
        factor = min(max(_SAFETY * max(error, 1e-12) ** -_ORDER, _LEAST_FACTOR), _MOST_FACTOR)
        # written so that a NaN is refused too
        if not error <= 1.0:
            return None, factor if np.isfinite(error) else _LEAST_FACTOR, 1.0, _NONE
        stride = self.flow.completed(stride, self.closed)
        share, first = self.crossings.first(stride, self.closed)
        let_go = first_release(self.flow, self.projector, stride, self.closed, share)
        if let_go < share:
            share, first = let_go, _NONE
        if share < 1.0:
            stride = self._stop(a, share * h, first)
        return stride, factor, share, first

    def _shorter(self, h: float, factor: float, error: DivergedError | None = None) -> float:
        if h * factor < _LEAST_STEP * max(1.0, abs(self.t)):
            if error is not None:
                raise error
            names = sorted({self.problem.constraints.name(int(k)) for k in self.rows.number[self.closed]})
            raise DivergedError(
                f"the step shrinks to nothing at t = {self.t:.6g} s, where {', '.join(names) or 'no constraint'} "
                f"{'are' if len(names) > 1 else 'is'} closed: the forces are not smooth there"
            )
        return h * factor

    def _arrive(self, stride: RungeKuttaStep, end: float) -> None:
        """Go to the end of a step, without the drift of closed contacts."""
        self.t, self.q, self.v = stride.t + stride.h, stride.q, stride.v
        if end - self.t < 1e-12 * max(1.0, abs(end)):
            self.t = end
        self.depth, self.residual, self.fallback = self.crossings.depth, 0.0, None
        if self.closed.size:
            self._hold()

    def _bounce(self) -> Generator[RungeKuttaStep | ImpactEvent, None, bool]:
        """Apply the law (8) where a gradient jumps; return whether all are off then for long enough."""
        q, v = self.q, self.v
        active = self.problem.constraints.active(self.t, q, self.problem.tolerance)
        number, _, J, e, point, normal, _ = active
        before = J @ v
        slow = _SLOW * self.problem.length / self.problem.constraints.levers(number)
        if (before < -_moves(J, v, slow)).any():
            self.v, rates, self.residual = self.projector.law(v, FreeMotion(v, self.system.metric(q)), J, e)
            rates = np.array([rates[0], before, J @ self.v])
            yield self.observed.impact(ImpactEvent(self.t, q, v, self.v, number, rates, point, normal))
        pull = np.abs(J @ self.flow.acceleration(self.t, q, self.v, self.closed)[: len(v)])
        jumping = np.isin(number, self.rows.number[~self.rows.smooth])
        return bool((2.0 * (J @ self.v) > _OFF * pull)[jumping].all())

    def _fall_back(self, end: float) -> Iterator[RungeKuttaStep | ImpactEvent]:
        """Go on by the paper's scheme while gradients jump, then out of what that leaves inside constraints."""
        jumping = np.unique(self.rows.number[~self.rows.smooth])
        for _ in range(_FALLBACK_RUN):
            h = min(_FALLBACK_STEP, end - self.t)
            if h <= 0.0:
                return
            self.fallbacks += 1
            active = yield from self._paolis_step(h, end)
            if not np.isin(active, jumping).any():
                break
        inside = np.flatnonzero(self.rows.gaps(self.t, self.q, self.rows.all) < 0.0)
        if inside.size:
            self.depth = self._move_out(inside)
            yield _straight(self.t, 0.0, self.q, self.v, self.q)
        self.crossings.forget()
        yield from self._settle(self._touch(_NONE))

    def _paolis_step(self, h: float, end: float) -> Generator[RungeKuttaStep | ImpactEvent, None, Array]:
        """Take one step of the paper's scheme; return which constraints were active."""
        q, v = self.q, self.v
        step = Paoli().step(self.problem, self.t, q, v, h, self.projector)
        stride = _straight(self.t, h, q, v, step.q)
        self.t = end if end - step.t < 1e-12 * max(1.0, abs(end)) else step.t
        self.q, self.residual = step.q, step.residual
        self.depth = max(0.0, -float(step.active.gap.min(initial=0.0)))
        self.observed.step(step, h)
        # what goes on pressing is no impact
        closing = closes(step.rates, still_rates(self.problem, step.active.constraint))
        percussion = step.percussion
        self.v = v if closing.any() else step.v
        self.fallback = step
        yield stride
        self.v = step.v
        if closing.any():
            number, _, _, _, point, normal, _ = chosen(step.active, percussion > 0.0)
            rates = step.rates[[0, 3, 2]][:, percussion > 0.0]
            yield self.observed.impact(ImpactEvent(self.t, step.q, v, step.v, number, rates, point, normal))
        return step.active.constraint

    def _error(self, stride: RungeKuttaStep) -> float:
        """Return the local error relative to what is allowed."""
        speed = float(np.abs(stride.v / self._units).max(initial=1.0))
        in_chart, *of_v = (stride.error.reshape(-1, len(stride.v)) / self._units).max(axis=1, initial=0.0).tolist()
        # a NaN stays one
        return float(np.maximum(in_chart, np.max(of_v) / speed) / (_LOCAL * self.tolerance))

    def _stop(self, a: Array, h: float, first: Array) -> RungeKuttaStep:
        """Return the step taken anew up to where the first row closes, by Newton's method."""
        stride = self.flow.step(self.t, self.q, self.v, a, h, self.closed)
        for _ in range(_NEWTON if first.size else 0):
            gap = float(self.rows.gaps(stride.t + h, stride.q, first)[0])
            rate = float((self.rows.gradients(stride.t + h, stride.q, first) @ stride.v)[0])
            # where it grazes the dense output is as good
            if abs(gap) < 0.1 * self.rows.rounding[first[0]] or rate >= 0.0 or not 0.0 < h - gap / rate:
                break
            late = -gap / rate
            if abs(late) < _CLOSE * h:
                stride = stride.prolonged(self.system, late)
                break
            h += late
            stride = self.flow.step(self.t, self.q, self.v, a, h, self.closed)
        return self.flow.completed(stride, self.closed)

    def _touch(self, known: Array) -> Array:
        """Return the rows that touch; `known` are looked at, and whatever else is near."""
        near = self.crossings.within(self.t, self.q, 10 * self.touching)
        near = np.union1d(near, known) if known.size else near
        gaps = self.rows.gaps(self.t, self.q, near) * self.rows.lever[near]
        near, gaps = near[gaps <= 10 * self.touching], gaps[gaps <= 10 * self.touching]
        touches = (gaps <= self.touching) | np.isin(near, known)
        near, gaps = near[touches], gaps[touches]
        # one that can be told to be apart and goes on opening is struck later, if at all
        loose = (gaps > self.rows.rounding[near] * self.rows.lever[near]) & ~np.isin(near, self.closed)
        if loose.any():
            J = self.rows.gradients(self.t, self.q, near[loose])
            loose[loose] = J @ self.v > _moves(J, self.v, self._slow(near[loose]))
        return near[~loose]

    def _settle(self, touching: Array) -> Iterator[ImpactEvent]:
        """Apply the law (8) where something closes, and find out which contacts stay closed."""
        rested, self.closed = np.isin(touching, self.closed), _NONE
        if not touching.size:
            return
        self.rows.check(self.t, self.q, touching)
        self._struck = touching
        J, metric = self.rows.gradients(self.t, self.q, touching), self.system.metric(self.q)
        e, before = self.rows.restitution[touching], J @ self.v
        still = _moves(J, self.v, self._slow(touching))
        if (before < -still).any():
            v = self.v
            # how far gaps went since the last impact: rows that near are struck in turn, not at once
            since = self.t - self._struck_at
            way = since * float((self.rows.lever[touching] * np.abs(before)).max())
            in_turn = len(touching) > 1 and not rested.any() and 0.0 < since < _BRIEF
            if in_turn and way < _COLLAPSE * self.touching:
                self.v, percussion = _one_by_one(v, J, metric.solve_rows(J), e, still)
            else:
                self.v, rates, residual = self.projector.law(v, FreeMotion(v, metric), J, e)
                percussion, self.residual = rates[0], residual
            self._struck_at = self.t
            point, normal = self.rows.points(self.t, self.q, touching)
            rates = np.array([percussion, before, J @ self.v])
            struck = ImpactEvent(self.t, self.q, v, self.v, self.rows.number[touching], rates, point, normal)
            yield self.observed.impact(struck)
        rates = J @ self.v
        bend = self.rows.bias(self.t, self.q, self.v, touching)
        smooth = self.rows.smooth[touching]
        sure = (rates <= still) & smooth
        pull = self.system.acceleration(self.t, self.q, self.v)
        if sure.any():
            # those that rest in any case push on the others
            pull = self.projector.project(pull, metric, J[sure], -bend[sure]).velocity
        pull = J @ pull + bend
        # a contact that the forces close rests where all its bounces take less time than the tolerance, or rise less
        # than can be told
        time = 2.0 * rates <= self.tolerance * np.abs(pull) * (1.0 - e)
        height = self.rows.lever[touching] * rates**2 <= 2.0 * _BOUNCE * self.problem.length * np.abs(pull)
        low = (pull < 0.0) & (time | height)
        rest = touching[(low | sure) & smooth]
        if not rest.size:
            return
        kept = J[np.isin(touching, rest)]
        self.v = self.v + pushed(metric, kept, -(kept @ self.v))
        press, opening = complementarity(self.flow, self.projector, self.t, self.q, self.v, rest)
        # one that the others keep closed without its help stays as well: it cannot open on its own
        self.closed = rest[(press > 0.0) | (opening <= STAYS)]

    def _slow(self, index: Array) -> Array:
        """Return the rates of some rows that are none [m/s or rad/s]."""
        return np.asarray(_SLOW * self.problem.length / self.rows.lever[index])

    def _hold(self) -> None:
        """Take the drift out of closed contacts: of the configuration, then of the velocity."""
        for _ in range(2):
            self.depth = max(self.depth, self._move_out(self.closed))
        J = self.rows.gradients(self.t, self.q, self.closed)
        self.v = self.v + pushed(self.system.metric(self.q), J, -(J @ self.v))

    def _move_out(self, index: Array) -> float:
        """Project the configuration onto where some gaps vanish; return how deep the deepest was."""
        gap, J = self.rows.gaps(self.t, self.q, index), self.rows.gradients(self.t, self.q, index)
        self.q = self.system.integrate(self.q, pushed(self.system.metric(self.q), J, -gap))
        return max(0.0, -float(gap.min()))


def _moves(J: Array, v: Array, slow: Array | float) -> Array:
    """Return the rates beyond which rows move for certain, at least `slow`."""
    return np.asarray(1e-12 * (np.abs(J) @ np.abs(v)) + slow)


def _straight(t: float, h: float, q0: Array, v: Array, q: Array) -> RungeKuttaStep:
    """Return a step from q0 to q at constant velocity."""
    dense, nothing = np.zeros((2, len(v), DEGREE)), np.zeros((2, len(v)))
    dense[0, :, 0] = v
    return RungeKuttaStep(t, h, q0, v, q, v, nothing[0], h * np.abs(v), nothing, nothing, dense)


def _one_by_one(v: Array, J: Array, turned: Array, e: Array, still: Array) -> tuple[Array, Array]:
    """Return the limit of single impacts, the fastest first, and the percussions they add up to."""
    diagonal, percussion = np.einsum("ij,ij->i", J, turned), np.zeros(len(e))
    scaled = still / np.sqrt(diagonal)
    for _ in range(_MOST_SINGLE):
        rates = J @ v
        normal = rates / np.sqrt(diagonal) + scaled
        a = int(normal.argmin())
        if normal[a] >= 0.0:
            break
        p = -(1.0 + e[a]) * rates[a] / diagonal[a]
        percussion[a] += p
        v = v + p * turned[a]
    return v, percussion

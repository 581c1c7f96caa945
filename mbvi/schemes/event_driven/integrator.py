"""The event-driven integrator: smooth Runge-Kutta steps that end at located impacts, closings and releases."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from ...constraints.contact import Contact
from ...errors import DivergedError, MbviError, ProjectionError
from ...problem import Problem
from ...projection import Projector
from ...system.system import Array
from ..contact_friction import ContactFriction
from ..observer import Contacts
from .contact_changes import change_contacts, touching_rows
from .dead_centres import at_dead_centre, beside_dead_centre
from .fallback import STEP, bounce, fall_back
from .finding.feature_events import drop_features, first_feature_change
from .finding.release_events import first_release
from .forces.force_kinks import Crossing, ForceKinks
from .friction.events import first_mode_end
from .friction.forces import contact_forces
from .impact_event import ImpactEvent
from .motion_state import LOCAL, NO_ROWS, MotionState
from .rows.row_sets import members, union
from .runge_kutta import RungeKuttaStep
from .unseen_forces import UnseenForces
from .whole_step import largest_error

# step control: the next step is h times _SAFETY error^-_EXPONENT, between the least and the most factor; the exponent
# is one over the order of the method
_SAFETY, _LEAST_FACTOR, _MOST_FACTOR, _EXPONENT = 0.8, 0.2, 10.0, 0.125
# the first step [s], and the least one, relative to the time or to 1 s
_FIRST_STEP, _LEAST_STEP = 1e-3, 1e-13
# most Newton steps to an event, and the correction for which a parabola is exact enough, relative to the step
_MOST_NEWTON, _PARABOLA = 4, 1e-6
# how far Newton's method may lead, relative to the step whose error is known
_MOST_LATE = 1.1
# error of a step, relative to the largest one, below which its dense output is exact enough to end it at an event
_SMALL = 0.01
# part of the way to a stop that is taken where the motion is not known well enough up to it
_BEFORE_STOP = 0.8
# gap in those of touching contacts above which an event was not found; the part of the way to it that is taken then,
# and the least part of the step
_FOUND, _BEFORE_MISSED, _LEAST_MISSED = 100.0, 0.5, 1e-3
# longest step after an event: this many times the step that ended at the event, or this time [s] if that is more
_AFTER, _LEAST_AFTER = 10.0, 1e-6
# events without progress in time after which steps of `Paoli` are taken, and with friction steps shorter than this
# part of the tolerance [s]
_MOST_AT_ONCE, _SHRUNK = 50, 1e-3
# events that must not all be within the length of a step of `Paoli`: more accumulate without end
_MOST_EVENTS = 1000
# in this many steps and events, time must advance by this part of the duration
_PATIENCE, _PROGRESS = 3000, 1e-5

# see `EventDrivenIntegrator`
Stop = Callable[[RungeKuttaStep, Contacts], float | None]


class EventDrivenIntegrator(MotionState):
    """Integrates a motion from the problem's start; see `MotionState` for its state.

    `stop` is asked about each smooth step, with its contacts, for the time within it at which the motion ends.
    """

    def __init__(self, problem: Problem, tolerance: float, projector: Projector, stop: Stop | None = None) -> None:
        super().__init__(problem, tolerance, projector)
        self._stop = stop
        # steps and events so far, and the time when progress was last checked; the same of events alone
        self._count, self._checked_time = 0, self.t
        self._events, self._events_time = 0, -np.inf
        # length of the next step; the rows that a run looks at first
        self._length, self._first = _FIRST_STEP, self.rows.all
        self._unseen = UnseenForces(self.flow, self.units, tolerance)
        self._kinks = ForceKinks(self.system, self.units, LOCAL * tolerance)

    def run(self, duration: float) -> Iterator[RungeKuttaStep | ImpactEvent]:
        """Yield the steps of the smooth motion, and the impacts between them, from the present state on.

        A further run goes on where the last one ended. Forces may jump between them.
        """
        # `at_once` counts events without progress in time
        end, h, at_once = self.t + duration, self._length, 0
        yield from change_contacts(self, touching_rows(self, self._first, NO_ROWS))
        a = self.flow.acceleration(self.t, self.q, self.v, self.closed)
        while self.t < end:
            self._check_progress(duration)
            if self.modes is not None and not self.modes.begin(self.t, self.q, self.v, self.closed):
                before = self.fallbacks
                yield from fall_back(self, end)
                self.undetermined += self.fallbacks - before
                a = self.flow.acceleration(self.t, self.q, self.v, self.closed)
                continue
            longest = min(h, end - self.t, self.flow.longest(self.v))
            length = self._kinks.before_break(self.t, self.q, self.v, longest)
            left = length if length < longest else end - self.t
            try:
                if self.flow.has_loops:
                    length = beside_dead_centre(self.system, self.q, self.v, length)
                step, factor, share, first = self._attempt(a, length)
                self.closing.take(0.0 if step is None else step.h / length)
            except (DivergedError, ProjectionError) as error:
                # a shorter step may avoid the states where forces are not finite, or loops cannot be closed
                self.closing.forget()
                h = self._shorter(length, _LEAST_FACTOR, error)
                continue
            if step is None and self.modes is not None and length * factor < _LEAST_STEP * max(1.0, abs(self.t)):
                # forces that grow without bound end in an impact without approach
                yield from fall_back(self, end)
                a, h = self.flow.acceleration(self.t, self.q, self.v, self.closed), _FIRST_STEP
                continue
            if step is None:
                h = self._shorter(length, factor)
                continue
            if self._stop is not None:
                time = self._stop(step, partial(self._contacts, step))
                if time is not None:
                    yield self._to(time, step, end)
                    return
            event = share < 1.0
            if event:
                # the next event may follow as soon
                usual, h = h, min(h, max(_AFTER * share * length, _LEAST_AFTER))
            # near Painlevé's configuration forces grow without bound, and steps shrink
            shrinks = self.modes is not None and step.h < min(_SHRUNK * self.tolerance, end - step.t)
            stays = shrinks or (event and step.h < _LEAST_STEP * max(1.0, abs(self.t)))
            at_once = at_once + 1 if stays else 0
            self._advance(step, end)
            self._observe(step)
            yield step
            if event or at_once > _MOST_AT_ONCE:
                kept = self.rows.pair[self.closed]
                drop_features(self, first)
                touching = touching_rows(self, union(first, self.closed), first)
                # a pair that closes is replaced by the rows of its features, where these are clear
                clear = self.rows.smooth[first] | (self.rows.featured[first] & ~members(first, touching))
                advances = at_once <= _MOST_AT_ONCE and self._events_advance()
                if advances and (clear.all() or (yield from bounce(self))):
                    yield from change_contacts(self, touching, kept)
                    if self.modes is not None and self.modes.begins:
                        # in a short step a slip that begins gently would stay below its rounding
                        h = usual
                else:
                    yield from fall_back(self, end)
                    at_once = 0
            else:
                # a step that ends with the run says little of the next
                h = step.h * factor if length < left else max(h, step.h * factor)
            # a control may react to the contacts that it has just received
            changed = event or self._kinks.found or self.closed.size or self.observed.active
            a = self.flow.acceleration(self.t, self.q, self.v, self.closed) if changed else step.a
        self._length, self._first = h, self.closed

    def _to(self, time: float, step: RungeKuttaStep, end: float) -> RungeKuttaStep:
        """Move to a time within a step, where the motion ends; return the step up to there."""
        if time < step.t + step.h:
            # what acts may have changed already: the function that was asked may control the motion too
            step = self._cut(step, (time - step.t) / step.h, None)
        self._advance(step, end)
        self.t = time
        self._observe(step)
        return step

    def _observe(self, step: RungeKuttaStep) -> None:
        """Pass on the contacts of a step to the controls that look at them."""
        sliding = self._sliding(step, self.t, self.q, self.v) if self.observed.active else None
        self.observed.smooth_step(step, self.closed, self.t, self.q, sliding)

    def _sliding(self, step: RungeKuttaStep, t: float, q: Array, v: Array) -> tuple[Array, ContactFriction] | None:
        """Return the percussions of contacts with friction, those of the forces at a state over a step."""
        if self.modes is None or not self.closed.size:
            return None
        return contact_forces(self.rows, self.modes, (t, q, v), self.closed, step.h)

    def _contacts(self, step: RungeKuttaStep) -> tuple[Contact, ...]:
        """Return the contacts at the end of a step that is not taken yet."""
        t = step.t + step.h
        known = self._sliding(step, t, step.q, step.v)
        return self.observed.of_smooth_step(step, self.closed, t, step.q, known)()

    def _events_advance(self) -> bool:
        """Return False where very many events have followed each other within the length of a step of `Paoli`."""
        self._events += 1
        if self._events % _MOST_EVENTS:
            return True
        before, self._events_time = self._events_time, self.t
        return self.t - before > STEP

    def _check_progress(self, duration: float) -> None:
        """Raise `DivergedError` where very many steps and events make no progress in time."""
        self._count += 1
        if self._count % _PATIENCE:
            return
        if self.t - self._checked_time < _PROGRESS * duration:
            names = self.names(self.event_rows)
            raise DivergedError(
                at_dead_centre(self.system, self.t, self.q)
                or f"{_PATIENCE} steps and events since t = {self._checked_time:.9g} s led to t = {self.t:.9g} s only, "
                f"the last on {', '.join(names[:5]) or 'no constraint'}: gaps or forces change too fast there, or "
                "contradict each other; take a scheme of fixed steps, such as Centered"
            )
        self._checked_time = self.t

    def _attempt(self, a: Array, h: float) -> tuple[RungeKuttaStep | None, float, float, Array]:
        """Take a step of at most length h, up to the first event.

        Returns
        -------
        step : RungeKuttaStep or None
            The step; None if its error is too large.
        factor : float
            Length of the next step over h.
        share : float
            Share of h at which the event is; 1 if there is none.
        first : ndarray of int
            The row that closes there, if one does, or the pairs whose features change.
        """
        try:
            if self._kinks.hold(self.t, self.q, self.v, a, h):
                a = self.flow.acceleration(self.t, self.q, self.v, self.closed)
            return self._smooth(a, h)
        finally:
            self._kinks.release()

    def _smooth(self, a: Array, h: float) -> tuple[RungeKuttaStep | None, float, float, Array]:
        """Return what `_attempt` does, while forces are held on the sides of their limits."""
        takes = self.implicit if self.implicit is not None and self.implicit.needed(h) else self.flow
        step, stiff = takes.step(self.t, self.q, self.v, a, h, self.closed), takes is self.implicit
        if step is None:
            return None, _LEAST_FACTOR, 1.0, NO_ROWS
        error = self._error(step)
        factor = min(max(_SAFETY * max(error, 1e-12) ** -_EXPONENT, _LEAST_FACTOR), _MOST_FACTOR)
        # written so that a NaN is refused too
        if not error <= 1.0:
            return None, factor if np.isfinite(error) else _LEAST_FACTOR, 1.0, NO_ROWS
        if not stiff:
            step = self.flow.with_dense_output(step, self.closed)
        share, first = self.closing.first(step, np.concatenate([self.closed, self.held]))
        if self.modes is None:
            release = first_release(self.flow, self.projector, step, self.closed, share)
        else:
            release = first_mode_end(self.modes, step, self.closed, share)
            # to the stop, if the step has one
            reach = min(release, share)
            if not stiff and not self.modes.defect(step, self.closed, reach, self.units) <= LOCAL * self.tolerance:
                return None, _BEFORE_STOP * reach if self.modes.stopped >= 0 else _LEAST_FACTOR, 1.0, NO_ROWS
        if release < share:
            share, first = release, NO_ROWS
        change, pairs = first_feature_change(self, step, share)
        if change < share:
            share, first = change, pairs
        kink, margin = self._kinks.first(step, share)
        left = 1.0 if stiff else self._unseen.part_before(step, self.closed, min(kink, share))
        if left < 1.0 or kink == 0.0:
            return None, left, 1.0, NO_ROWS
        if margin is not None:
            exact = stiff or error < _SMALL
            step = self._cut(step, kink, None) if exact else self._step_to_event(a, kink * h, margin, h)
            # beside modes that decay at once the estimate of a longer step may have been small by chance
            if not self._error(step) <= 1.0:
                return None, _LEAST_FACTOR, 1.0, NO_ROWS
            return step, factor * h / step.h, 1.0, NO_ROWS
        if share < 1.0:
            stops = share == release and self.modes is not None and self.modes.stopped >= 0
            crossing = self._crossing(NO_ROWS if first is pairs else first, stops)
            exact, closes = stiff or error < _SMALL or stops, bool(first.size) and first is not pairs
            known = (
                self.closing.crossing(step, share, int(first[0]), _MOST_LATE, _MOST_NEWTON)
                if exact and closes
                else None
            )
            if known is not None:
                step = self._cut(step, known, None)
            else:
                step = self._cut(step, share, crossing) if exact else self._step_to_event(a, share * h, crossing, h)
            if closes and self.closing.misses(first, step, _FOUND * self.touching):
                # of a long step in which bodies meet and part again interpolants may know too little
                return None, max(_BEFORE_MISSED * share, _LEAST_MISSED), 1.0, NO_ROWS
        return step, factor, share, first

    def _shorter(self, h: float, factor: float, error: MbviError | None = None) -> float:
        """Return the length of a retried step; raise `error`, or an error of its own, if that is too short."""
        if h * factor < _LEAST_STEP * max(1.0, abs(self.t)):
            reason = at_dead_centre(self.system, self.t, self.q)
            if error is not None and not reason:
                raise error.after(self.t) if isinstance(error, ProjectionError) else error
            names = self.names(self.closed)
            raise DivergedError(
                reason
                or f"the step shrinks to nothing at t = {self.t:.6g} s, where {', '.join(names) or 'no constraint'} "
                f"{'are' if len(names) > 1 else 'is'} closed: the forces are not smooth there"
            )
        return h * factor

    def _advance(self, step: RungeKuttaStep, end: float) -> None:
        """Move to the end of a step and remove the drift of closed contacts."""
        self.t, self.q, self.v = step.t + step.h, step.q, step.v
        if end - self.t < 1e-12 * max(1.0, abs(end)):
            self.t = end
        self.depth, self.residual, self.fallback = self.closing.depth, 0.0, None
        if self.closed.size:
            self.remove_drift()

    def _error(self, step: RungeKuttaStep) -> float:
        """Return the local error relative to the error that is allowed."""
        return largest_error(step.error, step.v, self.units) / (LOCAL * self.tolerance)

    def _crossing(self, first: Array, stops: bool) -> Crossing | None:
        """Return what falls through zero at an event: the gap of a row, or a slip; None if neither does."""
        if first.size:
            return partial(self.closing.gap_and_rate, first)
        if self.modes is not None and stops:
            return partial(self.modes.slip_and_rate, self.closed)
        return None

    def _cut(self, step: RungeKuttaStep, share: float, crossing: Crossing | None) -> RungeKuttaStep:
        """Return the part of a step up to where something falls through zero, by dense output and Newton's method."""
        for _ in range(_MOST_NEWTON if crossing is not None else 0):
            assert crossing is not None
            gap, rate, least = crossing(step.t + share * step.h, *step.at(self.system, share))
            if abs(gap) < least or rate >= 0.0 or not 0.0 < share * step.h - gap / rate <= _MOST_LATE * step.h:
                break
            share -= gap / rate / step.h
        cut = step.cut(self.system, share)
        if self._stop is None and not self.observed.active:
            # the acceleration at an event is not needed: other forces act after it
            return cut
        return cut._replace(a=self.flow.acceleration(cut.t + cut.h, cut.q, cut.v, self.closed))

    def _step_to_event(self, a: Array, h: float, crossing: Crossing | None, longest: float) -> RungeKuttaStep:
        """Return a step of about length h that ends where something falls through zero, by Newton's method.

        The error of a step of the length `longest` is known to be small.
        """
        step = self.flow.step(self.t, self.q, self.v, a, h, self.closed)
        for _ in range(_MOST_NEWTON if crossing is not None else 0):
            assert crossing is not None
            gap, rate, least = crossing(step.t + h, step.q, step.v)
            # where the gap touches zero without falling through, Newton's method is no better than the dense output
            if abs(gap) < least or rate >= 0.0 or not 0.0 < h - gap / rate <= _MOST_LATE * longest:
                break
            late = -gap / rate
            if abs(late) < _PARABOLA * h:
                step = step.prolonged(self.system, late)
                break
            h += late
            step = self.flow.step(self.t, self.q, self.v, a, h, self.closed)
        return self.flow.with_dense_output(step, self.closed)

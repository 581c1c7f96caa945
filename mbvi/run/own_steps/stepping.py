"""Steps of a `Simulator` by a scheme that chooses its own: as many as lead to the end of each step."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from ...constraints.contact import Contact
from ...problem import Problem
from ...projection import Projector
from ...results.contacts import ContactLog
from ...schemes import Adaptive, Centered, EventDriven, OwnStepsScheme, Step
from ...schemes.adaptive.integrator import Stride, Strike
from ...schemes.contact_friction import friction_of
from ...schemes.event_driven.impact_event import ImpactEvent
from ...schemes.event_driven.reactions import reactions
from ...schemes.observer import contacts_of_step
from ..recording.carried_rows import place_of_rows
from ..recording.recorder import SAME_POINT
from ..start import initial_step
from .adaptive_loop import guarded_integrator

# of a problem the projector for it
Projectors = Callable[[Problem], Projector]


class _AdaptiveSteps:
    """The steps of `Adaptive` from the initial state of a problem on.

    Attributes
    ----------
    integrator
        Has the present state.
    contacts : tuple of Contact
        Those of the law at the initial state.
    """

    def __init__(self, problem: Problem, scheme: Adaptive, projector: Projector) -> None:
        start, self._problem = initial_step(problem, projector), problem
        self.integrator, self._observe = guarded_integrator(problem, scheme, projector, start, None)
        self.contacts = contacts_of_step(start, 0.0, problem.constraints.name)

    def take(self, time: float, log: ContactLog) -> None:
        """Take steps for some time, and log their contacts."""
        for part in self.integrator.run(time):
            if isinstance(part, Stride) and self._observe is not None:
                self._observe(part.second, part.second.t - part.first.t)
            for before, step in _steps_of(part):
                rows, place = step.active, partial(place_of_rows, self._problem, Centered.timing, before, step)
                log.add(rows.constraint, rows.point, rows.normal, step.percussion, friction_of(step), place=place)


def _steps_of(part: Stride | Strike) -> tuple[tuple[Step, Step], ...]:
    """Return the steps of a part of a run, each with the state before it, an impact with its own."""
    if isinstance(part, Strike):
        return ((part.step, part.step),)
    start = part.first._replace(t=part.t0, q=part.q0, v=part.v0)
    return (start, part.first), (part.first, part.second)


class _EventDrivenSteps:
    """The steps of `EventDriven`; see `_AdaptiveSteps`."""

    def __init__(self, problem: Problem, scheme: EventDriven, projector: Projector) -> None:
        problem.constraints.renew()
        self.integrator = scheme.integrator(problem, projector)
        self.contacts: tuple[Contact, ...] = ()
        for part in self.integrator.run(0.0):
            assert isinstance(part, ImpactEvent)
            self.contacts = self.integrator.observed.of_impact(part)()

    def take(self, time: float, log: ContactLog) -> None:
        """Take steps for some time, and log their contacts."""
        for part in self.integrator.run(time):
            if isinstance(part, ImpactEvent):
                log.add(part.number, part.point, part.normal, part.rates[0], part.friction)
                continue
            for rows in reactions(self.integrator, part):
                log.add(*rows)


class OwnStepper:
    """Takes a problem from the end of one step to that of the next, by a scheme that chooses its own.

    Parameters
    ----------
    problem : Problem
        The problem.
    scheme : OwnStepsScheme
        The scheme.
    h : float
        Length of a step [s].
    projectors : callable
        Returns the projector for a problem.

    Attributes
    ----------
    q, v : ndarray
        The present state.
    done : int
        Number of the last step.
    contacts : tuple of Contact
        Those of the last step, or of the law at the initial state.
    """

    def __init__(self, problem: Problem, scheme: OwnStepsScheme, h: float, projectors: Projectors) -> None:
        self._scheme, self._h, self._projectors = scheme, h, projectors
        self.q, self.v = problem.q0.copy(), problem.v0.copy()

    def begin(self, problem: Problem, t0: float, done: int = 0) -> None:
        """Go to the initial state of a problem, the one after `done` steps from t0 on."""
        steps = self._started(problem)
        self._problem, self._t0, self.done = problem, t0, done
        # None after an error
        self._steps: _AdaptiveSteps | _EventDrivenSteps | None = steps
        self.contacts = steps.contacts
        self.q[:], self.v[:] = steps.integrator.q, steps.integrator.v

    def take(self, last: int) -> None:
        """Take one step."""
        problem, end = self._problem, self._t0 + (self.done + 1) * self._h
        # an integrator that has failed has gone on: the state before is begun from again
        steps, self._steps = self._steps, None
        if steps is None:
            steps = self._started(problem.at(self.q.copy(), self.v.copy(), self._t0 + self.done * self._h))
        frictional, resisting = problem.constraints.frictional, problem.constraints.resistance is not None
        # of `EventDriven` a contact that stays closed is one contact, however far it slides
        same = SAME_POINT * problem.length if isinstance(self._scheme, Adaptive) else np.inf
        log = ContactLog(same, frictional=frictional, resisting=resisting)
        log.constraints = problem.constraints
        steps.take(end - steps.integrator.t, log)
        log.close()
        steps.integrator.t, self.done, self._steps = end, self.done + 1, steps
        self.contacts = log.table(problem.constraints.name, 1).interval(0, self._h)
        self.q[:], self.v[:] = steps.integrator.q, steps.integrator.v

    def _started(self, problem: Problem) -> _AdaptiveSteps | _EventDrivenSteps:
        scheme, projector = self._scheme, self._projectors(problem)
        if isinstance(scheme, Adaptive):
            return _AdaptiveSteps(problem, scheme, projector)
        assert isinstance(scheme, EventDriven)
        return _EventDrivenSteps(problem, scheme, projector)

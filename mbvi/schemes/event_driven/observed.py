"""Passes the contacts of an event-driven run to the controls that read `state.contacts`."""

from __future__ import annotations

from functools import partial

import numpy as np

from ...problem import Problem
from ...system.system import Array
from ..contact_friction import ContactFriction
from ..observer import Contacts, contacts_of_rows, observer
from ..step import Step
from .impact_event import ImpactEvent
from .rows.contact_rows import SmoothRows
from .runge_kutta import RungeKuttaStep, least_percussion


class ContactObserver:
    """Passes smooth steps and impacts to the controls; does nothing where no control reads contacts.

    Parameters
    ----------
    problem : Problem
        The problem with its system.
    rows : SmoothRows
        The rows of its constraints.

    Attributes
    ----------
    active : bool
        Whether a control reads contacts.
    """

    def __init__(self, problem: Problem, rows: SmoothRows) -> None:
        self._observe, self._pass_on = problem.system.observe, observer(problem)
        self.active = self._observe is not None
        self._metric, self._rows, self._name = problem.system.metric, rows, problem.constraints.name

    def impact(self, event: ImpactEvent) -> ImpactEvent:
        """Pass on an impact; return it."""
        if self._observe is not None:
            self._observe(self.of_impact(event))
        return event

    def of_impact(self, event: ImpactEvent) -> Contacts:
        """Return a function that returns the contacts of an impact."""
        found = event.number, event.rates[0], event.point, event.normal
        return partial(contacts_of_rows, *found, 0.0, self._name, event.friction)

    def smooth_step(
        self, step: RungeKuttaStep, closed: Array, t: float, q: Array, known: tuple[Array, ContactFriction] | None
    ) -> None:
        """Pass on the contact forces at the end of a smooth step, at (t, q), as percussions over its length.

        With friction these are `known`, with that of the contacts.
        """
        if self._observe is not None and step.h > 0.0:
            self._observe(self.of_smooth_step(step, closed, t, q, known))

    def of_smooth_step(
        self, step: RungeKuttaStep, closed: Array, t: float, q: Array, known: tuple[Array, ContactFriction] | None
    ) -> Contacts:
        """Return a function that returns what `smooth_step` passes on."""
        if not closed.size:
            return tuple
        friction = None
        if known is not None:
            percussion, friction = known
        else:
            # accelerations at the end with and without contact forces, both computed before the control receives these
            kept, free = np.split(step.a, 2)
            J = self._rows.gradients(t, q, closed)
            percussion = step.h * least_percussion(J @ self._metric(q).solve_rows(J).T, J @ (kept - free))
        number, (point, normal) = self._rows.number[closed], self._rows.points(t, q, closed)
        return partial(contacts_of_rows, number, percussion, point, normal, step.h, self._name, friction)

    def step(self, step: Step, h: float) -> None:
        """Pass on a step of `Paoli` of length h."""
        if self._pass_on is not None:
            self._pass_on(step, h)

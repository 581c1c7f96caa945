"""Shows the contacts of an event-driven motion to a control that looks at them."""

from __future__ import annotations

from functools import partial

import numpy as np

from ...problem import Problem
from ...system.system import Array
from ..observer import contacts_of_rows, observer
from ..step import Step
from .contact_rows import SmoothRows
from .impact_event import ImpactEvent
from .runge_kutta import RungeKuttaStep, least_push


class ObservedIntegrator:
    """The smooth steps and impacts of a motion as a control sees them; nothing where there is no such control.

    Parameters
    ----------
    problem, rows
        What moves, and its constraints.

    Attributes
    ----------
    seen : bool
        Whether there is a control that looks at contacts.
    """

    def __init__(self, problem: Problem, rows: SmoothRows) -> None:
        self._observe, self._show = problem.system.observe, observer(problem)
        self.seen = self._observe is not None
        self._metric, self._rows, self._name = problem.system.metric, rows, problem.constraints.name

    def impact(self, struck: ImpactEvent) -> ImpactEvent:
        """Show an impact; return it."""
        if self._observe is not None:
            found = struck.number, struck.rates[0], struck.point, struck.normal
            self._observe(partial(contacts_of_rows, *found, 0.0, self._name))
        return struck

    def stride(self, stride: RungeKuttaStep, closed: Array, t: float, q: Array) -> None:
        """Show the closed contacts that press at the end of a smooth step, at (t, q), over its length."""
        if self._observe is None or not stride.h > 0.0:
            return
        if not closed.size:
            self._observe(tuple)
            return
        # the accelerations at the end, with the reactions and without, were worked out by the control as it was
        kept, free = np.split(stride.a, 2)
        J = self._rows.gradients(t, q, closed)
        press = least_push(J @ self._metric(q).solve_rows(J).T, J @ (kept - free))
        number, (point, normal) = self._rows.number[closed], self._rows.points(t, q, closed)
        self._observe(partial(contacts_of_rows, number, stride.h * press, point, normal, stride.h, self._name))

    def step(self, step: Step, h: float) -> None:
        """Show a step of length h of the paper's scheme."""
        if self._show is not None:
            self._show(step, h)

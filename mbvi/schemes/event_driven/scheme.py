"""Impacts located on the smooth motion between them, to a tolerance."""

from __future__ import annotations

from ...arguments.checks import between
from ...errors import UnsuitableError
from ...problem import Problem
from ...projection import Projector
from ..scheme import SchemeBase, Timing
from .integrator import EventDrivenIntegrator


class EventDriven(SchemeBase):
    """Error control on the smooth motion; impacts located on it, contacts that rest integrated with their reactions.

    Parameters
    ----------
    tolerance : float
        Bound aimed at for the error of configurations, in lengths of the scene (`Problem.length`) and radians, and of
        velocities, in their own unit and relative to the largest.

    Raises
    ------
    InputError
        If the tolerance is not between 1e-13 and 0.1.

    Notes
    -----
    Order 8 with embedded 5 and 3 (Dormand and Prince), in a chart of its own a step (Munthe-Kaas 1999). Restitution by
    the law (8) at each located instant, several constraints at once. Closed contacts keep their gap; which of them
    press and which release is decided by the complementarity problem of accelerations. A contact whose bounces would
    all take less time than the tolerance, or rise less than 1e-14 of the scene's length, is put to rest; where impacts
    on several constraints accumulate, single impacts are followed to their limit. Where polyhedra stay on each other,
    so that gradients jump, and where events follow each other without end, steps of 1e-4 s of `Paoli` go on, of order
    one, and the run says so. Where steps and events make no progress in time at all the run ends with `DivergedError`.
    """

    timing = Timing(own_steps=True)

    def __init__(self, tolerance: float = 1e-6) -> None:
        self.tolerance = between(tolerance, "tolerance", 1e-13, 0.1)

    def check(self, problem: Problem) -> None:
        """Raise `UnsuitableError` if walls move on their own."""
        if problem.constraints.moving:
            raise UnsuitableError(
                "EventDriven does not know walls that move on their own yet: take Paoli or another scheme"
            )

    def integrator(self, problem: Problem, projector: Projector) -> EventDrivenIntegrator:
        """Return an integrator at the problem's start; raise `UnsuitableError` if there are too many bodies."""
        return EventDrivenIntegrator(problem, self.tolerance, projector)

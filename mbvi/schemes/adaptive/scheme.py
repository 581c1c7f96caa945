"""The scheme that controls the error of `Centered` on any scene."""

from __future__ import annotations

from ...problem import Problem
from ...projection import Projector
from ..scheme import OwnStepsScheme
from ..step import Step
from .integrator import AdaptiveIntegrator, Passed, Stop


class Adaptive(OwnStepsScheme):
    """Take steps of `Centered(project_positions=True)` whose lengths follow from their error, on any scene.

    Parameters
    ----------
    tolerance : float
        Intended bound of the error: of configurations in lengths of the scene (`Problem.length`) and radians, of
        velocities in the same units per second, relative to the largest velocity where that is above 1. At less than
        1e-5 `EventDriven` costs less.

    Raises
    ------
    InputError
        If the tolerance is not between 1e-6 and 0.1.

    Notes
    -----
    Each step is taken once whole and once as two halves. Their difference bounds the error of the step, a fifth of the
    tolerance, and leads to a state of order two or more: in flight, and in contact while the same contacts are closed
    and the same of them stick. Other steps keep the state of the halves, of order one.

    A step within which a body lands ends at a hundredth of the tolerance above the contact, where the law (8) acts on
    all closed contacts at once. Contacts whose rebound is slower than a twentieth of the tolerance come to rest. A step
    within which a contact stops to slide ends there.

    Steps shorter than a tenth of the time in which bodies move by the tolerance are accepted as they are; where the
    same contacts are closed throughout, below a thousandth of that, because forces may be stiff. Many such steps in a
    row become longer; the run's notes count them, and say where the tolerance is not kept.
    """

    strictest = 1e-6
    # longest step [s]
    longest = 0.05

    def __init__(self, tolerance: float = 1e-3) -> None:
        super().__init__(tolerance)

    def integrator(
        self, problem: Problem, projector: Projector, start: Step, passed: Passed, stop: Stop | None = None
    ) -> AdaptiveIntegrator:
        """Return an integrator at the initial state of a run; see `AdaptiveIntegrator`."""
        return AdaptiveIntegrator(problem, self.tolerance, projector, start, passed, stop, self.longest)

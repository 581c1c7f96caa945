"""The event-driven scheme: error-controlled smooth motion with located impacts."""

from __future__ import annotations

from ...errors import UnsuitableError
from ...problem import Problem
from ...projection import Projector
from ..scheme import OwnStepsScheme, refuse_joint_friction
from .integrator import EventDrivenIntegrator, Stop


class EventDriven(OwnStepsScheme):
    """Integrate the smooth motion with error control, locate impacts, and keep resting contacts closed by their forces.

    Parameters
    ----------
    tolerance : float
        Intended bound of the error: of configurations in lengths of the scene (`Problem.length`) and radians, of
        velocities in the same units per second, relative to the largest velocity where that is above 1.

    Raises
    ------
    InputError
        If the tolerance is not between 1e-13 and 0.1.

    Notes
    -----
    Order 8 with embedded orders 5 and 3 (Dormand and Prince); each step has its own chart (Munthe-Kaas 1999). The law
    (8) applies at each located instant, to several constraints at once. The complementarity problem of accelerations
    decides which closed contacts stay closed and which are released.

    A contact is put to rest if all its bounces would last less time than the tolerance, or rise less than 1e-14 of the
    scene's length. Where impacts on several constraints accumulate, single impacts are followed to their limit.

    With Coulomb friction each closed contact sticks or slips: accelerations are those within the mode, and a stop, a
    load on the edge of the cone and a release end it. Coulomb's law on accelerations then decides on the next one.
    Contacts that depend on each other share their load as equally compliant ones.

    Torques of `PDControl`, springs and actuators that reach or leave a limit end a step, as times of a trajectory do:
    the estimate of the error does not see how their slopes jump.

    Polyhedra that stay on each other keep the rows of the vertices, faces and edges that touch; a change of these is an
    event. Where cylinders, ellipsoids or planar polyhedra rest on each other, so that gradients jump, where
    events follow each other without end, and where friction leaves accelerations open (Painlevé's configuration), the
    scheme takes steps of `Paoli` of 1e-4 s, of order one, and the run's notes say
    so. Where steps and events make no progress in time, the run ends with `DivergedError`.
    """

    strictest = 1e-13

    def __init__(self, tolerance: float = 1e-6) -> None:
        super().__init__(tolerance)

    def check(self, problem: Problem) -> None:
        """Raise `UnsuitableError` if walls move by themselves, or joints, torsion or rolling have friction."""
        refuse_joint_friction(problem, self)
        if problem.constraints.resistance is not None:
            raise UnsuitableError(
                "EventDriven has no torsional and rolling friction: take Centered(project_positions=True), Adaptive or "
                "another scheme"
            )
        if problem.constraints.moving:
            raise UnsuitableError(
                "EventDriven does not know walls that move on their own yet: take Paoli or another scheme"
            )

    def integrator(self, problem: Problem, projector: Projector, stop: Stop | None = None) -> EventDrivenIntegrator:
        """Return an integrator at the problem's start; raise `UnsuitableError` if there are too many bodies."""
        return EventDrivenIntegrator(problem, self.tolerance, projector, stop)

"""What every scheme provides: its options, the timing of its velocity jump, and one step."""

from __future__ import annotations

import inspect
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

from ..arguments import between
from ..errors import UnsuitableError
from ..problem import Problem
from ..projection import Projector
from ..system import System
from ..system.system import Array
from .step import Step


@dataclass(frozen=True)
class Timing:
    """Where in its step a scheme lets the velocity jump, and which step lengths it takes.

    Attributes
    ----------
    jump : float
        Share of the step after which the law is applied: before it the configuration moves with v_i, after it with
        v_{i+1}. 1 is the end of the step.
    whole_steps : bool
        Whether all steps of a run must be equally long. The last step then ends at or after the end of the run, and
        `Scheme.shortened` replaces `Scheme.step` where a step must be shorter.
    own_steps : bool
        Whether the scheme chooses the lengths of its steps, so that they end at impacts that it locates in time.
    coasts : bool
        Whether configurations move as `System.coast` says, and not along the retraction.
    """

    jump: float = 1.0
    whole_steps: bool = False
    own_steps: bool = False
    coasts: bool = False

    def place_of_law(self, system: System, q: Array, v: Array, h: float) -> Array:
        """Return where a step of length h from (q, v) applies the law, shape (nq,)."""
        time = self.jump * h
        if time == 0.0:
            return q
        return system.integrate(q, system.coast(v, time)[0] if self.coasts else time * v)


class SchemeBase:
    """Name, options and timing of a scheme. Options are attributes with the names of the constructor's parameters.

    Attributes
    ----------
    timing : Timing
        By default the law is applied at the end of a step.
    project_positions : bool
        Whether a step also projects positions.
    accepts_depth : bool
        Whether only the residual of its projections penetrates, so that a run may be given a depth instead.
    """

    timing: Timing = Timing()
    project_positions: bool = False
    accepts_depth: bool = False

    @property
    def name(self) -> str:
        """The name that results and files give."""
        return type(self).__name__

    def options(self) -> dict[str, Any]:
        """Return the constructor's arguments by name; they construct an equal scheme."""
        return {name: getattr(self, name) for name in inspect.signature(type(self)).parameters if hasattr(self, name)}

    def check(self, problem: Problem) -> None:
        """Raise `UnsuitableError` if the scheme cannot run the problem."""

    def __repr__(self) -> str:
        # switches that are off are left out
        shown = [f"{name}={value!r}" for name, value in self.options().items() if value is not False]
        return f"{type(self).__name__}({', '.join(shown)})"

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and isinstance(other, SchemeBase) and self.options() == other.options()

    def __hash__(self) -> int:
        return hash((type(self), *self.options().items()))


class OwnStepsScheme(SchemeBase):
    """A scheme that chooses the lengths of its steps, and is given a tolerance instead.

    Attributes
    ----------
    strictest : float
        The least tolerance.
    """

    timing = Timing(own_steps=True)
    strictest: float

    def __init__(self, tolerance: float) -> None:
        self.tolerance = between(tolerance, "tolerance", self.strictest, 0.1)


class Scheme(SchemeBase, ABC):
    """A scheme of fixed steps: advances a problem by one step of a given length.

    Attributes
    ----------
    step_kernel : callable or None
        The same step as a kernel, with which the compiled loop takes it; see `run.kernel_scheme.KernelScheme`.
    """

    step_kernel: Any = None

    @abstractmethod
    def step(self, problem: Problem, t: float, q: Array, v: Array, h: float, projector: Projector) -> Step:
        """Return the state at t + h.

        Parameters
        ----------
        problem : Problem
            System, admissible set and restitution.
        t : float
            Time [s].
        q : ndarray, shape (nq,)
            Configuration.
        v : ndarray, shape (nv,)
            Velocity.
        h : float
            Time step [s].
        projector : Projector
            Solves the projections and keeps its solvers between steps.
        """

    def shortened(self, problem: Problem, t: float, state: Step, h: float, projector: Projector) -> Step:
        """Return the state at t + h, where h differs from the length of the step that led to `state`."""
        return self.step(problem, t, state.q, state.v, h, projector)


def refuse_joint_friction(problem: Problem, scheme: SchemeBase) -> None:
    """Raise `UnsuitableError` if joints of a problem have dry friction."""
    if problem.system.has_joint_friction:
        raise UnsuitableError(
            f"{scheme!r} has no dry friction of joints: take Centered(project_positions=True), StewartTrinkle, "
            "MoreauJean or Paoli, or leave it out by joint_friction=False, of a hinge by friction=0"
        )


def refuse_friction(problem: Problem, scheme: SchemeBase, why: str) -> None:
    """Raise `UnsuitableError` if a problem has friction, for a scheme that has no law of friction."""
    refuse_joint_friction(problem, scheme)
    if problem.constraints.frictional:
        raise UnsuitableError(
            f"{scheme!r} has no friction, because {why}: take Centered(project_positions=True), StewartTrinkle, "
            "MoreauJean or Paoli"
        )

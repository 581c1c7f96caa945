"""Errors and warnings of mbvi. Every message says what was wrong and what to do."""

from __future__ import annotations

from typing import Any

__all__ = [
    "DivergedError",
    "InadmissibleStartError",
    "InfeasibleError",
    "InputError",
    "MbviError",
    "MbviWarning",
    "ProjectionError",
    "SensitivityError",
    "TrajectoryFileError",
    "UnsuitableError",
    "UrdfError",
]


class MbviError(Exception):
    """Any error raised by mbvi.

    Attributes
    ----------
    run : Trajectory or None
        The run so far, where the error ended a simulation or the writing of a file.
    """

    # of type Any because this module imports no other
    run: Any = None


class MbviWarning(UserWarning):
    """A result is not covered by the theory; the run goes on and records a note."""


class InputError(MbviError, ValueError):
    """An argument has a wrong type, shape or value, or an unknown name."""


class UnsuitableError(InputError):
    """A scheme cannot run the problem that it was given."""


class UrdfError(MbviError):
    """A robot description cannot be read or describes no physical mechanism."""


class MjcfError(MbviError):
    """A MJCF cannot be read, or nothing in it can move."""


class InadmissibleStartError(MbviError):
    """The initial configuration is not in K: some gap is negative."""


class DivergedError(MbviError):
    """A step produced numbers that are not finite, or the integration makes no progress in time.

    Attributes
    ----------
    returned : bool
        Whether a function of the user returned what is not finite, from a finite state.
    """

    returned = False


class SensitivityError(MbviError):
    """A motion has no derivative, or mbvi does not know it.

    Attributes
    ----------
    time : float
        When that is found [s].
    bodies : tuple of str
        The constraints that are involved, by the names of impacts: "ball | floor".
    reason : str
        Why.
    """

    def __init__(self, reason: str, time: float, bodies: tuple[str, ...] = ()) -> None:
        who = f", {', '.join(bodies[:5])}{' and others' if len(bodies) > 5 else ''}" if bodies else ""
        super().__init__(f"no derivative at t = {time:.9g} s{who}: {reason}")
        self.time = time
        self.bodies = bodies
        self.reason = reason


class TrajectoryFileError(MbviError):
    """A trajectory file cannot be written or read."""


class ProjectionError(MbviError):
    """A projection did not reach its residual.

    Attributes
    ----------
    problem : dict
        The projection: `x` shape (nv,), `M` shape (nv, nv) or a metric, `J` shape (m, nv), `lower` shape (m,).
    residual : float
        The relative KKT residual that was reached.
    constraint : int or None
        The number of the constraint whose row is farthest from a solution, where that is known.
    """

    def __init__(
        self, message: str, problem: dict[str, Any], residual: float = float("nan"), constraint: int | None = None
    ) -> None:
        super().__init__(message)
        self.problem = problem
        self.residual = residual
        self.constraint = constraint

    def after(self, t: float) -> ProjectionError:
        """Return the same error with the time from which the step was taken."""
        return type(self)(f"after t = {t:.6g} s: {self}", self.problem, self.residual, self.constraint)


class InfeasibleError(ProjectionError):
    """No velocity satisfies the constraints J w >= lower."""

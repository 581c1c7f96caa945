"""What can go wrong: every error says what was wrong and what to do."""

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

    # not typed as such: errors lie below everything else
    run: Any = None


class MbviWarning(UserWarning):
    """Something the theory does not promise happened; the run goes on and says so."""


class InputError(MbviError, ValueError):
    """An argument is not what the function takes: value, shape, unknown name."""


class UnsuitableError(InputError):
    """A scheme is not made for the problem that it was given."""


class UrdfError(MbviError):
    """A robot description cannot be read or describes no physical mechanism."""


class InadmissibleStartError(MbviError):
    """The initial configuration is not in K: some gap is negative."""


class DivergedError(MbviError):
    """A step produced numbers that are not finite, or no progress in time is made."""


class TrajectoryFileError(MbviError):
    """A trajectory file cannot be written or read."""


class ProjectionError(MbviError):
    """A projection did not reach its residual.

    Attributes
    ----------
    problem : dict
        What was to be solved: `x` shape (nv,), `M` shape (nv, nv) or a metric, `J` shape (m, nv), `lower` shape (m,).
    residual : float
        The relative KKT residual that was reached.
    """

    def __init__(self, message: str, problem: dict[str, Any], residual: float = float("nan")) -> None:
        super().__init__(message)
        self.problem = problem
        self.residual = residual


class InfeasibleError(ProjectionError):
    """No velocity meets the constraints J w >= lower."""

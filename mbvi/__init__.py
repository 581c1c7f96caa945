"""Rigid multibody systems with impacts: perfect unilateral constraints, Newton restitution, several impacts at once."""

from .constraints import GapFunction
from .errors import (
    DivergedError,
    InadmissibleStartError,
    InfeasibleError,
    InputError,
    MbviError,
    MbviWarning,
    ProjectionError,
    TrajectoryFileError,
    UrdfError,
)
from .problem import Problem
from .projection import Projection, impact, project
from .scene import Scene
from .schemes import Paoli
from .simulate import simulate, steps
from .system import LagrangianSystem
from .trajectory import Impact, Trajectory
from .trajectory_file import load

__version__ = "0.1.0"

__all__ = [
    "DivergedError",
    "GapFunction",
    "Impact",
    "InadmissibleStartError",
    "InfeasibleError",
    "InputError",
    "LagrangianSystem",
    "MbviError",
    "MbviWarning",
    "Paoli",
    "Problem",
    "Projection",
    "ProjectionError",
    "Scene",
    "Trajectory",
    "TrajectoryFileError",
    "UrdfError",
    "impact",
    "load",
    "project",
    "simulate",
    "steps",
]

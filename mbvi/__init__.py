"""Rigid multibody systems with impacts: perfect unilateral constraints, Newton restitution, several impacts at once."""

from . import motion, packing, reference, surfaces
from .constraints import GapFunction
from .diagnosis import Diagnosis
from .errors import (
    DivergedError,
    InadmissibleStartError,
    InfeasibleError,
    InputError,
    MbviError,
    MbviWarning,
    ProjectionError,
    TrajectoryFileError,
    UnsuitableError,
    UrdfError,
)
from .problem import Problem
from .projection import Forks, Projection, forks, impact, project
from .scene import REDUCTIONS, Scene
from .schemes import Centered, EventDriven, MoreauJean, Paoli, SchatzmanPaoli, StewartTrinkle
from .simulate import simulate, steps
from .system import LagrangianSystem
from .trajectory import Impact, Trajectory
from .trajectory_file import load

__version__ = "0.1.0"

__all__ = [
    "REDUCTIONS",
    "Centered",
    "Diagnosis",
    "DivergedError",
    "EventDriven",
    "Forks",
    "GapFunction",
    "Impact",
    "InadmissibleStartError",
    "InfeasibleError",
    "InputError",
    "LagrangianSystem",
    "MbviError",
    "MbviWarning",
    "MoreauJean",
    "Paoli",
    "Problem",
    "Projection",
    "ProjectionError",
    "Scene",
    "SchatzmanPaoli",
    "StewartTrinkle",
    "Trajectory",
    "TrajectoryFileError",
    "UnsuitableError",
    "UrdfError",
    "forks",
    "impact",
    "load",
    "motion",
    "packing",
    "project",
    "reference",
    "simulate",
    "steps",
    "surfaces",
]

"""Rigid multibody systems with impacts: perfect unilateral constraints, Newton restitution, several impacts at once."""

import sys

from . import packing, reference
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
    UnsuitableError,
    UrdfError,
)
from .geometry import motion, surfaces
from .impacts import Forks, forks
from .problem import Problem
from .projection import ActiveSet, DualActiveSet, Projection, ProxQP, SparsePCG, impact, project
from .results import Diagnosis, Impact, Trajectory, load
from .run.simulate import simulate, steps
from .scene import REDUCTIONS, Scene
from .schemes import Centered, EventDriven, MoreauJean, Paoli, SchatzmanPaoli, StewartTrinkle
from .sweeps import plot_sweep, replay, sweep
from .system import LagrangianSystem

# both are public modules: `import mbvi.motion` works as well
sys.modules[f"{__name__}.motion"] = motion
sys.modules[f"{__name__}.surfaces"] = surfaces

__version__ = "0.1.0"

__all__ = [
    "REDUCTIONS",
    "ActiveSet",
    "Centered",
    "Diagnosis",
    "DivergedError",
    "DualActiveSet",
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
    "ProxQP",
    "Scene",
    "SchatzmanPaoli",
    "SparsePCG",
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
    "plot_sweep",
    "project",
    "reference",
    "replay",
    "simulate",
    "steps",
    "surfaces",
    "sweep",
]

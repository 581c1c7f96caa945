"""Rigid multibody systems with impacts: perfect unilateral constraints, Newton restitution, several impacts at once."""

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

from .errors import (
    DivergedError,
    InadmissibleStartError,
    InfeasibleError,
    InputError,
    MbviError,
    MbviWarning,
    MjcfError,
    ProjectionError,
    SensitivityError,
    TrajectoryFileError,
    UnsuitableError,
    UrdfError,
)
from .geometry import motion, surfaces

if TYPE_CHECKING:
    from . import interop, packing, reference
    from .constraints import GapFunction
    from .derivatives import (
        Gradient,
        OneSidedSensitivity,
        Sensitivity,
        SensitivityBranch,
        SensitivityCheck,
        gradient,
        sensitivity,
    )
    from .impacts import Forks, forks
    from .problem import Problem
    from .projection import DualActiveSet, Projection, ProxQP, SparsePCG, impact, project
    from .results import Diagnosis, ErrorEstimate, Impact, Trajectory, load
    from .run.rollouts.rollout import Rollouts, rollout
    from .run.rollouts.rollout_job import RolloutStatus
    from .run.simulate import simulate, steps
    from .run.simulator import Simulator
    from .scene import REDUCTIONS, Scene
    from .scene.urdf.shipped import robot
    from .schemes import Adaptive, Centered, EventDriven, MoreauJean, Paoli, SchatzmanPaoli, StewartTrinkle
    from .sweeps import plot_sweep, replay, sweep
    from .system import LagrangianSystem
    from .system.controls import CompiledControl, ConstantTorque, PDControl

# both are public modules: `import mbvi.motion` works as well
sys.modules[f"{__name__}.motion"] = motion
sys.modules[f"{__name__}.surfaces"] = surfaces

__version__ = "1.0.0rc1"

__all__ = [
    "REDUCTIONS",
    "Adaptive",
    "Centered",
    "CompiledControl",
    "ConstantTorque",
    "Diagnosis",
    "DivergedError",
    "DualActiveSet",
    "ErrorEstimate",
    "EventDriven",
    "Forks",
    "GapFunction",
    "Gradient",
    "Impact",
    "InadmissibleStartError",
    "InfeasibleError",
    "InputError",
    "LagrangianSystem",
    "MbviError",
    "MbviWarning",
    "MjcfError",
    "MoreauJean",
    "OneSidedSensitivity",
    "PDControl",
    "Paoli",
    "Problem",
    "Projection",
    "ProjectionError",
    "ProxQP",
    "RolloutStatus",
    "Rollouts",
    "Scene",
    "SchatzmanPaoli",
    "Sensitivity",
    "SensitivityBranch",
    "SensitivityCheck",
    "SensitivityError",
    "Simulator",
    "SparsePCG",
    "StewartTrinkle",
    "Trajectory",
    "TrajectoryFileError",
    "UnsuitableError",
    "UrdfError",
    "forks",
    "gradient",
    "impact",
    "interop",
    "load",
    "motion",
    "packing",
    "plot_sweep",
    "project",
    "reference",
    "replay",
    "robot",
    "rollout",
    "sensitivity",
    "simulate",
    "steps",
    "surfaces",
    "sweep",
]

# modules that are imported when one of their names is first used
_LATER = {
    ".constraints": "GapFunction",
    ".derivatives": "Gradient OneSidedSensitivity Sensitivity SensitivityBranch SensitivityCheck gradient sensitivity",
    ".impacts": "Forks forks",
    ".problem": "Problem",
    ".projection": "DualActiveSet Projection ProxQP SparsePCG impact project",
    ".results": "Diagnosis ErrorEstimate Impact Trajectory",
    ".run.loading": "load",
    ".run.rollouts.rollout": "Rollouts rollout",
    ".run.rollouts.rollout_job": "RolloutStatus",
    ".run.simulate": "simulate steps",
    ".run.simulator": "Simulator",
    ".scene": "REDUCTIONS Scene",
    ".scene.urdf.shipped": "robot",
    ".schemes": "Adaptive Centered EventDriven MoreauJean Paoli SchatzmanPaoli StewartTrinkle",
    ".sweeps": "plot_sweep replay sweep",
    ".system": "LagrangianSystem",
    ".system.controls": "CompiledControl ConstantTorque PDControl",
}
_MODULE_OF = {name: module for module, names in _LATER.items() for name in names.split()}


def __getattr__(name: str) -> Any:
    if name in ("interop", "packing", "reference"):
        return import_module(f".{name}", __name__)
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = globals()[name] = getattr(import_module(_MODULE_OF[name], __name__), name)
    return found


def __dir__() -> list[str]:
    return [*__all__, "__version__"]

"""Derivatives of runs with located impacts."""

from .check import SensitivityCheck
from .gradient import Gradient, gradient
from .one_sided import OneSidedSensitivity, SensitivityBranch
from .sensitivity import Sensitivity, sensitivity

__all__ = [
    "Gradient",
    "OneSidedSensitivity",
    "Sensitivity",
    "SensitivityBranch",
    "SensitivityCheck",
    "gradient",
    "sensitivity",
]

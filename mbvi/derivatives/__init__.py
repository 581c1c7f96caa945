"""Derivatives of runs with located impacts."""

from .check import SensitivityCheck
from .gradient import Gradient, gradient
from .sensitivity import Sensitivity, sensitivity

__all__ = ["Gradient", "Sensitivity", "SensitivityCheck", "gradient", "sensitivity"]

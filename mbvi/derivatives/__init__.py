"""Derivatives of runs with located impacts."""

from .check import SensitivityCheck
from .sensitivity import Sensitivity, sensitivity

__all__ = ["Sensitivity", "SensitivityCheck", "sensitivity"]

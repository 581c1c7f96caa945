"""Schemes: one file each, no physics inside."""

from .paoli import Paoli
from .step import Scheme, Step

__all__ = ["Paoli", "Scheme", "Step"]

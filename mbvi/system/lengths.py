"""The unit of each velocity, so that no result depends on the unit of lengths."""

from __future__ import annotations

import numpy as np

from .system import Array, System


def velocity_units(system: System, length: float) -> Array:
    """Return the unit of each velocity: the scene's length where it is that of a length, 1 rad for the others."""
    return np.where(system.are_lengths(), length, 1.0)

"""Several impacts at once: kinetic angles, condition (12), and the forks where the order of impacts matters."""

from .angles import condition_12_violation, cosines_between, independent, islands, unit_gradients
from .forks import Forks, follow, forks

__all__ = [
    "Forks",
    "condition_12_violation",
    "cosines_between",
    "follow",
    "forks",
    "independent",
    "islands",
    "unit_gradients",
]

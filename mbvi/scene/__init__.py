"""What a user writes: robots, bodies, walls and their restitution, assembled to a Problem of what they need."""

from .reductions import REDUCTIONS
from .scene import Scene

__all__ = ["REDUCTIONS", "Scene"]

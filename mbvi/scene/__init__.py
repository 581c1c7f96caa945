"""Scenes: robots, bodies, walls and their restitution, from which a Problem is built."""

from .reductions import REDUCTIONS
from .scene import Scene

__all__ = ["REDUCTIONS", "Scene"]

"""Mechanical systems: mass matrix M(q), forces g(t, q, v), and the retraction q + h v of their configurations."""

from .actuated import ActuatedSystem, located_parts, parts_of
from .articulated import ArticulatedSystem
from .blocks import BlockSystem
from .bodies import FreeBodies, Spheres
from .lagrangian import LagrangianSystem
from .planar import PlanarBodies, PlanarSpheres
from .system import System

__all__ = [
    "ActuatedSystem",
    "ArticulatedSystem",
    "BlockSystem",
    "FreeBodies",
    "LagrangianSystem",
    "PlanarBodies",
    "PlanarSpheres",
    "Spheres",
    "System",
    "located_parts",
    "parts_of",
]

"""Mechanical systems: mass matrix M(q), forces g(t, q, v), and the retraction q + h v of their configurations."""

from .actuated import ActuatedSystem
from .blocks import BlockSystem
from .connected import ConnectedSystem, with_parts
from .free.bodies import FreeBodies, Spheres
from .free.planar import PlanarBodies, PlanarSpheres
from .given_system import checked_system
from .hinged import HingedSystem
from .lagrangian import LagrangianSystem
from .mechanisms.articulated import ArticulatedSystem
from .parts import independent_parts, parts_of
from .system import System, located_parts

__all__ = [
    "ActuatedSystem",
    "ArticulatedSystem",
    "BlockSystem",
    "ConnectedSystem",
    "FreeBodies",
    "HingedSystem",
    "LagrangianSystem",
    "PlanarBodies",
    "PlanarSpheres",
    "Spheres",
    "System",
    "checked_system",
    "independent_parts",
    "located_parts",
    "parts_of",
    "with_parts",
]

"""Unilateral constraints f(q) >= 0 and their gradients, independent of time steps and solvers."""

from .admissible_set import AdmissibleSet
from .broad_phase import BroadPhasePairs
from .family import ConstraintFamily, RowTable
from .gap_function import GapFunction
from .half_space import HalfSpaceContacts
from .joint_limit import JointLimits
from .moving import MovingFrame, MovingWalls
from .rows import Constraint, Rows
from .signed_distance import SignedDistances
from .sphere_centres import SphereCentres
from .sphere_surface import SphereSurface
from .sphere_walls import SphereWalls
from .spheres import SphereContacts

__all__ = [
    "AdmissibleSet",
    "BroadPhasePairs",
    "Constraint",
    "ConstraintFamily",
    "GapFunction",
    "HalfSpaceContacts",
    "JointLimits",
    "MovingFrame",
    "MovingWalls",
    "RowTable",
    "Rows",
    "SignedDistances",
    "SphereCentres",
    "SphereContacts",
    "SphereSurface",
    "SphereWalls",
]

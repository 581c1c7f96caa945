"""Unilateral constraints f(q) >= 0 and their gradients, independent of time steps and solvers."""

from .admissible_set import AdmissibleSet
from .families.broad_phase import BroadPhasePairs
from .families.gap_function import GapFunction
from .families.half_space import HalfSpaceContacts
from .families.hinge_limit import HingeLimits
from .families.joint_limit import JointLimits
from .families.moving import MovingFrame, MovingWalls
from .families.shape_surface import ShapeSurface
from .families.signed_distance import SignedDistances
from .families.sphere_walls import SphereWalls
from .families.spheres import SphereCentres, SphereContacts
from .families.surface import SphereSurface
from .family import ConstraintFamily
from .row_table import RowTable
from .rows import Constraint, Rows

__all__ = [
    "AdmissibleSet",
    "BroadPhasePairs",
    "Constraint",
    "ConstraintFamily",
    "GapFunction",
    "HalfSpaceContacts",
    "HingeLimits",
    "JointLimits",
    "MovingFrame",
    "MovingWalls",
    "RowTable",
    "Rows",
    "ShapeSurface",
    "SignedDistances",
    "SphereCentres",
    "SphereContacts",
    "SphereSurface",
    "SphereWalls",
]

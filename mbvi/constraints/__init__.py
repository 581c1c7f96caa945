"""Unilateral constraints f(q) >= 0 and their gradients: they know no time step."""

from .active import Constraint, Rows
from .admissible_set import AdmissibleSet
from .crowd import Crowd
from .gap_function import GapFunction
from .half_space import HalfSpaceContacts
from .joint_limit import JointLimits
from .moving import MovingWalls, SeenFrom
from .signed_distance import SignedDistances
from .smooth import SmoothRows
from .sphere_surface import SphereSurface
from .sphere_walls import SphereWalls
from .spheres import SphereContacts
from .triangles import Surface

__all__ = [
    "AdmissibleSet",
    "Constraint",
    "Crowd",
    "GapFunction",
    "HalfSpaceContacts",
    "JointLimits",
    "MovingWalls",
    "Rows",
    "SeenFrom",
    "SignedDistances",
    "SmoothRows",
    "SphereContacts",
    "SphereSurface",
    "SphereWalls",
    "Surface",
]

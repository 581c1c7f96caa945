"""Initial positions of spheres: lattices, random packings, layers to be dropped, and poured beds.

Each function returns a `Packing`, positions and radii of spheres that do not overlap, as
`scene.add_spheres(*packing, density=2500.0)` expects them. The same seed gives the same bytes.
"""

from .poured import poured
from .random_loose import random_loose
from .sites import Packing, lattice, layers
from .sizes import lognormal, uniform

__all__ = ["Packing", "lattice", "layers", "lognormal", "poured", "random_loose", "uniform"]

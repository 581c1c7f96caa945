"""Where the grains of a scene start: lattices, random packings, layers to be dropped, and what has been poured.

Each function returns a `Packing`, positions and radii, that no two spheres of overlap, and
`scene.add_spheres(*packing, density=2500.0)` takes. The same seed gives the same bytes.
"""

from .poured import poured
from .random_loose import random_loose
from .sites import Packing, lattice, layers
from .sizes import lognormal, uniform

__all__ = ["Packing", "lattice", "layers", "lognormal", "poured", "random_loose", "uniform"]

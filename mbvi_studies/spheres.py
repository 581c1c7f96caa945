"""A cube of falling spheres, which charts, stress tests and benchmarks share."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mbvi import packing
from mbvi.scene import Scene

if TYPE_CHECKING:
    from mbvi.problem import Problem


def cube_of_spheres(e: float, half_width: float = 1.0) -> Problem:
    """Return 6 x 6 x 6 spheres that fall from 1 m into an open box.

    Radii are 0.1 m and masses 10 kg. Centres lie on a lattice with spacing 0.21 m and random displacements of up to
    1e-3 m; the lowest is at 1.101 m.

    Parameters
    ----------
    e : float
        Restitution.
    half_width : float
        Half width of the box, centred at the cube [m].
    """
    scene = Scene(restitution=e)
    scene.add_container((-half_width, -half_width, 0.0), (half_width, half_width), name="box")
    centres, radii = packing.lattice((6, 6, 6), 0.1, 0.21, (-0.525, -0.525, 0.0), jitter=1e-3, seed=42)
    centres[:, 2] += 1.101 - centres[:, 2].min()
    scene.add_spheres(centres, radii, 10.0)
    return scene.build()

"""Packings made by a simulated pouring into a box."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .sites import Packing, layers
from .sizes import Array, Size

# time step, in units of the time of a fall through a mean diameter; speed that counts as rest, in units of the speed
# after that fall
_POUR, _STILL = 0.03, 0.03
# residual of the projections: radii are made smaller by the penetration that it leaves
_RESIDUAL = 1e-6


def poured(
    lower: Sequence[float] | Array,
    upper: Sequence[float] | Array,
    radius: Size,
    count: int | None = None,
    seed: int = 0,
) -> Packing:
    """Return spheres that were poured into an open box and have come nearly to rest.

    Parameters
    ----------
    lower : array_like, shape (3,)
        Corner of the box's floor [m].
    upper : array_like, shape (2,) or (3,)
        Its opposite corner in x and y [m].
    radius, count, seed
        As in `layers`, whose positions are the start of the fall. Returned radii are smaller by the final overlap of
        spheres, about 1e-6 of the smallest.

    Raises
    ------
    InputError
        As in `layers`.
    ProjectionError
        If a step of the pouring does not converge.

    Notes
    -----
    Simulated by `StewartTrinkle` until the root mean square speed is a thirtieth of that after a fall through a
    diameter. Without friction a bed may slosh for long, so the simulation ends at the latest after ten times the time
    of the highest sphere's fall.
    """
    # imported here, because importing mbvi imports packings
    from ..run.simulate import steps
    from ..scene import Scene
    from ..schemes import StewartTrinkle

    loose = layers(lower, upper, radius, count, seed=seed)
    scene = Scene()
    scene.add_container(lower, upper)
    scene.add_spheres(*loose, density=1.0)
    problem, g = scene.build(), 9.81
    unit = float(np.sqrt(2.0 * loose.radii.mean() / g))
    fall = float(np.sqrt(2.0 * np.ptp(loose.positions[:, 2]) / g)) + unit
    for step in steps(problem, StewartTrinkle(), step=_POUR * unit, residual=_RESIDUAL):
        still = float(np.sqrt(3.0 * (step.v**2).mean())) < _STILL * g * unit
        if step.t > fall and (still or step.t > 10.0 * fall):
            break
    deepest = -float(problem.constraints.active(step.t, step.q, 0.0).gap.min(initial=0.0))
    smallest = float(loose.radii.min())
    shrunk = loose.radii * (1.0 - deepest / smallest) if deepest > 0.0 else loose.radii
    return Packing(step.q.reshape(-1, 3).copy(), shrunk)

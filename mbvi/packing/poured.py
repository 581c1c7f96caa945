"""Spheres that were poured into a box."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .sites import Packing, layers
from .sizes import Array, Size

# step of a pouring, in times of a fall through a mean diameter, and the speed that counts as rest, in speeds of it
_POUR, _STILL = 0.03, 0.03


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
        As of `layers`, which fall from where these put them. The radii that come back are smaller by what spheres
        overlap in the end, some 1e-6 of the smallest.

    Raises
    ------
    InputError
        As `layers`.
    ProjectionError
        If a step of the pouring does not converge.

    Notes
    -----
    Simulated by `StewartTrinkle` until the root mean square speed is a thirtieth of that of a fall through a diameter,
    or ten times the time of the highest sphere's fall is over: without friction the last of it may slosh for long.
    """
    # only here, for packings are imported with the package
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
    for step in steps(problem, StewartTrinkle(), step=_POUR * unit):
        still = float(np.sqrt(3.0 * (step.v**2).mean())) < _STILL * g * unit
        if step.t > fall and (still or step.t > 10.0 * fall):
            break
    deepest = -float(problem.constraints.near(step.t, step.q, 0.0).gap.min(initial=0.0))
    smallest = float(loose.radii.min())
    shrunk = loose.radii * (1.0 - deepest / smallest) if deepest > 0.0 else loose.radii
    return Packing(step.q.reshape(-1, 3).copy(), shrunk)

"""Which velocities turn bodies about axes that change: they bound how long a step may be."""

from __future__ import annotations

import numpy as np

from ...system import System
from ...system.free.bodies import FreeBodies
from ...system.free.planar import PlanarBodies
from ...system.system import Array


def turning_columns(system: System) -> Array:
    """Return the indices in v of angular velocities about axes that change, shape (n, 3); nv where there is none.

    They are those of free bodies, and of joints with several rotations or with one about an axis that moves.
    """
    found: list[Array] = []
    for part in system.located_parts():
        bodies = part.system
        if isinstance(bodies, FreeBodies) and not isinstance(bodies, PlanarBodies):
            found += [part.v + 6 * k + np.arange(3, 6) for k in range(bodies.independent_bodies)]
        elif bodies.model is not None:
            for joint in list(bodies.model.joints)[1:]:
                first = part.v + joint.idx_v
                if joint.shortname() == "JointModelPlanar":
                    found.append(np.array([first + 2, system.nv, system.nv]))
                elif joint.nv in (3, 6) and joint.nq > joint.nv:
                    found.append(first + joint.nv - 3 + np.arange(3))
    return np.array(found, np.int64).reshape(-1, 3)

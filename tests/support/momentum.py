"""Momentum and angular momentum of a problem in the world, from nothing but poses, masses and velocities."""

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from mbvi.system.free.bodies import FreeBodies, Spheres


def momentum(problem, q, v):
    """Return the momentum, the angular momentum about the origin, shapes (3,), and the sizes that both have in parts.

    The sizes are sums over bodies of |m u|, and of |x x m u| and |I w|.
    """
    P, L, size, turning = np.zeros(3), np.zeros(3), 0.0, 0.0
    for part in problem.system.located_parts():
        system = part.system
        own_q, own_v = q[part.q : part.q + system.nq], v[part.v : part.v + system.nv]
        for p, arm, spin in _robot(system, own_q, own_v) if system.model is not None else _bodies(system, own_q, own_v):
            P, L = P + p, L + np.cross(arm, p) + spin
            size += np.linalg.norm(p)
            turning += np.linalg.norm(np.cross(arm, p)) + np.linalg.norm(spin)
    return P, L, size, turning


def _robot(system, q, v):
    data = system.model.createData()
    pin.computeCentroidalMomentum(system.model, data, q, v)
    yield data.hg.linear, data.com[0], data.hg.angular


def _bodies(system, q, v):
    assert type(system) in (FreeBodies, Spheres)
    for k, mass in enumerate(system.masses):
        if type(system) is Spheres:
            yield mass * v[3 * k : 3 * k + 3], q[3 * k : 3 * k + 3], np.zeros(3)
        else:
            R = Rotation.from_quat(q[7 * k + 3 : 7 * k + 7].copy()).as_matrix()
            spin = R @ system.inertias[k] @ v[6 * k + 3 : 6 * k + 6]
            yield mass * v[6 * k : 6 * k + 3], q[7 * k : 7 * k + 3], spin

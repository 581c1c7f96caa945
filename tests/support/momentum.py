"""Momentum and angular momentum of a problem in the world, from nothing but poses, masses and velocities."""

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

from mbvi.system.free.bodies import FreeBodies, Spheres
from mbvi.system.free.planar import PlanarBodies, PlanarSpheres


def momentum(problem, q, v):
    """Return the momentum, the angular momentum about the origin, shapes (3,), and the sizes that both have in parts.

    The sizes are sums over bodies of |m u|, and of |x x m u| and |I w|.
    """
    P, L, size, turning = np.zeros(3), np.zeros(3), 0.0, 0.0
    for one in momenta(problem, q, v):
        _, p, arm, spin = np.split(one, [1, 4, 7])
        P, L = P + p, L + np.cross(arm, p) + spin
        size += np.linalg.norm(p)
        turning += np.linalg.norm(np.cross(arm, p)) + np.linalg.norm(spin)
    return P, L, size, turning


def momenta(problem, q, v):
    """Return the mass, the momentum, the centre and the spin of each body, and of each robot as a whole, (n, 10)."""
    found = []
    for part in problem.system.located_parts():
        system = part.system
        own_q, own_v = q[part.q : part.q + system.nq], v[part.v : part.v + system.nv]
        of_part = _robot if system.model is not None else _bodies
        found += [np.concatenate([[mass], *vectors]) for mass, *vectors in of_part(system, own_q, own_v)]
    return np.array(found)


def _robot(system, q, v):
    data = system.model.createData()
    pin.computeCentroidalMomentum(system.model, data, q, v)
    yield sum(inertia.mass for inertia in system.model.inertias), data.hg.linear, data.com[0], data.hg.angular


def _bodies(system, q, v):
    assert type(system) in (FreeBodies, Spheres, PlanarBodies, PlanarSpheres)
    turns = isinstance(system, FreeBodies)
    places, speeds = q.reshape(len(system.masses), -1), v.reshape(len(system.masses), -1)
    if type(system) in (PlanarBodies, PlanarSpheres):
        # along the two axes of the world in the plane, in their order, and about its normal in the body's axes
        flat, speeds = speeds, np.zeros((len(speeds), 6 if turns else 3))
        speeds[:, np.flatnonzero(np.abs(system.axes[2]) < 0.5)] = flat[:, :2]
        speeds[:, 3:] = flat[:, 2:] * system.normals if turns else 0.0
    for k, mass in enumerate(system.masses):
        spin = np.zeros(3)
        if turns:
            R = Rotation.from_quat(places[k, 3:].copy()).as_matrix()
            spin = R @ system.inertias[k] @ speeds[k, 3:]
        yield mass, mass * speeds[k, :3], places[k, :3], spin

"""Spheres in a box in MuJoCo, with its conjugate gradient solver and default contacts: for benchmarks of speed."""

from __future__ import annotations

import mujoco
import numpy as np

from ...arguments import Array

# memory of the largest pile [bytes]
_MEMORY = 8 << 30


def spheres_in_box(centres: Array, radius: float, width: float, h: float) -> mujoco.MjModel:
    """Return spheres of 1 kg, each on three slide joints, in an open box from the origin to (width, width).

    Parameters
    ----------
    centres : ndarray, shape (n, 3)
        Their positions [m]; coordinates of the model are displacements from these.
    radius, width : float
        Of the spheres and of the box [m].
    h : float
        Time step [s].
    """
    spec = mujoco.MjSpec()
    spec.option.timestep, spec.option.solver = h, mujoco.mjtSolver.mjSOL_CG
    spec.memory = _MEMORY
    walls = [(np.zeros(3), np.array([0.0, 0.0, 1.0]))]
    for axis in np.eye(3)[:2]:
        walls += [(np.zeros(3), axis), (width * axis, -axis)]
    for place, normal in walls:
        turn = np.zeros(4)
        mujoco.mju_quatZ2Vec(turn, normal)
        plane = mujoco.mjtGeom.mjGEOM_PLANE
        spec.worldbody.add_geom(type=plane, pos=place, size=[0, 0, 1], condim=1, quat=turn)
    for centre in centres:
        body = spec.worldbody.add_body(pos=centre)
        for axis in np.eye(3):
            body.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[radius, 0, 0], mass=1.0, condim=1)
    return spec.compile()

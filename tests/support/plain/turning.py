"""Plain numpy forms of the kernels in mbvi/system/turning.py."""

from __future__ import annotations

import numpy as np

from mbvi.arguments import Array
from mbvi.geometry.rotations import chart_rate, compose, exp, matrices


def moved_plain(q: Array, dv: Array, new: Array) -> None:
    """Write where a tangent vector leads: centres straight on, rotations about a fixed axis.

    Parameters
    ----------
    q, dv : ndarray, shapes (7 n,) and (6 n,)
        Centres and quaternions; the tangent vector.
    new : ndarray, shape (7 n,)
        Receives what `q` is after it, quaternions of unit length.
    """
    old, step, out = q.reshape(-1, 7), dv.reshape(-1, 6), new.reshape(-1, 7)
    out[:, :3] = old[:, :3] + step[:, :3]
    turned = compose(old[:, 3:], exp(step[:, 3:]))
    out[:, 3:] = turned / np.sqrt(np.einsum("ij,ij->i", turned, turned))[:, None]


def chart_rates_plain(dv: Array, v: Array, rate: Array) -> None:
    """Write how fast tangent vectors change along a motion.

    Parameters
    ----------
    dv, v : ndarray, shape (6 n,)
        Where the motion is, as a tangent vector from a configuration that stays; its velocity.
    rate : ndarray, shape (6 n,)
        Receives d(dv)/dt.
    """
    out, here = rate.reshape(-1, 6), v.reshape(-1, 6)
    out[:, :3] = here[:, :3]
    out[:, 3:] = chart_rate(dv.reshape(-1, 6)[:, 3:], here[:, 3:])


def accelerations_plain(v: Array, pull: Array, inertias: Array, inverses: Array, out: Array) -> None:
    """Write the accelerations of bodies that nothing touches.

    Parameters
    ----------
    v : ndarray, shape (6 n,)
        Velocities of the centres in the world, spins in the bodies.
    pull : ndarray, shape (n, 3)
        Accelerations of the centres [m/s^2].
    inertias, inverses : ndarray, shape (n, 3, 3)
        Inertias in the bodies [kg m^2], and their inverses.
    out : ndarray, shape (6 n,)
        Receives dv/dt.
    """
    spin, there = v.reshape(-1, 6)[:, 3:], out.reshape(-1, 6)
    there[:, :3] = pull
    there[:, 3:] = np.matvec(inverses, np.cross(np.matvec(inertias, spin), spin))


def placed_plain(q: Array, bodies: Array, places: Array) -> None:
    """Write where bodies are.

    Parameters
    ----------
    q : ndarray, shape (7 n,)
        Centres and quaternions.
    bodies : ndarray of int, shape (k,)
        From 1 on.
    places : ndarray, shape (k, 4, 3)
        Receives the columns of the rotation, then the centre.
    """
    poses = q.reshape(-1, 7)[bodies - 1]
    places[:, :3] = matrices(poses[:, 3:]).transpose(0, 2, 1)
    places[:, 3] = poses[:, :3]


def pulled_plain(q: Array, bodies: Array, sign: float, points: Array, normals: Array, pulls: Array) -> None:
    """Write how fast points of bodies move along normals with each velocity.

    Parameters
    ----------
    q : ndarray, shape (7 n,)
        Centres and quaternions.
    bodies : ndarray of int, shape (k,)
        From 1 on; of 0, the world, nothing moves.
    sign : float
        By which all is multiplied.
    points, normals : ndarray, shape (k, 3)
        In the world.
    pulls : ndarray, shape (k, 6)
        Receives the rows.
    """
    here = np.flatnonzero(bodies)
    poses = q.reshape(-1, 7)[bodies[here] - 1]
    torque = np.cross(points[here] - poses[:, :3], normals[here])
    pulls[:] = 0.0
    pulls[here, :3] = sign * normals[here]
    pulls[here, 3:] = sign * np.vecmat(torque, matrices(poses[:, 3:]))


def pulled_in_plane_plain(
    q: Array, bodies: Array, sign: float, axes: Array, points: Array, normals: Array, pulls: Array
) -> None:
    """Write what `pulled` does for bodies that move in a plane.

    Parameters
    ----------
    q, bodies, sign, points, normals
        As `pulled`.
    axes : ndarray, shape (3, 3)
        In its rows the two directions of the velocities, and the axis of the turns.
    pulls : ndarray, shape (k, 3)
        Receives the rows.
    """
    here = np.flatnonzero(bodies)
    torque = np.cross(points[here] - q.reshape(-1, 7)[bodies[here] - 1, :3], normals[here])
    pulls[:] = 0.0
    pulls[here, :2], pulls[here, 2] = sign * normals[here] @ axes[:2].T, sign * torque @ axes[2]

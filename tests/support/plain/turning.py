"""Plain numpy forms of the kernels in mbvi/system/free/turning.py."""

from __future__ import annotations

import numpy as np

from mbvi.arguments import Array
from mbvi.geometry.rotations import chart_rate, compose, exp, matrices


def moved_plain(q: Array, dv: Array, new: Array) -> None:
    """Write where a tangent vector leads: centres straight on, rotations about a fixed axis."""
    old, step, out = q.reshape(-1, 7), dv.reshape(-1, 6), new.reshape(-1, 7)
    out[:, :3] = old[:, :3] + step[:, :3]
    turned = compose(old[:, 3:], exp(step[:, 3:]))
    out[:, 3:] = turned / np.sqrt(np.einsum("ij,ij->i", turned, turned))[:, None]


def chart_rates_plain(dv: Array, v: Array, rate: Array) -> None:
    """Write how fast tangent vectors change along a motion."""
    out, here = rate.reshape(-1, 6), v.reshape(-1, 6)
    out[:, :3] = here[:, :3]
    out[:, 3:] = chart_rate(dv.reshape(-1, 6)[:, 3:], here[:, 3:])


def accelerations_plain(v: Array, pull: Array, inertias: Array, inverses: Array, out: Array) -> None:
    """Write the accelerations of bodies that nothing touches."""
    spin, there = v.reshape(-1, 6)[:, 3:], out.reshape(-1, 6)
    there[:, :3] = pull
    there[:, 3:] = np.matvec(inverses, np.cross(np.matvec(inertias, spin), spin))


def placed_plain(q: Array, bodies: Array, places: Array) -> None:
    """Write where bodies are."""
    poses = q.reshape(-1, 7)[bodies - 1]
    places[:, :3] = matrices(poses[:, 3:]).transpose(0, 2, 1)
    places[:, 3] = poses[:, :3]


def pulled_plain(q: Array, bodies: Array, sign: float, points: Array, normals: Array, pulls: Array) -> None:
    """Write how fast points of bodies move along normals with each velocity."""
    here = np.flatnonzero(bodies)
    poses = q.reshape(-1, 7)[bodies[here] - 1]
    torque = np.cross(points[here] - poses[:, :3], normals[here])
    pulls[:] = 0.0
    pulls[here, :3] = sign * normals[here]
    pulls[here, 3:] = sign * np.vecmat(torque, matrices(poses[:, 3:]))


def pulled_in_plane_plain(
    q: Array, bodies: Array, sign: float, axes: Array, points: Array, normals: Array, pulls: Array
) -> None:
    """Write what `pulled` does for bodies that move in a plane."""
    here = np.flatnonzero(bodies)
    torque = np.cross(points[here] - q.reshape(-1, 7)[bodies[here] - 1, :3], normals[here])
    pulls[:] = 0.0
    pulls[here, :2], pulls[here, 2] = sign * normals[here] @ axes[:2].T, sign * torque @ axes[2]

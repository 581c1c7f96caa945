"""Plain numpy forms of the kernels in mbvi/system/free/turning.py."""

from __future__ import annotations

import numpy as np

from mbvi.arguments import Array
from mbvi.geometry.rotations import compose, matrices


def conjugate(a: Array) -> Array:
    """Return the inverses, shape (n, 4)."""
    return a * np.array([-1.0, -1.0, -1.0, 1.0])


def exp(w: Array) -> Array:
    """Return the rotations by the vectors w, shape (n, 3) [rad]."""
    angle = np.sqrt(np.einsum("ij,ij->i", w, w))
    # sinc(x) = sin(pi x) / (pi x) is exact at zero
    return np.concatenate([0.5 * np.sinc(angle / (2 * np.pi))[:, None] * w, np.cos(angle / 2)[:, None]], axis=1)


def log(a: Array) -> Array:
    """Return the rotation vectors, shape (n, 3) [rad], of norm at most pi."""
    a = np.where(a[:, 3:] < 0.0, -a, a)
    sine = np.sqrt(np.einsum("ij,ij->i", a[:, :3], a[:, :3]))
    half = np.arctan2(sine, a[:, 3])
    small = sine < 1e-8
    factor = np.where(small, 2.0, 2.0 * half / np.where(small, 1.0, sine))
    return factor[:, None] * a[:, :3]


def chart_rate(w: Array, spin: Array) -> Array:
    """Return dw/dt, shape (n, 3), of bodies with rotation exp(w) and angular velocity `spin` in the body."""
    angle = np.sqrt(np.einsum("ij,ij->i", w, w))
    half = 0.5 * angle
    # (1 - x cot x) / x^2 at x = half the angle; for small x by its series, because the difference loses digits
    small = half < 0.05
    x = np.where(small, 1.0, half)
    c = np.where(small, (1 + half**2 / 15 * (1 + half**2 * 2 / 21)) / 3, (1 - x / np.tan(x)) / x**2)
    once = np.cross(w, spin)
    return spin + 0.5 * once + 0.25 * c[:, None] * np.cross(w, once)


def moved_plain(q: Array, dv: Array, new: Array) -> None:
    """Write where a tangent vector leads: centres straight on, rotations about a fixed axis."""
    old, step, out = q.reshape(-1, 7), dv.reshape(-1, 6), new.reshape(-1, 7)
    out[:, :3] = old[:, :3] + step[:, :3]
    turned = compose(old[:, 3:], exp(step[:, 3:]))
    out[:, 3:] = turned / np.sqrt(np.einsum("ij,ij->i", turned, turned))[:, None]


def differences_plain(q: Array, new: Array, dv: Array) -> None:
    """Write the tangent vectors that lead from configurations to others."""
    old, there, out = q.reshape(-1, 7), new.reshape(-1, 7), dv.reshape(-1, 6)
    out[:, :3] = there[:, :3] - old[:, :3]
    out[:, 3:] = log(compose(conjugate(old[:, 3:]), there[:, 3:]))


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

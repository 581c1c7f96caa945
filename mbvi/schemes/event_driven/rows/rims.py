"""(dJ/dt) v of rims of discs on planes of the world, along the normal and along tangents."""

from __future__ import annotations

import numpy as np

from ....constraints.feature_kernels import LEVEL
from ....constraints.mechanism.held_rows import RowParts
from ....constraints.rows import Array
from ....system import System


def rim_biases(system: System, q: Array, v: Array, parts: RowParts, axes: Array) -> tuple[Array, Array]:
    """Return (dJ/dt) v of rims, shape (k,), and that of their tangents, shape (k, 2); NaN where a rim lies flat.

    Parameters
    ----------
    system : System
        What moves the discs.
    q, v : ndarray, shapes (nq,) and (nv,)
        Configuration and velocity.
    parts : RowParts
        What the rows are: faces of the world and rims.
    axes : ndarray, shape (k, 2, 3)
        The tangents.
    """
    bodies, n, k = parts.sides[:, 1].copy(), parts.parts[:, 0, 1], len(parts.kind)
    places = system.placements(q, bodies)
    own_axis = parts.parts[:, 1, 1]
    axis = np.einsum("ki,kij->kj", own_axis, places[:, :3])
    radius = np.linalg.norm(axis, axis=1, keepdims=True)
    a = axis / radius
    along = np.vecdot(n, a)[:, None]
    beside = n - along * a
    size = np.linalg.norm(beside, axis=1, keepdims=True)
    size[size <= LEVEL] = np.nan
    up = beside / size
    centre = np.einsum("ki,kij->kj", parts.parts[:, 1, 0], places[:, :3]) + places[:, 3]
    point = centre - radius * up
    # the velocities of the point and of others beside it give the turning of the body
    others = np.nan_to_num(point)[:, None] + np.concatenate([np.zeros((1, 3)), np.eye(3)])
    many, repeated = np.repeat(others.reshape(-1, 3), 3, axis=0), np.repeat(bodies, 12)
    rows = system.separation_rows(q, np.zeros_like(repeated), repeated, many, np.tile(np.eye(3), (4 * k, 1)))
    speeds = (rows @ v).reshape(k, 4, 3)
    turning = 0.5 * np.cross(np.eye(3), speeds[:, 1:] - speeds[:, :1]).sum(axis=1)
    # how fast the lowest point moves along the disc
    change = np.cross(turning, a)
    rate = -np.vecdot(n, change)[:, None] * a - along * change
    rate = (rate - np.vecdot(up, rate)[:, None] * up) / size
    slides = -radius * (rate - np.cross(turning, up))
    own = np.einsum("kij,kj->ki", places[:, :3], np.nan_to_num(point) - places[:, 3])
    acceleration = system.point_bias(q, v, bodies, own) + np.cross(turning, slides)
    return np.vecdot(acceleration, n), np.einsum("kcj,kj->kc", axes, acceleration)

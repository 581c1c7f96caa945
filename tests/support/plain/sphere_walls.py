"""Plain numpy forms of the kernels in mbvi/constraints/families/sphere_walls.py."""

from __future__ import annotations

import numpy as np

from mbvi.arguments import Array
from mbvi.constraints.families.sphere_walls import _BOX, _PLANE


def wall_contacts_plain(
    centres: Array, radii: Array, kind: Array, walls: Array, tolerance: float, number: Array, gap: Array, point: Array,
    normal: Array,
) -> int:  # fmt: skip
    """Write the contacts of spheres with walls that are within the tolerance; return how many there are."""
    n, w = len(radii), len(kind)
    far, out = np.empty((n, w)), np.empty((n, w, 3))
    for a in range(w):
        if kind[a] == _PLANE:
            far[:, a], out[:, a] = centres @ walls[a, :3] - walls[a, 3], walls[a, :3]
        elif kind[a] == _BOX:
            axes, half = walls[a, :9].reshape(3, 3), walls[a, 12:15]
            local = (centres - walls[a, 9:12]) @ axes.T
            away = local - np.clip(local, -half, half)
            outside = np.linalg.norm(away, axis=1)
            # from inside, straight out of the nearest face
            depth = half - np.abs(local)
            face = np.argmin(depth, axis=1)
            way = np.eye(3)[face] * np.where(local >= 0.0, 1.0, -1.0)
            inside = outside == 0.0
            far[:, a] = np.where(inside, -depth[np.arange(n), face], outside)
            out[:, a] = np.where(inside[:, None], way, away / np.where(inside, 1.0, outside)[:, None]) @ axes
        else:
            axis = walls[a, 3:6] - walls[a, :3]
            square = axis @ axis
            along = np.clip((centres - walls[a, :3]) @ axis / (square if square > 0.0 else 1.0), 0.0, 1.0)
            away = centres - walls[a, :3] - along[:, None] * axis
            outside = np.linalg.norm(away, axis=1)
            far[:, a] = outside - walls[a, 6]
            upright = np.array([0.0, 0.0, 1.0])
            out[:, a] = np.where(outside[:, None] > 0.0, away / np.where(outside > 0.0, outside, 1.0)[:, None], upright)
    distance = far - radii[:, None]
    near = np.flatnonzero(distance <= tolerance)
    count, sphere = len(near), near // w
    number[:count], gap[:count], normal[:count] = near, distance.ravel()[near], out.reshape(-1, 3)[near]
    point[:count] = centres[sphere] - (radii[sphere] + 0.5 * gap[:count])[:, None] * normal[:count]
    return count

"""Where lines leave shapes, in plain numpy."""

from __future__ import annotations

import numpy as np

from mbvi.arguments import Array
from mbvi.geometry.shapes.features import FACING
from mbvi.geometry.shapes.shapes import Capsule, Convex, Cylinder


def exit_from(shape: Convex, points: Array, direction: Array) -> Array:
    """Return the distance from each point, shape (k, 3), to where a line along a unit vector leaves the shape [m]."""
    if isinstance(shape, Capsule):
        z = np.clip(points[:, 2], -0.5 * shape.length, 0.5 * shape.length)
        return _leave_ball(points - z[:, None] * np.array([0.0, 0.0, 1.0]), direction, shape.radius)
    if isinstance(shape, Cylinder):
        length = np.full(len(points), np.inf)
        if abs(direction[2]) > FACING:
            length = (0.5 * shape.length - np.sign(direction[2]) * points[:, 2]) / abs(direction[2])
        across = np.hypot(direction[0], direction[1])
        if across > FACING:
            flat = points * np.array([1.0, 1.0, 0.0])
            unit = np.array([direction[0], direction[1], 0.0]) / across
            length = np.minimum(length, _leave_ball(flat, unit, shape.radius) / across)
        return length
    normals, offsets = shape.faces
    slope = normals @ direction
    met = slope > FACING
    return ((offsets[met] - points @ normals[met].T) / slope[met]).min(axis=1, initial=np.inf)


def _leave_ball(points: Array, direction: Array, radius: float) -> Array:
    along = points @ direction
    inside = along**2 - (points**2).sum(axis=1) + radius**2
    return np.sqrt(np.maximum(inside, 0.0)) - along

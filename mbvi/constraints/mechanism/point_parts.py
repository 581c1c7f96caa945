"""Support points of shapes above half-spaces, gathered, and what they are for kernels of rows."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..features.feature_kernels import FACE_RIM, FACE_VERTEX
from .held_rows import UNKNOWN, Array, RowParts

# half axes are equally long, and at right angles, to within this part of their length
_ROUND = 1e-12


@dataclass(frozen=True)
class PointSelection:
    """Some support points, gathered in arrays for kernels.

    Attributes
    ----------
    points : ndarray of int, shape (k,)
        The points, ascending.
    pair : ndarray of int, shape (k,)
        The pair of each point.
    restitution : ndarray, shape (k,)
        e of each point.
    numbers : ndarray, shape (k, 17)
        The points as `geometry.support_points` describes them.
    up : ndarray, shape (k, 3)
        The normals of their half-spaces.
    owners : ndarray of int, shape (k, 2)
        Of each point: the place of its body in the placements, and its pair.
    bodies : ndarray of int, shape (k,)
        The body of each point.
    """

    points: Array
    pair: Array
    restitution: Array
    numbers: Array
    up: Array
    owners: Array
    bodies: Array

    @cached_property
    def parts(self) -> RowParts:
        """What the points are; see `parts_of_points`."""
        return parts_of_points(self.numbers, self.bodies)


def parts_of_points(numbers: Array, bodies: Array) -> RowParts:
    """Return what some points are: vertices on a face of the world, centres of spheres, or rims of discs.

    A point on an ellipsoid is unknown to kernels.

    Parameters
    ----------
    numbers : ndarray, shape (k, 17)
        See `Points`.
    bodies : ndarray of int, shape (k,)
        The bodies of the points.
    """
    parts, (first, second) = np.zeros((len(numbers), 2, 2, 3)), numbers[:, 3:9].reshape(-1, 2, 3).swapaxes(0, 1)
    # the face of a sphere is moved by its radius
    parts[:, 0, 0], parts[:, 0, 1] = numbers[:, 16:] * numbers[:, 12:15], numbers[:, 12:15]
    parts[:, 1, 0] = numbers[:, :3]
    radius = np.linalg.norm(first, axis=1)
    disc = (radius > 0.0) & ~numbers[:, 9:12].any(axis=1)
    disc &= np.abs(np.linalg.norm(second, axis=1) - radius) <= _ROUND * radius
    disc &= np.abs(np.vecdot(first, second)) <= _ROUND * radius**2
    parts[disc, 1, 1] = np.cross(first, second)[disc] / radius[disc, None]
    kind = np.where(disc, FACE_RIM, np.where(numbers[:, 3:12].any(axis=1), UNKNOWN, FACE_VERTEX))
    sides = np.stack([np.zeros(len(numbers), np.int64), bodies], axis=1)
    return RowParts(kind, sides, parts, np.zeros(len(numbers)), -numbers[:, 15])

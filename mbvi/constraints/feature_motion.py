"""Where rows of features touch, and how the bodies move there, of any system."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..system import System
from .feature_bias import way_along_rim
from .feature_kernels import touch_each
from .mechanism.held_rows import RowParts
from .rows import Array


class Touching(NamedTuple):
    """Where rows touch: bodies, kinds, placements, directions on either body in the world, gaps, points and normals."""

    bodies: Array
    kind: Array
    places: Array
    along: Array
    gap: Array
    point: Array
    normal: Array


class Motion(NamedTuple):
    """How both bodies of k rows move where these touch.

    Attributes
    ----------
    velocity, acceleration : ndarray, shape (k, 2, 3)
        Those of the bodies' points there; the second where the joints do not accelerate [m/s, m/s^2].
    spin : ndarray, shape (k, 2, 3)
        Angular velocities [rad/s].
    """

    velocity: Array
    acceleration: Array
    spin: Array

    def turning(self, vectors: Array) -> Array:
        """Return how fast vectors turn with either body, shape (k, 2, 3)."""
        return np.cross(self.spin, vectors)


NOWHERE = Touching(*np.zeros((7, 0)))


def places_of(system: System, q: Array, bodies: Array) -> Array:
    """Return the placements of some bodies, shape (k, 4, 3); the world's is the identity."""
    places = np.zeros((len(bodies), 4, 3))
    places[:, :3] = np.eye(3)
    moving = bodies > 0
    places[moving] = system.placements(q, bodies[moving])
    return places


def touching(system: System, q: Array, parts: RowParts) -> Touching:
    """Return where some rows touch at q."""
    k, bodies = len(parts.kind), parts.sides
    places = places_of(system, q, bodies.ravel()).reshape(-1, 2, 4, 3)
    along, gap, (point, normal) = np.empty((k, 2, 3)), np.empty(k), np.empty((2, k, 3))
    touch_each(parts.kind, parts.parts, parts.radius, places, along, gap, point, normal)
    return Touching(bodies, parts.kind, places, along, gap, point, normal)


def motion_of(system: System, q: Array, v: Array, at: Touching) -> Motion:
    """Return how both bodies of some rows move at q and v."""
    k, bodies = len(at.kind), at.bodies.ravel()
    # the velocities of either body at the contact point, and at three others beside it
    points = at.point[:, None, None] + np.concatenate([np.zeros((1, 3)), np.eye(3)]) + np.zeros((k, 2, 1, 1))
    many, each = np.repeat(points.reshape(-1, 3), 3, axis=0), np.repeat(bodies, 12)
    axes = np.tile(np.eye(3), (8 * k, 1))
    moved = (system.separation_rows(q, np.zeros_like(each), each, many, axes) @ v).reshape(k, 2, 4, 3)
    spin = 0.5 * np.cross(np.eye(3), moved[:, :, 1:] - moved[:, :, :1]).sum(axis=2)
    own = ((at.point[:, None] - at.places[:, :, 3])[:, :, None, :] @ at.places[:, :, :3].swapaxes(2, 3))[:, :, 0]
    acceleration, moving = np.zeros((2 * k, 3)), bodies > 0
    acceleration[moving] = system.point_bias(q, v, bodies[moving], own.reshape(-1, 3)[moving])
    return Motion(moved[:, :, 0], acceleration.reshape(k, 2, 3), spin)


def rim_accelerations(system: System, q: Array, v: Array, parts: RowParts) -> Array:
    """Return the rates of the velocities at the lowest points of rims above planes of the world, shape (k, 3).

    The product with a direction is (dJ/dt) v of the row along it.
    """
    at = touching(system, q, parts)
    motion = motion_of(system, q, v, at)
    turning, across = motion.turning(at.along), motion.turning(at.normal[:, None])
    each = zip(at.normal, at.along, turning, across, strict=True)
    ways = np.array([way_along_rim(1, *row) for row in each]).reshape(-1, 3)
    return np.asarray(motion.acceleration[:, 1] + np.cross(motion.spin[:, 1], ways))

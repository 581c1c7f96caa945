"""Where rows of features touch, and how the bodies move there, of any system."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...system import System
from ..mechanism.held_rows import RowParts
from ..rows import Array
from .feature_bias import write_biases, write_slip_biases
from .feature_kernels import touch_each


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


# the velocity of p + e_y along e_z is that of p and the angular velocity about e_x, and so on
_BESIDE = np.concatenate([np.zeros((3, 3)), np.eye(3)[[1, 2, 0]]])
_ALONG = np.concatenate([np.eye(3), np.eye(3)[[2, 0, 1]]])
_IDENTITY = np.eye(4, 3)
NOWHERE = Touching(*np.zeros((7, 0)))


def places_of(system: System, q: Array, bodies: Array) -> Array:
    """Return the placements of some bodies, shape (k, 4, 3); the world's is the identity."""
    places = np.empty((len(bodies), 4, 3))
    places[:] = _IDENTITY
    moving = bodies.nonzero()[0]
    places[moving] = system.placements(q, bodies[moving])
    return places


def touching(system: System, q: Array, parts: RowParts) -> Touching:
    """Return where some rows touch at q."""
    k, bodies = len(parts.kind), parts.sides
    places = places_of(system, q, bodies.ravel()).reshape(-1, 2, 4, 3)
    along, gap, (point, normal) = np.empty((k, 2, 3)), np.empty(k), np.empty((2, k, 3))
    touch_each(parts.kind, parts.parts, parts.radius, places, along, gap, point, normal)
    return Touching(bodies, parts.kind, places, along, gap, point, normal)


def motion_of(system: System, q: Array, v: Array, at: Touching, point: Array) -> Motion:
    """Return how both bodies of some rows move at q and v at points in the world, shape (k, 3)."""
    k, sides = len(at.kind), at.bodies.ravel()
    motion, moving = Motion(*np.zeros((3, k, 2, 3))), np.flatnonzero(sides > 0)
    bodies, where = sides[moving], np.repeat(point, 2, axis=0)[moving]
    # the velocities of a body at the point along each axis, and along the axis before it at a point beside it
    points = np.repeat(where, 6, axis=0) + np.tile(_BESIDE, (len(moving), 1))
    axes, each = np.tile(_ALONG, (len(moving), 1)), np.repeat(bodies, 6)
    speeds = (system.separation_rows(q, np.zeros_like(each), each, points, axes) @ v).reshape(-1, 6)
    motion.velocity.reshape(-1, 3)[moving] = speeds[:, :3]
    motion.spin.reshape(-1, 3)[moving] = speeds[:, 3:] - speeds[:, [2, 0, 1]]
    places = at.places.reshape(-1, 4, 3)[moving]
    own = np.vecmat(where - places[:, 3], places[:, :3].swapaxes(1, 2))
    motion.acceleration.reshape(-1, 3)[moving] = system.point_bias(q, v, bodies, own)
    return motion


def row_biases(system: System, q: Array, v: Array, at: Touching, radius: Array) -> Array:
    """Return (dJ/dt) v of some rows that touch as `at` says at q, shape (k,); `radius` is that of `RowParts`."""
    bias = np.empty(len(radius))
    write_biases(at.kind, radius, at.normal, at.along, *motion_of(system, q, v, at, at.point), bias)
    return bias


def slip_biases(system: System, q: Array, v: Array, parts: RowParts) -> Array:
    """Return (dT/dt) v of the tangents T of some rows where they touch, shape (k, 2)."""
    at, bias = touching(system, q, parts), np.empty((len(parts.kind), 2))
    motion = motion_of(system, q, v, at, at.point + parts.shift[:, None] * at.normal)
    write_slip_biases(at.kind, parts.radius, parts.shift, at.normal, at.along, *motion, bias)
    return bias

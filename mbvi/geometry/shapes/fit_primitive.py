"""Fits of spheres, boxes, capsules, cylinders or hulls of fewer vertices to a convex hull, within a tolerance.

Every fit comes with an upper bound of the Hausdorff distance to the hull. A primitive is the mean of two of its kind:
one that contains the hull's vertices, and a smaller one within all of the hull's faces.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from .fewer_vertices import fewer_vertices
from .polyhedra import Box, Hull
from .shapes import Array, Capsule, Convex, Cylinder, Sphere

# tolerances in sizes of the hull: the one of meshes by default, and the rounding within which a fit is exact
_DEFAULT, _EXACT = 1e-4, 1e-9
# sides whose normals differ by less are one side
_SAME_NORMAL = 1e-4


class Fit(NamedTuple):
    """A shape that replaces a hull.

    Attributes
    ----------
    shape : Convex
        The shape.
    rotation, position : ndarray, shapes (3, 3) and (3,)
        Rotation and position of its frame in the hull's [m].
    distance : float
        Upper bound of the Hausdorff distance of the two [m]; infinite if no such shape fits.
    """

    shape: Convex
    rotation: Array
    position: Array
    distance: float


def fit_primitive(hull: Hull, tolerance: float | None) -> Fit | None:
    """Return a primitive, or a hull of fewer vertices, within a tolerance of a hull; None if there is none.

    Parameters
    ----------
    hull : Hull
        The hull.
    tolerance : float or None
        Greatest Hausdorff distance [m]. If None, it is 1e-4 of the hull's size, the radius about its centre of mass. If
        0, only primitives are tried, and rounding is allowed, 1e-9 of that size.
    """
    centre = hull.mass_properties(1.0)[0]
    size = float(np.linalg.norm(hull.vertices - centre, axis=1).max())
    allowed = _DEFAULT * size if tolerance is None else max(tolerance, _EXACT * size)
    found = min(_primitives(hull), key=lambda one: one.distance)
    if found.distance <= allowed:
        return found
    if tolerance == 0.0:
        return None
    fewer = fewer_vertices(hull, allowed)
    return None if fewer is None else Fit(fewer[0], np.eye(3), np.zeros(3), fewer[1])


def _primitives(hull: Hull) -> Iterator[Fit]:
    """Yield a ball, and a box, capsule and cylinder along each principal axis and in the frame of the largest sides."""
    centre, inertia = hull.mass_properties(1.0)
    yield _ball(hull, centre)
    normals, weights = _sides(hull)
    first = normals[np.argmax(weights)]
    across = np.abs(normals @ first) < 0.1
    frames = [_frame(axis) for axis in np.linalg.eigh(inertia)[1].T]
    if across.any():
        frames.append(_frame(first, normals[across][np.argmax(weights[across])]))
    for frame in frames:
        yield _box(hull, centre, frame)
        yield _capsule(hull, centre, frame)
        yield _cylinder(hull, centre, frame)


def _sides(hull: Hull) -> tuple[Array, Array]:
    """Return the normals of all triangles, and for each the total area of the triangles with about that normal."""
    normals, corner = hull.faces[0], hull.vertices[hull.triangles]
    area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    cell = np.round(normals / _SAME_NORMAL).astype(np.int64) @ np.array([1, 1 << 20, 1 << 40])
    _, side = np.unique(cell, return_inverse=True)
    return normals, np.bincount(side, area)[side]


def _frame(axis: Array, side: Array | None = None) -> Array:
    """Return a rotation, shape (3, 3), with its third column along an axis and its first towards a side."""
    other = np.eye(3)[np.argmin(np.abs(axis))] if side is None else side
    x = other - (other @ axis) * axis
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(axis, x), axis], axis=1)


def _in_frame(hull: Hull, origin: Array, frame: Array) -> tuple[Array, Array, Array]:
    """Return vertices, normals and offsets of a hull in the coordinates of a frame."""
    normals, offsets = hull.faces
    return (hull.vertices - origin) @ frame, normals @ frame, offsets - normals @ origin


def _shrinking(extent: Array, rate: Array, offsets: Array) -> float:
    """Return by how much a shape that contains a hull must shrink to lie within it.

    `extent` is how far the shape extends along the normal of each face, and `rate` how much of it is lost with each
    unit of shrinking.
    """
    return max(float(((extent - offsets) / rate).max()), 0.0)


def _no_fit(frame: Array, centre: Array) -> Fit:
    """Return a fit that no tolerance accepts."""
    return Fit(Sphere(1.0), frame, centre, np.inf)


def _ball(hull: Hull, centre: Array) -> Fit:
    outer = float(np.linalg.norm(hull.vertices - centre, axis=1).max())
    inner = outer - _shrinking(np.full(len(hull.faces[1]), outer), np.ones(1), _in_frame(hull, centre, np.eye(3))[2])
    return Fit(Sphere(0.5 * (outer + inner)), np.eye(3), centre, 0.5 * (outer - inner))


def _box(hull: Hull, centre: Array, frame: Array) -> Fit:
    points = _in_frame(hull, centre, frame)[0]
    low, high = points.min(axis=0), points.max(axis=0)
    centre, half = centre + frame @ (0.5 * (low + high)), 0.5 * (high - low)
    _, normals, offsets = _in_frame(hull, centre, frame)
    shrink = _shrinking(np.abs(normals) @ half, np.abs(normals).sum(axis=1), offsets)
    if shrink >= 2.0 * half.min():
        return _no_fit(frame, centre)
    size = 2.0 * half - shrink
    return Fit(Box(tuple(size.tolist())), frame, centre, 0.5 * float(np.sqrt(3.0)) * shrink)


def _capsule(hull: Hull, centre: Array, frame: Array) -> Fit:
    points, normals, offsets = _in_frame(hull, centre, frame)
    # a hull that is not symmetric about its centre is no capsule: its fit is then bad
    half = float(np.abs(points[:, 2]).max() - np.hypot(points[:, 0], points[:, 1]).max())
    # without a length between the ends it would be a ball
    if half <= 1e-6 * hull.bound:
        return _no_fit(frame, centre)
    beyond = points - np.clip(points[:, 2:], -half, half) * np.array([0.0, 0.0, 1.0])
    outer = float(np.linalg.norm(beyond, axis=1).max())
    inner = outer - _shrinking(np.abs(normals[:, 2]) * half + outer, np.ones(1), offsets)
    return Fit(Capsule(0.5 * (outer + inner), 2.0 * half), frame, centre, 0.5 * (outer - inner))


def _cylinder(hull: Hull, centre: Array, frame: Array) -> Fit:
    points = _in_frame(hull, centre, frame)[0]
    low, high = float(points[:, 2].min()), float(points[:, 2].max())
    centre, half = centre + 0.5 * (low + high) * frame[:, 2], 0.5 * (high - low)
    points, normals, offsets = _in_frame(hull, centre, frame)
    radius, across = float(np.hypot(points[:, 0], points[:, 1]).max()), np.hypot(normals[:, 0], normals[:, 1])
    along = np.abs(normals[:, 2])
    shrink = _shrinking(along * half + across * radius, along + across, offsets)
    if shrink >= 2.0 * min(half, radius):
        return _no_fit(frame, centre)
    shape = Cylinder(radius - 0.5 * shrink, 2.0 * half - shrink)
    return Fit(shape, frame, centre, float(np.sqrt(0.5)) * shrink)

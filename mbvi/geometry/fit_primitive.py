"""Fits of spheres, boxes, capsules, cylinders or hulls of fewer vertices to a convex hull, within a tolerance.

Every fit comes with an upper bound of the Hausdorff distance to the hull. A primitive is the mean of two of its kind:
one that contains the hull's vertices, and a smaller one within all of the hull's faces. A hull of fewer vertices is
scaled up about an inner point until it contains each vertex that was left out; that bounds the distance of the vertex.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ..errors import InputError
from .polyhedra import Box, Hull
from .shapes import Array, Capsule, Convex, Cylinder, Sphere

# vertices added to a thinned hull at a time
_AT_ONCE = 8


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
        Greatest Hausdorff distance [m]. If None, it is 1e-9 of the hull's size, and only primitives are tried.
    """
    allowed = 1e-9 * hull.bound if tolerance is None else tolerance
    found = min(_primitives(hull), key=lambda one: one.distance)
    if found.distance <= allowed:
        return found
    return None if tolerance is None else _hull_of_fewer_vertices(hull, tolerance)


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
    """Return the normals of all triangles, and for each the total area of the triangles with that normal."""
    normals, corner = hull.faces[0], hull.vertices[hull.triangles]
    area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    return normals, (normals @ normals.T > 1.0 - 1e-9) @ area


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


def _hull_of_fewer_vertices(hull: Hull, tolerance: float) -> Fit | None:
    """Return a hull of the outermost vertices in 26 directions and, in turn, of the vertices farthest outside it."""
    points = hull.vertices
    steps = np.array([[x, y, z] for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if x or y or z])
    kept = np.zeros(len(points), bool)
    kept[np.argmax(points @ steps.T, axis=0)] = True
    while not kept.all():
        try:
            fewer = Hull(points[kept])
        except InputError:
            return None
        far = _outside(fewer, points)
        if far.max() <= tolerance:
            return Fit(fewer, np.eye(3), np.zeros(3), float(far.max()))
        worst = np.argsort(far, kind="stable")[-_AT_ONCE:]
        kept[worst[far[worst] > tolerance]] = True
    return None


def _outside(hull: Hull, points: Array) -> Array:
    """Return upper bounds of the distances of points to a hull, shape (n,)."""
    centre = hull.mass_properties(1.0)[0]
    _, normals, offsets = _in_frame(hull, centre, np.eye(3))
    factor = ((points - centre) @ normals.T / offsets).max(axis=1)
    # the hull scaled by this factor about its centre contains the point
    excess = np.maximum(1.0 - 1.0 / np.maximum(factor, 1.0), 0.0)
    return np.asarray(excess * np.linalg.norm(points - centre, axis=1))

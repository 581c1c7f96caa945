"""Fits of spheres, boxes, capsules, cylinders or hulls of fewer vertices to a convex hull, within a tolerance.

Every fit comes with a bound of the Hausdorff distance to the hull. A primitive lies half way between one that holds
the hull and one that the hull holds, found from its vertices and its faces; of fewer vertices, each that was left out
lies in the new hull blown up about an inner point.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ..errors import InputError
from .polyhedra import Box, Hull
from .shapes import Array, Capsule, Convex, Cylinder, Sphere

# vertices added at a time
_AT_ONCE = 8


class Simpler(NamedTuple):
    """A shape that stands for a hull.

    Attributes
    ----------
    shape : Convex
        The shape.
    rotation, position : ndarray, shapes (3, 3) and (3,)
        Where its frame stands in the hull's [m].
    distance : float
        What the Hausdorff distance of the two is at most [m].
    """

    shape: Convex
    rotation: Array
    position: Array
    distance: float


def simpler(hull: Hull, tolerance: float | None) -> Simpler | None:
    """Return a simpler shape within a tolerance, None if there is none.

    Parameters
    ----------
    hull : Hull
        The hull.
    tolerance : float or None
        Of the Hausdorff distance [m]; by default 1e-9 of the hull's size, and no vertices are left out.
    """
    allowed = 1e-9 * hull.bound if tolerance is None else tolerance
    found = min(_primitives(hull), key=lambda one: one.distance)
    if found.distance <= allowed:
        return found
    return None if tolerance is None else _thinned(hull, tolerance)


def _primitives(hull: Hull) -> Iterator[Simpler]:
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
    """Return the normals of the faces, and how large those with about the same normal are together."""
    normals, corner = hull.faces[0], hull.vertices[hull.triangles]
    area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    return normals, (normals @ normals.T > 1.0 - 1e-9) @ area


def _frame(axis: Array, side: Array | None = None) -> Array:
    """Return a rotation, shape (3, 3), with its third column along an axis and its first towards a side."""
    other = np.eye(3)[np.argmin(np.abs(axis))] if side is None else side
    x = other - (other @ axis) * axis
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(axis, x), axis], axis=1)


def _seen(hull: Hull, origin: Array, frame: Array) -> tuple[Array, Array, Array]:
    """Return vertices, normals and offsets of a hull as a frame sees them."""
    normals, offsets = hull.faces
    return (hull.vertices - origin) @ frame, normals @ frame, offsets - normals @ origin


def _between(outside: Array, reach: Array, offsets: Array) -> float:
    """Return by how much a shape around a hull must shrink to fit into it.

    `outside` is how far it reaches along each face's normal, and `reach` how much of that goes with each unit it
    shrinks by.
    """
    return max(float(((outside - offsets) / reach).max()), 0.0)


def _ball(hull: Hull, centre: Array) -> Simpler:
    outer = float(np.linalg.norm(hull.vertices - centre, axis=1).max())
    inner = outer - _between(np.full(len(hull.faces[1]), outer), np.ones(1), _seen(hull, centre, np.eye(3))[2])
    return Simpler(Sphere(0.5 * (outer + inner)), np.eye(3), centre, 0.5 * (outer - inner))


def _box(hull: Hull, centre: Array, frame: Array) -> Simpler:
    points = _seen(hull, centre, frame)[0]
    low, high = points.min(axis=0), points.max(axis=0)
    centre, half = centre + frame @ (0.5 * (low + high)), 0.5 * (high - low)
    _, normals, offsets = _seen(hull, centre, frame)
    gone = _between(np.abs(normals) @ half, np.abs(normals).sum(axis=1), offsets)
    if gone >= 2.0 * half.min():
        return Simpler(Sphere(1.0), frame, centre, np.inf)
    size = 2.0 * half - gone
    return Simpler(Box(tuple(size.tolist())), frame, centre, 0.5 * float(np.sqrt(3.0)) * gone)


def _capsule(hull: Hull, centre: Array, frame: Array) -> Simpler:
    points, normals, offsets = _seen(hull, centre, frame)
    # symmetric about its centre, else it is none
    half = float(np.abs(points[:, 2]).max() - np.hypot(points[:, 0], points[:, 1]).max())
    # a ball is none
    if half <= 1e-6 * hull.bound:
        return Simpler(Sphere(1.0), frame, centre, np.inf)
    beyond = points - np.clip(points[:, 2:], -half, half) * np.array([0.0, 0.0, 1.0])
    outer = float(np.linalg.norm(beyond, axis=1).max())
    inner = outer - _between(np.abs(normals[:, 2]) * half + outer, np.ones(1), offsets)
    return Simpler(Capsule(0.5 * (outer + inner), 2.0 * half), frame, centre, 0.5 * (outer - inner))


def _cylinder(hull: Hull, centre: Array, frame: Array) -> Simpler:
    points = _seen(hull, centre, frame)[0]
    low, high = float(points[:, 2].min()), float(points[:, 2].max())
    centre, half = centre + 0.5 * (low + high) * frame[:, 2], 0.5 * (high - low)
    points, normals, offsets = _seen(hull, centre, frame)
    radius, across = float(np.hypot(points[:, 0], points[:, 1]).max()), np.hypot(normals[:, 0], normals[:, 1])
    along = np.abs(normals[:, 2])
    gone = _between(along * half + across * radius, along + across, offsets)
    if gone >= 2.0 * min(half, radius):
        return Simpler(Sphere(1.0), frame, centre, np.inf)
    shape = Cylinder(radius - 0.5 * gone, 2.0 * half - gone)
    return Simpler(shape, frame, centre, float(np.sqrt(0.5)) * gone)


def _thinned(hull: Hull, tolerance: float) -> Simpler | None:
    """Return the hull of fewer vertices: the outermost in some directions, then always those that miss most."""
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
            return Simpler(fewer, np.eye(3), np.zeros(3), float(far.max()))
        worst = np.argsort(far, kind="stable")[-_AT_ONCE:]
        kept[worst[far[worst] > tolerance]] = True
    return None


def _outside(hull: Hull, points: Array) -> Array:
    """Return what the distances of points to a hull are at most, shape (n,)."""
    centre = hull.mass_properties(1.0)[0]
    _, normals, offsets = _seen(hull, centre, np.eye(3))
    blown = ((points - centre) @ normals.T / offsets).max(axis=1)
    # blown up by so much about its centre it would hold the point
    excess = np.maximum(1.0 - 1.0 / np.maximum(blown, 1.0), 0.0)
    return np.asarray(excess * np.linalg.norm(points - centre, axis=1))

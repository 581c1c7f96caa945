"""Convex shapes as kernels of surfaces take them: the vertices, edges and flat faces of a polyhedron, or a segment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...arguments import Array
from ...compiled import record
from .shapes import Box, Capsule, Convex, Cylinder, Hull, PlacedShape

# vertices of the prism inside each rim of a cylinder: at edges and corners of a mesh it is 0.2 % of the radius inside
RIM = 48
# triangles of a hull whose normals differ by less than this are one face
_ONE_FACE = 1e-6


@record("i8[::1], f8[:,::1], i8[::1], f8[:,::1], i8[:,::1], i8[::1], f8[:,::1], i8[::1], i8[:,::1], i8[::1], f8[:,::1]")
class Cores(NamedTuple):
    """Convex shapes, each the set of points within a radius of a polyhedron or of a segment.

    Attributes
    ----------
    frame : ndarray of int, shape (s,)
        The place of each shape's body in the placements.
    sizes : ndarray, shape (s, 6)
        Middle of the vertices in the body's frame; the radius about the core; the radius of a ball inside; that of a
        ball about the middle that holds the shape [m].
    first_point, points : ndarray, shapes (s + 1,) and (k, 3)
        Vertices in their bodies' frames [m].
    edges, first_edge : ndarray of int, shapes (e, 4) and (s + 1,)
        Two vertices and the two faces of each edge; -1 where there is no face.
    faces, first_face : ndarray, shapes (f, 4) and (s + 1,)
        Outward unit normal and offset [m] of each face, in its body's frame.
    sides, first_side : ndarray of int, shapes (k, 3) and (f + 1,)
        The sides of each face: two vertices, anticlockwise seen from outside, and the face beyond.
    rims : ndarray, shape (s, 4)
        Of cylinders half of the axis in the body's frame, and the radius [m]; zero of other shapes.
    """

    frame: Array
    sizes: Array
    first_point: Array
    points: Array
    edges: Array
    first_edge: Array
    faces: Array
    first_face: Array
    sides: Array
    first_side: Array
    rims: Array


def has_core(shape: Convex) -> bool:
    """Return whether a shape is a polyhedron, a segment with a radius, or a cylinder."""
    return isinstance(shape, Box | Hull | Capsule | Cylinder)


def _corners(shape: Convex) -> Array:
    """Return the vertices of a polyhedron, the ends of a segment, or points on the rims of a cylinder."""
    if not isinstance(shape, Cylinder):
        return shape.support_points()[0]
    angle = 2.0 * np.pi * np.arange(RIM) / RIM
    rim = shape.radius * np.column_stack([np.cos(angle), np.sin(angle)])
    return np.concatenate([np.column_stack([rim, np.full(RIM, z)]) for z in (-0.5 * shape.length, 0.5 * shape.length)])


def cores_of(shapes: Sequence[PlacedShape], frame: Array) -> Cores:
    """Return the cores of some shapes for which `has_core` holds, on bodies with the given places."""
    sizes, points, edges, faces, sides, rims = [], [], [], [], [], []
    first_point, first_edge, first_face, first_side = [0], [0], [0], [0]
    around: list[Array]
    for placed in shapes:
        shape = placed.shape
        radius = shape.radius if isinstance(shape, Capsule) else 0.0
        own = _corners(shape)
        half_axis, rim = (0.5 * shape.length, shape.radius) if isinstance(shape, Cylinder) else (0.0, 0.0)
        rims.append([*(half_axis * placed.rotation[:, 2]), rim])
        if isinstance(shape, Capsule):
            lines, planes, around = np.array([[0, 1, -1, -1]]), np.zeros((0, 4)), []
        else:
            own, lines, planes, around = _polyhedron(own)
        own = own @ placed.rotation.T + placed.position
        planes = np.column_stack([planes[:, :3] @ placed.rotation.T, planes[:, 3]])
        planes[:, 3] += planes[:, :3] @ placed.position
        middle = own.mean(axis=0)
        bound = float(np.linalg.norm(own - middle, axis=1).max()) + radius
        sizes.append([*middle, radius, shape.inner, bound])
        points.append(own)
        start, begin = first_point[-1], first_face[-1]
        edges.append(lines + np.where(lines >= 0, [start, start, begin, begin], 0))
        faces.append(planes)
        for each in around:
            sides.append(each + np.array([start, start, begin]))
            first_side.append(first_side[-1] + len(each))
        first_point.append(start + len(own))
        first_edge.append(first_edge[-1] + len(lines))
        first_face.append(begin + len(planes))
    ints = [np.array(each, dtype=np.int64) for each in (first_point, first_edge, first_face, first_side)]
    return Cores(
        np.array(frame, dtype=np.int64),
        np.array(sizes).reshape(-1, 6),
        ints[0],
        np.concatenate([np.zeros((0, 3)), *points]),
        np.ascontiguousarray(np.concatenate([np.zeros((0, 4)), *edges]).astype(np.int64)),
        ints[1],
        np.ascontiguousarray(np.concatenate([np.zeros((0, 4)), *faces])),
        ints[2],
        np.concatenate([np.zeros((0, 3), np.int64), *sides]).astype(np.int64),
        ints[3],
        np.array(rims).reshape(-1, 4),
    )


def _polyhedron(points: Array) -> tuple[Array, Array, Array, list[Array]]:
    """Return the vertices, edges, faces and the sides of each face of the hull of points; see `Cores`."""
    hull = Hull(points)
    normals, offsets = hull.faces
    owner: dict[tuple[int, int], int] = {}
    for t, corner in enumerate(hull.triangles.tolist()):
        for k in range(3):
            owner[corner[k], corner[(k + 1) % 3]] = t
    face = np.full(len(normals), -1)
    planes: list[Array] = []
    for t in range(len(normals)):
        if face[t] >= 0:
            continue
        waiting, face[t] = [t], len(planes)
        while waiting:
            corner = hull.triangles[waiting.pop()].tolist()
            for k in range(3):
                other = owner[corner[(k + 1) % 3], corner[k]]
                if face[other] < 0 and np.linalg.norm(normals[other] - normals[t]) < _ONE_FACE:
                    face[other] = len(planes)
                    waiting.append(other)
        planes.append(np.array([*normals[t], offsets[t]]))
    edges, sides = [], [list[list[int]]() for _ in planes]
    for (a, b), t in owner.items():
        here, there = int(face[t]), int(face[owner[b, a]])
        if here != there:
            sides[here].append([a, b, there])
            if a < b:
                edges.append([a, b, here, there])
    return hull.vertices, np.array(edges), np.array(planes), [np.array(each) for each in sides]

"""Meshes for the replay: shapes, walls and arrows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import meshcat.geometry as g
import numpy as np

from ...geometry.shapes import Box, Capsule, Cylinder, Ellipsoid, HalfSpace, Hull, PlacedShape, Sphere
from ...geometry.triangles import Surface
from ...scene.meshes import Mesh

Array = np.ndarray

_SEGMENTS = 32
# of percussions; with friction of contacts that slip, and of those that stick
_ARROW_COLOR, _STICK_COLOR = 0xD81B4A, 0x1565C0
_CONE_OPACITY = 0.3
# of a sphere that rolls, and how dark every second one is
_STRIPES, _SHADE = 8, 0.45
_CHECKER = np.array([[0.80, 0.83, 0.85], [0.70, 0.74, 0.77]])
# cells along the longer side of the motion, and how far a wall reaches beyond it, in longer sides
_CELLS, _BEYOND = 12, 0.4
# three.js numbers the sides that are drawn
_FRONT, _BOTH = 0, 2
_SHEET_COLOR = 0x5A7D9A
# three.js cylinders lie along y
_Y_TO_Z = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def shape_mesh(placed: PlacedShape) -> tuple[g.Mesh, Array]:
    """Return the mesh of a shape in its color, and the rotation, shape (3, 3), from the mesh to the shape's frame."""
    shape, turn = placed.shape, np.eye(3)
    if isinstance(shape, Sphere):
        geometry = _Round((shape.radius,) * 3)
    elif isinstance(shape, Ellipsoid):
        geometry = _Round(shape.radii)
    elif isinstance(shape, Box):
        geometry = g.Box(shape.size)
    elif isinstance(shape, Cylinder):
        geometry, turn = g.Cylinder(shape.length, shape.radius), _Y_TO_Z
    elif isinstance(shape, Capsule):
        geometry = _capsule(shape)
    elif isinstance(shape, Mesh):
        geometry = g.TriangularMeshGeometry(shape.vertices, shape.triangles, shape.colors)
    else:
        geometry = g.TriangularMeshGeometry(shape.vertices, shape.triangles)
    colored = isinstance(shape, Mesh) and shape.colors is not None
    material = g.MeshPhongMaterial(
        # the colours of vertices are multiplied by this one
        color=0xFFFFFF if colored else _number_of(placed.color),
        vertexColors=colored,
        opacity=float(placed.color[3]),
        flatShading=isinstance(shape, Hull | Mesh),
        shininess=20,
    )
    return g.Mesh(geometry, material), turn


class _Round(g.Ellipsoid):
    """An ellipsoid in finer facets than meshcat's."""

    def lower(self, object_data: dict[str, Any]) -> dict[str, Any]:
        return {**super().lower(object_data), "widthSegments": _SEGMENTS, "heightSegments": _SEGMENTS // 2}


def arrow_mesh(*, sticks: bool = False) -> g.Mesh:
    """Return an arrow of length 1 along z in the color of its contact; it shines through whatever it is in."""
    profile = [(0.0, 0.0), (0.014, 0.0), (0.014, 0.82), (0.045, 0.82), (0.0, 1.0)]
    # only what counts as transparent is drawn after all else
    material = g.MeshBasicMaterial(color=_color(sticks), transparent=True, depthTest=False)
    return g.Mesh(_revolved(profile, 12), material)


def cone_mesh(*, sticks: bool) -> g.Mesh:
    """Return a cone of radius 1 and height 1 that opens along z from its tip, seen through."""
    material = g.MeshBasicMaterial(
        color=_color(sticks), transparent=True, opacity=_CONE_OPACITY, side=_BOTH, depthWrite=False
    )
    return g.Mesh(_revolved([(0.0, 0.0), (1.0, 1.0)], _SEGMENTS), material)


def striped(radius: float, color: Sequence[float]) -> tuple[g.Mesh, Array]:
    """Return a sphere with dark stripes from pole to pole, which show that it turns, and its scaling, shape (3, 3)."""
    down = np.linspace(0.0, np.pi, _SEGMENTS // 2 + 1)
    wide = _SEGMENTS // _STRIPES
    points, triangles, shades = list[Array](), list[Array](), list[Array]()
    for k in range(_STRIPES):
        # stripes share no corners, so that colors end at their edges
        around = 2.0 * np.pi * (k + np.arange(wide + 1) / wide) / _STRIPES
        ring = np.stack([np.cos(around), np.sin(around)], axis=1)
        first = len(points) * len(down) * (wide + 1)
        points.append(
            np.concatenate([np.column_stack([np.sin(d) * ring, np.full(len(ring), np.cos(d))]) for d in down])
        )
        corner = first + np.add.outer((wide + 1) * np.arange(len(down) - 1), np.arange(wide)).ravel()
        below = corner + wide + 1
        triangles += [np.stack([corner, below, below + 1], axis=1), np.stack([corner, below + 1, corner + 1], axis=1)]
        shades.append(np.full(points[-1].shape, _SHADE if k % 2 else 1.0))
    geometry = g.TriangularMeshGeometry(np.concatenate(points), np.concatenate(triangles), np.concatenate(shades))
    # the shades of corners are multiplied by this color
    material = g.MeshPhongMaterial(color=_number_of(color), vertexColors=True, opacity=float(color[3]), shininess=20)
    return g.Mesh(geometry, material), radius * np.eye(3)


def _number_of(color: Sequence[float]) -> int:
    red, green, blue = (round(255 * part) for part in color[:3])
    return red << 16 | green << 8 | blue


def _color(sticks: bool) -> int:
    return _STICK_COLOR if sticks else _ARROW_COLOR


def plate_mesh(wall: HalfSpace, others: Sequence[HalfSpace], lower: Array, upper: Array) -> g.Mesh:
    """Return the part of a half-space's plane near the motion, checkered, cut where other half-spaces begin.

    Parameters
    ----------
    wall : HalfSpace
        What to draw.
    others : sequence of HalfSpace
        The scene's other half-spaces.
    lower, upper : ndarray, shape (3,)
        Corners of the box of all motion [m].
    """
    normal = np.array(wall.normal)
    # one side of the cells is level, on a floor along x
    up = np.array([0.0, 1.0, 0.0] if abs(normal[2]) > 0.999 else [0.0, 0.0, 1.0])
    u = np.cross(up, normal)
    u /= np.linalg.norm(u)
    plane = np.stack([u, np.cross(normal, u)])
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * (upper - lower) + lower
    flat = corners @ plane.T
    longest = float((upper - lower).max())
    cell = _round_number(longest / _CELLS)
    first = np.floor((flat.min(axis=0) - _BEYOND * longest) / cell).astype(int)
    last = np.ceil((flat.max(axis=0) + _BEYOND * longest) / cell).astype(int)
    points: list[Array] = []
    triangles: list[tuple[int, int, int]] = []
    colors: list[Array] = []
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    for i in range(first[0], last[0]):
        for j in range(first[1], last[1]):
            polygon = wall.offset * normal + cell * (square + np.array([i, j])) @ plane
            for other in others:
                polygon = _cut(polygon, other)
            start = len(points)
            triangles += [(start, start + k, start + k + 1) for k in range(1, len(polygon) - 1)]
            points += list(polygon)
            colors += [_CHECKER[(i + j) % 2]] * len(polygon)
    geometry = g.TriangularMeshGeometry(
        np.reshape(points, (-1, 3)), np.reshape(triangles, (-1, 3)), np.reshape(colors, (-1, 3))
    )
    return g.Mesh(geometry, g.MeshLambertMaterial(side=_FRONT, vertexColors=True))


def sheet_mesh(surface: Surface) -> g.Mesh:
    """Return a mesh as it is, seen from both sides and through."""
    material = g.MeshPhongMaterial(
        color=_SHEET_COLOR, opacity=0.3, transparent=True, side=_BOTH, depthWrite=False, flatShading=True
    )
    return g.Mesh(g.TriangularMeshGeometry(surface.vertices, surface.triangles), material)


def _cut(polygon: Array, wall: HalfSpace) -> Array:
    """Return the part of a convex polygon, shape (n, 3), on the free side of a half-space."""
    gap = polygon @ np.array(wall.normal) - wall.offset
    kept = []
    for k in range(len(polygon)):
        here, there = gap[k - 1], gap[k]
        if (here < 0.0) != (there < 0.0):
            kept.append(polygon[k - 1] + here / (here - there) * (polygon[k] - polygon[k - 1]))
        if there >= 0.0:
            kept.append(polygon[k])
    return np.reshape(kept, (-1, 3))


def _round_number(length: float) -> float:
    """Return the largest of 1, 2, 5 times a power of ten that is not above a length."""
    power = 10.0 ** np.floor(np.log10(length))
    return power * max(n for n in (1.0, 2.0, 5.0) if n * power <= length * (1.0 + 1e-9))


def _capsule(shape: Capsule) -> g.Geometry:
    angles = np.linspace(-0.5 * np.pi, 0.5 * np.pi, _SEGMENTS // 2)
    ends = np.repeat([-0.5, 0.5], len(angles) // 2) * shape.length
    profile = np.stack([shape.radius * np.cos(angles), shape.radius * np.sin(angles) + ends], axis=1)
    return _revolved(profile, _SEGMENTS)


def _revolved(profile: Sequence[tuple[float, float]] | Array, segments: int) -> g.Geometry:
    """Return a profile of (radius, height), from bottom to top, turned about z."""
    radius, height = np.asarray(profile).T
    angle = 2.0 * np.pi * np.arange(segments) / segments
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points = np.concatenate(
        [np.column_stack([r * ring, np.full(segments, h)]) for r, h in zip(radius, height, strict=True)]
    )
    triangles = []
    for row in range(len(radius) - 1):
        for k in range(segments):
            a, b = row * segments + k, row * segments + (k + 1) % segments
            triangles += [(a, b, b + segments), (a, b + segments, a + segments)]
    return g.TriangularMeshGeometry(points, triangles)

"""Meshes for the replay: shapes, walls and arrows."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import meshcat.geometry as g
import numpy as np

from ...geometry.meshes.triangles import Surface
from ...geometry.shapes.picture import cut
from ...geometry.shapes.shapes import Box, Capsule, Cylinder, Ellipsoid, HalfSpace, Hull, PlacedShape, Sphere
from ...scene.meshes.visual import Mesh

Array = np.ndarray

_SEGMENTS = 32
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


class ShapeMesh(NamedTuple):
    """The mesh that shapes share, what tells it from others, and the map, shape (3, 3), from it to one shape."""

    mesh: g.Mesh
    key: tuple[Any, ...]
    scale: Array
    striped: bool = False


def shape_mesh(placed: PlacedShape, *, rolling: bool = False, coarse: bool = False) -> ShapeMesh:
    """Return the white mesh of a shape; boxes, cylinders and round shapes of all sizes share one of unit size.

    Parameters
    ----------
    placed : PlacedShape
        The shape.
    rolling : bool
        Whether a sphere has stripes, which show that it turns.
    coarse : bool
        Whether round shapes have a quarter of the facets, because there are many.
    """
    segments = _SEGMENTS // 2 if coarse else _SEGMENTS
    shape, opacity = placed.shape, float(placed.color[3])
    stripes = rolling and isinstance(shape, Sphere)
    scale, key = np.eye(3), tuple[Any, ...]()
    geometry: g.Geometry
    if isinstance(shape, Sphere | Ellipsoid):
        radii = (shape.radius,) * 3 if isinstance(shape, Sphere) else shape.radii
        geometry = _striped(segments) if stripes else _Round(segments)
        scale, key = np.diag(radii), ("round", stripes)
    elif isinstance(shape, Box):
        geometry, scale, key = g.Box((1.0, 1.0, 1.0)), np.diag(shape.size), ("box",)
    elif isinstance(shape, Cylinder):
        size = np.diag([shape.radius, shape.radius, shape.length])
        geometry, scale, key = g.Cylinder(1.0, 1.0), size @ _Y_TO_Z, ("cylinder",)
    elif isinstance(shape, Capsule):
        geometry, key = _capsule(shape), ("capsule", shape.radius, shape.length)
    else:
        colors = shape.colors if isinstance(shape, Mesh) else None
        geometry = g.TriangularMeshGeometry(shape.vertices, shape.triangles, colors)
        arrays = (shape.vertices, shape.triangles) if colors is None else (shape.vertices, shape.triangles, colors)
        key = ("mesh", *(np.ascontiguousarray(a).tobytes() for a in arrays))
    colored = stripes or (isinstance(shape, Mesh) and shape.colors is not None)
    material = g.MeshPhongMaterial(
        color=0xFFFFFF, vertexColors=colored, opacity=opacity, flatShading=isinstance(shape, Hull | Mesh), shininess=20
    )
    return ShapeMesh(g.Mesh(geometry, material), (*key, opacity), scale, stripes)


def shape_color(placed: PlacedShape) -> tuple[float, ...]:
    """Return red, green and blue by which the colors of a shape's mesh are multiplied."""
    own = isinstance(placed.shape, Mesh) and placed.shape.colors is not None
    return (1.0, 1.0, 1.0) if own else tuple(float(part) for part in placed.color[:3])


class _Round(g.Ellipsoid):
    """A unit sphere of some facets around its equator."""

    def __init__(self, segments: int) -> None:
        super().__init__((1.0, 1.0, 1.0))
        self._segments = segments

    def lower(self, object_data: dict[str, Any]) -> dict[str, Any]:
        return {**super().lower(object_data), "widthSegments": self._segments, "heightSegments": self._segments // 2}


def arrow_mesh() -> g.Mesh:
    """Return an arrow of length 1 along z; it shines through whatever it is in."""
    profile = [(0.0, 0.0), (0.014, 0.0), (0.014, 0.82), (0.045, 0.82), (0.0, 1.0)]
    # only what counts as transparent is drawn after all else
    return g.Mesh(_revolved(profile, 12), g.MeshBasicMaterial(color=0xFFFFFF, transparent=True, depthTest=False))


def normal_mesh() -> g.Mesh:
    """Return a rod of length 1 along z; it shines through whatever it is in."""
    profile = [(0.0, 0.0), (0.012, 0.0), (0.012, 1.0), (0.0, 1.0)]
    return g.Mesh(_revolved(profile, 8), g.MeshBasicMaterial(color=0xFFFFFF, transparent=True, depthTest=False))


def connection_mesh() -> g.Mesh:
    """Return a unit ball; it shines through whatever it is in."""
    return g.Mesh(_Round(_SEGMENTS // 2), g.MeshBasicMaterial(color=0xFFFFFF, transparent=True, depthTest=False))


def cone_mesh() -> g.Mesh:
    """Return a cone of radius 1 and height 1 that opens along z from its tip, seen through."""
    material = g.MeshBasicMaterial(
        color=0xFFFFFF, transparent=True, opacity=_CONE_OPACITY, side=_BOTH, depthWrite=False
    )
    return g.Mesh(_revolved([(0.0, 0.0), (1.0, 1.0)], _SEGMENTS), material)


@cache
def _striped(segments: int) -> g.Geometry:
    """Return a unit sphere with dark stripes from pole to pole."""
    down = np.linspace(0.0, np.pi, segments // 2 + 1)
    wide = segments // _STRIPES
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
    return g.TriangularMeshGeometry(np.concatenate(points), np.concatenate(triangles), np.concatenate(shades))


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
    cell = round_number(longest / _CELLS)
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
                polygon = cut(polygon, other)
            start = len(points)
            triangles += [(start, start + k, start + k + 1) for k in range(1, len(polygon) - 1)]
            points += list(polygon)
            colors += [_CHECKER[(i + j) % 2]] * len(polygon)
    geometry = g.TriangularMeshGeometry(
        np.reshape(points, (-1, 3)), np.reshape(triangles, (-1, 3)), np.reshape(colors, (-1, 3))
    )
    return g.Mesh(geometry, g.MeshLambertMaterial(side=_FRONT, vertexColors=True))


def sheet_mesh(surface: Surface) -> g.Mesh:
    """Return a mesh as it is, seen from both sides, and through unless it is solid."""
    seen = {} if surface.one_sided else {"opacity": 0.3, "transparent": True, "depthWrite": False}
    material = g.MeshPhongMaterial(color=_SHEET_COLOR, side=_BOTH, flatShading=True, **seen)
    return g.Mesh(g.TriangularMeshGeometry(surface.vertices, surface.triangles), material)


def round_number(length: float) -> float:
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

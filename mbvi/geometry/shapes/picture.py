"""A picture of shapes at their poses as SVG text, for notebooks: seen from afar, without perspective or shadows."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from ..meshes.triangles import Surface
from .polyhedra import Box, Hull
from .shapes import Array, Convex, HalfSpace

# from the scene to the eye, and to the light
_EYE = np.array([0.5, -0.8, 0.33]) / np.linalg.norm([0.5, -0.8, 0.33])
_LIGHT = np.array([0.3, -0.45, 0.84])
_RIGHT = np.cross([0.0, 0.0, 1.0], _EYE) / np.linalg.norm(np.cross([0.0, 0.0, 1.0], _EYE))
_UP = np.cross(_EYE, _RIGHT)
_SCREEN = np.stack([_RIGHT, -_UP])
# greatest width and height [pixels], and the margin around what moves, relative to its size
_WIDTH, _HEIGHT, _MARGIN = 480.0, 320.0, 0.12
# directions of the outline of a round shape
_OUTLINE = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
# shapes that are drawn, those nearest to the eye, and faces of hulls, beyond which these have outlines only
_MOST_SHAPES, _MOST_FACES = 3000, 4000
_WALL, _SURFACE = "#d3dae0", "#5a7d9a"


class Placed(NamedTuple):
    """A shape at its pose in the world, its color, and whether it moves."""

    shape: Convex
    rotation: Array
    position: Array
    color: tuple[float, ...]
    moves: bool


def picture(shapes: Sequence[Placed], walls: Sequence[HalfSpace], surfaces: Iterable[Surface]) -> str:
    """Return the picture, in which all that moves is seen, as the text of an svg element."""
    moving = [one for one in shapes if one.moves] or list(shapes)
    if not moving:
        return ""
    centre = np.array([one.position for one in moving])
    bound = np.array([[one.shape.bound] for one in moving])
    low, high = (centre - bound).min(axis=0), (centre + bound).max(axis=0)
    flat = np.concatenate([centre @ _SCREEN.T - bound, centre @ _SCREEN.T + bound])
    first, last = flat.min(axis=0), flat.max(axis=0)
    margin = _MARGIN * float((last - first).max())
    first, size = first - margin, last - first + 2.0 * margin
    scale = min(_WIDTH / size[0], _HEIGHT / size[1])
    width, height = np.maximum(np.round(scale * size), 1.0)
    made = _Drawing(first, scale)
    for wall in walls:
        made.wall(wall, [w for w in walls if w is not wall], low, high)
    # from the farthest to the nearest
    drawn = sorted(shapes, key=lambda one: float(one.position @ _EYE))[-_MOST_SHAPES:]
    faces = sum(len(one.shape.triangles) for one in drawn if isinstance(one.shape, Hull))
    for one in drawn:
        made.shape(one, faceted=isinstance(one.shape, Box) or faces <= _MOST_FACES)
    for surface in surfaces:
        made.surface(surface)
    size_of = f'width="{width:g}" height="{height:g}" viewBox="0 0 {width:g} {height:g}"'
    head = f'<svg xmlns="http://www.w3.org/2000/svg" role="img" stroke-linejoin="round" {size_of}>'
    return f"{head}{''.join(made.parts)}</svg>"


class _Drawing:
    """Polygons on the screen, in the order in which they are drawn."""

    def __init__(self, first: Array, scale: float) -> None:
        self.parts, self._first, self._scale = list[str](), first, scale

    def polygon(self, points: Array, fill: str, edge: str = "none", opacity: float = 1.0) -> None:
        """Draw a polygon of points in the world, shape (n, 3)."""
        where = self._scale * (points @ _SCREEN.T - self._first)
        text = " ".join(f"{x:.1f},{y:.1f}" for x, y in where)
        seen = f' opacity="{opacity:.2g}"' if opacity < 1.0 else ""
        self.parts.append(f'<polygon points="{text}" fill="{fill}" stroke="{edge}" stroke-width="0.6"{seen}/>')

    def wall(self, wall: HalfSpace, others: Sequence[HalfSpace], low: Array, high: Array) -> None:
        """Draw a half-space that the eye sees from its free side, near what moves, where others do not cut it off."""
        normal = np.array(wall.normal)
        if normal @ _EYE <= 0.0:
            return
        side = np.cross(normal, [0.0, 1.0, 0.0] if abs(normal[2]) > 0.9 else [0.0, 0.0, 1.0])
        side /= np.linalg.norm(side)
        plane = np.stack([side, np.cross(normal, side)])
        reach = 0.5 * float(np.linalg.norm(high - low)) * 1.3
        middle = 0.5 * (low + high)
        middle = middle + (wall.offset - normal @ middle) * normal
        polygon = middle + reach * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) @ plane
        for other in others:
            polygon = cut(polygon, other)
        if len(polygon):
            self.polygon(polygon, _WALL, "#aab4bd")

    def shape(self, one: Placed, *, faceted: bool) -> None:
        """Draw a shape: the faces of a polyhedron, or the outline."""
        edge, opacity = _color(one.color, 0.55), one.color[3]
        if isinstance(one.shape, Box | Hull) and faceted:
            vertices = one.shape.vertices @ one.rotation.T + one.position
            normals, offsets = one.shape.faces
            _, chosen = np.unique(np.round(normals, 6), axis=0, return_index=True)
            near = 1e-6 * one.shape.bound
            for k in chosen.tolist():
                normal = one.rotation @ normals[k]
                if normal @ _EYE > 0.0:
                    corner = vertices[one.shape.vertices @ normals[k] >= offsets[k] - near]
                    shade = 0.72 + 0.28 * float(normal @ _LIGHT)
                    self.polygon(
                        _around(corner), _color(one.color, shade), edge if len(chosen) < 30 else "none", opacity
                    )
            return
        self.polygon(_outline(one), _color(one.color, 0.95), edge, opacity)

    def surface(self, surface: Surface) -> None:
        """Draw the triangles of a mesh of the world, seen through, or only some of many."""
        corners = surface.vertices[surface.triangles]
        for triangle in corners[:: max(1, len(corners) // _MOST_FACES)]:
            self.polygon(triangle, _SURFACE, opacity=0.15)


def cut(polygon: Array, wall: HalfSpace) -> Array:
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


def _around(corner: Array) -> Array:
    """Return the corners of a face in the order of their angles on the screen."""
    flat = (corner - corner.mean(axis=0)) @ _SCREEN.T
    return corner[np.argsort(np.arctan2(flat[:, 1], flat[:, 0]))]


def _outline(one: Placed) -> Array:
    """Return the points of a shape that lie farthest to each side on the screen, shape (n, 3)."""
    centres, half_axes, radius = one.shape.support_points()
    sides = np.cos(_OUTLINE)[:, None] * _RIGHT + np.sin(_OUTLINE)[:, None] * _UP
    along = sides @ one.rotation
    reach = np.linalg.norm(along[:, None] * half_axes, axis=2)
    best = (along @ centres.T + reach).argmax(axis=1)
    rows = np.arange(len(sides))
    long = np.where(reach[rows, best] > 0.0, reach[rows, best], 1.0)[:, None]
    points = centres[best] + half_axes[best] ** 2 * along / long + radius * along
    return points @ one.rotation.T + one.position


def _color(color: Sequence[float], shade: float) -> str:
    return "#" + "".join(f"{round(255 * min(max(part * shade, 0.0), 1.0)):02x}" for part in color[:3])

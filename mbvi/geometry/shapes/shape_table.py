"""Placed shapes in arrays, which all lists of their pairs share."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ...arguments import Array
from ...compiled import kernel, record
from .hull_graph import DIRECTIONS, cell_of, guides_of, outermost, stack_graphs
from .seams import Seams, seams_of
from .shapes import Box, Capsule, Convex, Cylinder, Ellipsoid, Hull, PlacedShape, Sphere, graph_of, length_unit

# kinds of shapes: a capsule without length is a ball
BALL, CAPSULE, BOX, CYLINDER, OTHER = range(5)


class _Support(NamedTuple):
    """A shape as a Minkowski sum of simple sets, whose support functions add up.

    Attributes
    ----------
    box : tuple of float
        Half edges of a box.
    ball, disk : float
        Radii of a ball, and of a disk normal to z.
    ellipsoid : tuple of float
        Half axes of an ellipsoid.
    points : ndarray, shape (k, 3)
        Vertices of a convex hull.
    """

    box: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ball: float = 0.0
    disk: float = 0.0
    ellipsoid: tuple[float, float, float] = (0.0, 0.0, 0.0)
    points: Array = np.zeros((1, 3))


def _support(shape: Convex) -> _Support:
    """Return a shape as a Minkowski sum about the origin of its frame."""
    match shape:
        case Sphere():
            return _Support(ball=shape.radius)
        case Ellipsoid():
            return _Support(ellipsoid=shape.radii)
        case Box():
            a, b, c = shape.size
            return _Support(box=(0.5 * a, 0.5 * b, 0.5 * c))
        case Capsule():
            return _Support(box=(0.0, 0.0, 0.5 * shape.length), ball=shape.radius)
        case Cylinder():
            return _Support(box=(0.0, 0.0, 0.5 * shape.length), disk=shape.radius)
    return _Support(points=shape.vertices)


@record(
    "i8[::1], f8[:,:,::1], f8[:,::1], f8[:,::1], i8[::1], i8[::1], i8[::1], i8[::1], i8[::1], f8[:,::1], i8[:,::1],"
    " i8[:,::1], b1[::1], f8[:,::1], i8[:,::1]"
)
class Shapes(NamedTuple):
    """Placed shapes and pairs of them in arrays, as kernels take them.

    Attributes
    ----------
    frame : ndarray of int, shape (s,)
        The place of each shape's body in the placements; -1 for the world.
    fixed : ndarray, shape (s, 4, 3)
        Placements of the shapes in their bodies: columns of the rotation, then the origin.
    sizes : ndarray, shape (s, 8)
        Half edges of a box, radii of a ball and of a disk, half axes of an ellipsoid of each shape; see `_Support` [m].
    points, first_point : ndarray, shapes (k, 3) and (s + 1,)
        The points of all supports [m], and the first point of each shape.
    first, neighbour : ndarray of int, shapes (k + 1,) and (e,)
        Which points are neighbours on hulls of many vertices; see `hull_graph.outermost`.
    first_face, face : ndarray of int, shapes (k + 1,) and (e,)
        The faces at each vertex of a hull are `face[first_face[i] : first_face[i + 1]]`.
    planes : ndarray, shape (f, 4)
        Outward unit normal and offset of each face in its shape's frame.
    sides : ndarray of int, shape (n, 2)
        The shapes of each pair.
    start : ndarray of int, shape (n, 8)
        The outermost points of the shapes of each pair at the last call, then the corners of both shapes in up
        to three points of the last result, see `core_points`, -1 for others; written by kernels.
    taken : ndarray of bool, shape (k,)
        False for every point, between calls of kernels.
    inside : ndarray, shape (s, 4)
        Centre and radius of a ball inside each shape without its own ball, in its frame [m].
    guides : ndarray of int, shape (s, DIRECTIONS)
        The outermost point of each shape along directions of `hull_graph.cell_of`; -1 of those without a graph.
    """

    frame: Array
    fixed: Array
    sizes: Array
    points: Array
    first_point: Array
    first: Array
    neighbour: Array
    first_face: Array
    face: Array
    planes: Array
    sides: Array
    start: Array
    taken: Array
    inside: Array
    guides: Array


@kernel("i8(Shapes, i8, f8, f8, f8, i8)")
def outermost_of_shape(shapes: Shapes, shape: int, x: float, y: float, z: float, start: int) -> int:
    """Return the index of the point of a shape that is farthest along a direction, in the frame of the shape.

    The climb of `outermost` begins at a point that was outermost before, or at that of a direction nearby.
    """
    points, begin, end = shapes.points, shapes.first_point[shape], shapes.first_point[shape + 1]
    if shapes.guides[shape, 0] >= 0:
        k = shapes.guides[shape, cell_of(x, y, z)]
        here = points[start, 0] * x + points[start, 1] * y + points[start, 2] * z
        if points[k, 0] * x + points[k, 1] * y + points[k, 2] * z > here:
            start = k
    return outermost(points, begin, end, shapes.first, shapes.neighbour, x, y, z, start)


class ShapeTable:
    """Placed shapes with their sizes, kinds and places in arrays.

    Parameters
    ----------
    placed : sequence of PlacedShape
        The shapes.

    Attributes
    ----------
    placed : tuple of PlacedShape
        As given.
    body : ndarray of int, shape (s,)
        The body of each shape.
    bodies : ndarray of int
        The bodies other than the world, ascending.
    frame : ndarray of int, shape (s,)
        The place of each shape's body in `bodies`; -1 for the world.
    kind : ndarray of int, shape (s,)
        `BALL`, `CAPSULE`, `BOX`, `CYLINDER` or `OTHER`.
    bound, inner : ndarray, shape (s,)
        Radii of balls about the origin of each shape's frame that hold the shape, and that fit into it [m].
    smooth : ndarray of bool, shape (s,)
        Which shapes touch others in one point only.
    unit : float
        A power of two about as large as the shapes [m].
    """

    def __init__(self, placed: Sequence[PlacedShape]) -> None:
        self.placed = tuple(placed)
        self.body = np.array([s.body for s in placed], dtype=np.int64)
        self.bodies = np.unique(self.body[self.body > 0])
        self.frame = np.where(self.body > 0, np.searchsorted(self.bodies, self.body), -1)
        self.kind = np.array([_kind(s.shape) for s in placed], dtype=np.int64)
        self.bound, self.inner = (np.array([getattr(s.shape, a) for s in placed]) for a in ("bound", "inner"))
        self.smooth = np.array([s.shape.smooth for s in placed], dtype=bool)
        self.unit = length_unit(self.bound.tolist())

    def __len__(self) -> int:
        return len(self.placed)

    def __reduce__(self) -> tuple[type, tuple[tuple[PlacedShape, ...]]]:
        # the arrays are made again
        return type(self), (self.placed,)

    def name(self, first: int, second: int) -> str:
        """Return the name of a pair."""
        return f"{self.placed[first].name} | {self.placed[second].name}"

    def pairs(self, sides: Array) -> Shapes:
        """Return the shapes and some pairs of them, shape (n, 2), as kernels take them."""
        # what kernels write to is the list's own, so that lists can be used on several threads
        taken = np.zeros(len(self.arrays[3]), bool)
        start = np.full((len(sides), 8), -1)
        start[:, :2] = self.arrays[4][sides]
        fields: Any = (*self.arrays, sides, start, taken, self._balls, self._guides)
        return Shapes(*fields)

    @cached_property
    def arrays(self) -> tuple[Array, ...]:
        """The first fields of `Shapes`, up to `planes`."""
        return _arrays(self.placed, self._supports, self.frame)

    @cached_property
    def seams(self) -> Seams:
        """Where polyhedra of the world touch each other."""
        return seams_of(self.placed)

    @cached_property
    def _balls(self) -> Array:
        """The field `inside` of `Shapes`."""
        balls = [
            (
                *(s.shape.vertices.mean(axis=0) if isinstance(s.shape, Hull) else np.zeros(3)),
                s.shape.inner - support.ball,
            )
            for s, support in zip(self.placed, self._supports, strict=True)
        ]
        return np.array(balls, dtype=float).reshape(-1, 4)

    @cached_property
    def _guides(self) -> Array:
        """The last field of `Shapes`."""
        ends, first = self.arrays[4:6]
        guides = np.full((len(self), DIRECTIONS), -1)
        for k, (placed, a) in enumerate(zip(self.placed, ends.tolist(), strict=False)):
            if isinstance(placed.shape, Hull) and first[a + 1] > first[a]:
                guides[k] = a + placed.shape.kept(_guides_of_hull)
        return guides

    @cached_property
    def boxes(self) -> tuple[Array, Array]:
        """Centres and half edges of boxes along the axes of each shape's frame that hold it, shapes (s, 3) [m]."""
        low, high = (np.array([end(x.points, axis=0) for x in self._supports]) for end in (np.min, np.max))
        beyond = [np.add(x.box, x.ellipsoid) + x.ball + np.array([x.disk, x.disk, 0.0]) for x in self._supports]
        return 0.5 * (low + high), np.array(beyond) + 0.5 * (high - low)

    @cached_property
    def _supports(self) -> list[_Support]:
        return [_support(s.shape) for s in self.placed]


def indexed(first: Sequence[PlacedShape | None], second: Sequence[PlacedShape]) -> tuple[ShapeTable, Array]:
    """Return the table of the shapes of some pairs, and the places of the shapes of each pair in it, shape (n, 2).

    None stands for a half-space of the world; its place is -1.
    """
    placed = {s.name: s for s in (*first, *second) if s is not None}
    number = {name: k for k, name in enumerate(placed)}
    sides = [(-1 if a is None else number[a.name], number[b.name]) for a, b in zip(first, second, strict=True)]
    return ShapeTable(list(placed.values())), np.array(sides, dtype=np.int64).reshape(-1, 2)


def _kind(shape: Convex) -> int:
    match shape:
        case Sphere():
            return BALL
        case Capsule():
            return CAPSULE if shape.length > 0.0 else BALL
        case Box():
            return BOX
        case Cylinder():
            return CYLINDER
    return OTHER


def _guides_of_hull(hull: Hull) -> Array:
    return guides_of(hull.vertices)


def _triangles_at_vertices(hull: Hull) -> tuple[Array, Array]:
    """Return how many triangles each vertex of a hull has, and those triangles, one vertex after the other."""
    vertex = hull.triangles.ravel()
    return np.bincount(vertex, minlength=len(hull.vertices)), np.argsort(vertex, kind="stable") // 3


def _arrays(shapes: Sequence[PlacedShape], supports: Sequence[_Support], frame: Array) -> tuple[Array, ...]:
    """Return the first fields of `Shapes`, up to `planes`, for shapes on bodies with the given places."""
    first_face, face, planes, count = [0], [np.zeros(0, np.int64)], [np.zeros((0, 4))], 0
    for placed, support in zip(shapes, supports, strict=True):
        hull, entries = placed.shape, np.zeros(len(support.points), np.int64)
        if isinstance(hull, Hull):
            entries, triangles = hull.kept(_triangles_at_vertices)
            face.append(count + triangles)
            planes.append(np.column_stack(hull.faces))
            count += len(hull.triangles)
        first_face.extend((first_face[-1] + np.cumsum(entries)).tolist())
    return (
        frame,
        np.array([np.vstack([s.rotation.T, s.position]) for s in shapes]).reshape(-1, 4, 3),
        np.array([[*s.box, s.ball, s.disk, *s.ellipsoid] for s in supports]).reshape(-1, 8),
        np.concatenate([np.zeros((0, 3)), *(s.points for s in supports)]),
        np.cumsum([0, *(len(s.points) for s in supports)]),
        *stack_graphs([graph_of(s.shape, len(x.points)) for s, x in zip(shapes, supports, strict=True)]),
        np.array(first_face, dtype=np.int64),
        np.concatenate(face),
        np.concatenate(planes),
    )

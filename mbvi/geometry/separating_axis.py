"""Lower bounds on the distance of convex shapes by the last separating axis of each pair.

The distance of two shapes is at least the distance of their projections onto any unit vector n. The normal of the last
measured distance is kept in the frame of the first body. It separates the shapes for many steps, so that most pairs are
seldom measured again.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..arguments import Array
from ..compiled import kernel, record
from .hull_graph import outermost, stack_graphs
from .shapes import Box, Capsule, Convex, Cylinder, Ellipsoid, Hull, PlacedShape, Sphere, graph_of


def _support(shape: Convex) -> tuple[tuple[float, ...], Array]:
    """Return a shape as a Minkowski sum of simple sets, whose support functions add up: a row of `sizes`, and points.

    These sets are a box, a ball, a disk normal to z, an ellipsoid, and the convex hull of the points.
    """
    centre, none = np.zeros((1, 3)), (0.0, 0.0, 0.0)
    match shape:
        case Sphere():
            return (*none, shape.radius, 0.0, *none), centre
        case Ellipsoid():
            return (*none, 0.0, 0.0, *shape.radii), centre
        case Box():
            a, b, c = shape.size
            return (0.5 * a, 0.5 * b, 0.5 * c, 0.0, 0.0, *none), centre
        case Capsule():
            return (0.0, 0.0, 0.5 * shape.length, shape.radius, 0.0, *none), centre
        case Cylinder():
            return (0.0, 0.0, 0.5 * shape.length, 0.0, shape.radius, *none), centre
    return (0.0,) * 8, shape.vertices


@record(
    "i8[::1], f8[:,:,::1], f8[:,::1], f8[:,::1], i8[::1], i8[::1], i8[::1], i8[::1], i8[::1], f8[:,::1], i8[:,::1],"
    " i8[:,::1], b1[::1], f8[:,::1]"
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
        Half edges of a box, radii of a ball and of a disk, half axes of an ellipsoid of each shape; see `_support` [m].
    points, first_point : ndarray, shapes (k, 3) and (s + 1,)
        Vertices of hulls, and centres of other shapes [m], and the first point of each shape.
    first, neighbour : ndarray of int, shapes (k + 1,) and (e,)
        Which points are neighbours on hulls of many vertices; see `hull_graph.outermost`.
    first_face, face : ndarray of int, shapes (k + 1,) and (e,)
        The faces at each vertex of a hull are `face[first_face[i] : first_face[i + 1]]`.
    planes : ndarray, shape (f, 4)
        Outward unit normal and offset of each face in its shape's frame.
    sides : ndarray of int, shape (n, 2)
        The shapes of each pair.
    start : ndarray of int, shape (n, 2)
        The outermost points of the shapes of each pair at the last call; written by kernels.
    taken : ndarray of bool, shape (k,)
        False for every point, between calls of kernels.
    inside : ndarray, shape (s, 4)
        Centre and radius of a ball inside each hull, in its frame; the radius is 0 for other shapes [m].
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


def _tables(shapes: Sequence[PlacedShape], frame: Array, sides: Array) -> Shapes:
    """Return the arrays of some shapes on bodies with the given places, and of pairs of them."""
    sizes, points = zip(*(_support(s.shape) for s in shapes), strict=True) if shapes else ((), ())
    first_face, face, planes, count = [0], [np.zeros(0, np.int64)], [np.zeros((0, 4))], 0
    for placed, its in zip(shapes, points, strict=True):
        hull, entries = placed.shape, np.zeros(len(its), np.int64)
        if isinstance(hull, Hull):
            vertex = hull.triangles.ravel()
            entries = np.bincount(vertex, minlength=len(its))
            face.append(count + np.argsort(vertex, kind="stable") // 3)
            planes.append(np.column_stack(hull.faces))
            count += len(hull.triangles)
        first_face.extend((first_face[-1] + np.cumsum(entries)).tolist())
    first_point = np.cumsum([0, *map(len, points)])
    inside = [
        (*s.shape.vertices.mean(axis=0), s.shape.inner) if isinstance(s.shape, Hull) else (0.0,) * 4 for s in shapes
    ]
    return Shapes(
        frame,
        np.array([np.vstack([s.rotation.T, s.position]) for s in shapes]).reshape(-1, 4, 3),
        np.array(sizes, dtype=float).reshape(-1, 8),
        np.concatenate([np.zeros((0, 3)), *points]),
        first_point,
        *stack_graphs([graph_of(s.shape, len(its)) for s, its in zip(shapes, points, strict=True)]),
        np.array(first_face, dtype=np.int64),
        np.concatenate(face),
        np.concatenate(planes),
        sides,
        first_point[sides],
        np.zeros(first_point[-1], bool),
        np.array(inside, dtype=float).reshape(-1, 4),
    )


@kernel("void(f8[:,:,::1], i8[::1], f8[:,:,::1], i8, f8[:,::1])")
def place_shape(places: Array, frame: Array, fixed: Array, shape: int, world: Array) -> None:
    """Write where a shape is, shape (4, 3): columns of its rotation, then its origin. See `Shapes`."""
    for k in range(4):
        for c in range(3):
            world[k, c] = fixed[shape, k, c]
            if frame[shape] >= 0:
                P, f = places[frame[shape]], fixed[shape, k]
                world[k, c] = f[0] * P[0, c] + f[1] * P[1, c] + f[2] * P[2, c]
                world[k, c] += P[3, c] if k == 3 else 0.0


@kernel("void(f8[:,:,::1], Shapes, i8, f8[:,:,::1])")
def place_pair(places: Array, shapes: Shapes, pair: int, world: Array) -> None:
    """Write where the shapes of a pair are, shape (2, 4, 3); see `place_shape`."""
    for side in range(2):
        place_shape(places, shapes.frame, shapes.fixed, shapes.sides[pair, side], world[side])


@kernel("f8(f8[:,::1], f8[::1], Shapes, i8, i8)")
def reach(place: Array, n: Array, shapes: Shapes, pair: int, side: int) -> float:
    """Return how far a shape of a pair reaches from the world's origin towards the other shape [m].

    Parameters
    ----------
    place : ndarray, shape (4, 3)
        Placement of the shape: columns of its rotation, then its origin.
    n : ndarray, shape (3,)
        The unit vector from the first shape to the second.
    shapes : Shapes
        The search begins at `start[pair, side]`, which receives the outermost point.
    pair, side : int
        Which shape of which pair it is.
    """
    # slices of arrays would cost as much as the rest
    s, points, sizes = shapes.sides[pair, side], shapes.points, shapes.sizes
    u, v, w = (n[0], n[1], n[2]) if side == 0 else (-n[0], -n[1], -n[2])
    x = place[0, 0] * u + place[0, 1] * v + place[0, 2] * w
    y = place[1, 0] * u + place[1, 1] * v + place[1, 2] * w
    z = place[2, 0] * u + place[2, 1] * v + place[2, 2] * w
    begin, end = shapes.first_point[s], shapes.first_point[s + 1]
    k = outermost(points, begin, end, shapes.first, shapes.neighbour, x, y, z, shapes.start[pair, side])
    shapes.start[pair, side] = k
    far = points[k, 0] * x + points[k, 1] * y + points[k, 2] * z
    far += place[3, 0] * u + place[3, 1] * v + place[3, 2] * w
    far += abs(x) * sizes[s, 0] + abs(y) * sizes[s, 1] + abs(z) * sizes[s, 2] + sizes[s, 3]
    if sizes[s, 4] > 0.0:
        far += sizes[s, 4] * np.sqrt(x * x + y * y)
    if sizes[s, 5] > 0.0:
        far += np.sqrt((sizes[s, 5] * x) ** 2 + (sizes[s, 6] * y) ** 2 + (sizes[s, 7] * z) ** 2)
    return far


@kernel("f8(f8[:,:,::1], Shapes, i8, f8[::1])")
def pair_separation(world: Array, shapes: Shapes, pair: int, n: Array) -> float:
    """Return the separation of the two shapes of a pair along a unit vector from the first to the second [m].

    `world`, shape (2, 4, 3), says where they are. The climbs begin at `start`, which receives the outermost points.
    """
    return -(reach(world[1], n, shapes, pair, 1) + reach(world[0], n, shapes, pair, 0))


@kernel("void(f8[:,:,::1], i8, f8[:,::1], i8, f8[::1])")
def axis_in_world(places: Array, body: int, axis: Array, pair: int, n: Array) -> None:
    """Write the axis of a pair, which is given in the frame of its first body; -1 stands for the world."""
    for c in range(3):
        n[c] = axis[pair, c]
        if body >= 0:
            P = places[body]
            n[c] = axis[pair, 0] * P[0, c] + axis[pair, 1] * P[1, c] + axis[pair, 2] * P[2, c]


@kernel("i8(f8[:,:,::1], Tuple(Shapes), f8[:,::1], i8[::1], f8, f8[::1], i8[::1])")
def _clear(
    places: Array, tables: tuple[Array, ...], axis: Array, candidates: Array, tolerance: float, bound: Array,
    unresolved: Array,
) -> int:  # fmt: skip
    """Write lower bounds of the distances of pairs whose axes separate them; list the other pairs.

    Parameters
    ----------
    places : ndarray, shape (b, 4, 3)
        Placements of the bodies: columns of the rotation, then the origin.
    tables : tuple
        The fields of `Shapes`.
    axis : ndarray, shape (n, 3)
        Unit vectors from the first shape to the second, in the first's body; NaN where none is known.
    candidates : ndarray of int, shape (d,)
        The pairs.
    tolerance : float
        Gap at and below which a pair is active [m].
    bound : ndarray, shape (n,)
        Receives the bounds of the pairs that are separated by more than the tolerance [m].
    unresolved : ndarray of int, shape (d,)
        Receives the other pairs, in its first places.

    Returns
    -------
    int
        How many other pairs there are.
    """
    shapes, count, n, world = Shapes(*tables), 0, np.empty(3), np.empty((2, 4, 3))
    for i in range(len(candidates)):
        pair, gap = candidates[i], -np.inf
        if axis[pair, 0] == axis[pair, 0]:
            place_pair(places, shapes, pair, world)
            axis_in_world(places, shapes.frame[shapes.sides[pair, 0]], axis, pair, n)
            gap = pair_separation(world, shapes, pair, n)
        if gap > tolerance:
            bound[pair] = gap
        else:
            unresolved[count] = pair
            count += 1
    return count


@kernel("void(f8[:,:,::1], i8[::1], i8[:,::1], f8[:,::1], i8[::1], f8[:,::1])")
def _keep(places: Array, frame: Array, sides: Array, axis: Array, pairs: Array, normals: Array) -> None:
    """Write normals, shape (k, 3), as the axes of some pairs; the other arguments as of `_clear`."""
    for i in range(len(pairs)):
        body = frame[sides[pairs[i], 0]]
        for c in range(3):
            x = normals[i, c]
            if body >= 0:
                x = 0.0
                for k in range(3):
                    x += places[body, c, k] * normals[i, k]
            axis[pairs[i], c] = x


class SeparatingAxes:
    """One axis for each pair: the normal of its last measured distance.

    Parameters
    ----------
    shapes : sequence of PlacedShape
        The shapes.
    sides : ndarray of int, shape (n, 2)
        The two shapes of each pair.

    Attributes
    ----------
    bodies : ndarray of int
        The bodies other than the world, ascending: methods expect their placements in this order.
    frame : ndarray of int
        The place of each shape's body in `bodies`; -1 for the world.
    shapes : Shapes
        Their arrays.
    tables : tuple
        The same as a plain tuple, which kernels take faster.
    axis : ndarray, shape (n, 3)
        The axes in the frames of the first bodies; NaN where none is known.
    """

    def __init__(self, shapes: Sequence[PlacedShape], sides: Array) -> None:
        moving = sorted({s.body for s in shapes if s.body})
        self.bodies = np.array(moving, dtype=np.int64)
        self.frame = np.array([moving.index(s.body) if s.body else -1 for s in shapes], dtype=np.int64)
        self.shapes = _tables(shapes, self.frame, sides)
        self.tables = tuple(self.shapes)
        self.axis = np.full((len(sides), 3), np.nan)

    def clear(self, places: Array, candidates: Array, tolerance: float, bound: Array) -> Array:
        """Return the candidates that their axes do not separate; write lower bounds of the distances of the others.

        `places`, shape (b, 4, 3), are the placements of `bodies`.
        """
        unresolved = np.empty(len(candidates), np.int64)
        count = _clear(places, self.tables, self.axis, candidates, tolerance, bound, unresolved)
        return unresolved[:count]

    def keep(self, places: Array, pairs: Array, normals: Array) -> None:
        """Keep measured normals, shape (k, 3), as the axes of some pairs."""
        _keep(places, self.frame, self.shapes.sides, self.axis, pairs, normals)

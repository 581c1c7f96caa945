"""Features of convex shapes along a direction: their outermost points and faces, and where lines leave the shapes.

Each shape is described as in `separating_axis._support`.
"""

from __future__ import annotations

import numpy as np

from ...arguments import Array
from ...compiled import kernel
from ..broad.separating_axis import Shapes
from ..vectors import dot
from .hull_graph import connected
from .shape_table import outermost_of_shape
from .shapes import TILTED

# least cosine of a line with the normal of a face through which it leaves: others are nearly parallel to it
FACING = 0.1
# directions in which the rim of a disk has fixed points
_RIM = 12


@kernel("i8(f8[:,::1], f8[::1], f8, f8, f8, f8, f8[:,::1], i8)")
def _gather(place: Array, n: Array, lowest: float, x: float, y: float, z: float, found: Array, count: int) -> int:
    """Write a point of a shape, moved to the world, if it reaches `lowest` along n; return how many there are then."""
    if count == len(found):
        return count
    along = 0.0
    for c in range(3):
        found[count, c] = x * place[0, c] + y * place[1, c] + z * place[2, c] + place[3, c]
        along += found[count, c] * n[c]
    return count + 1 if along >= lowest else count


@kernel("i8(f8[:,::1], Shapes, i8, i8, f8[::1], f8, f8[:,::1], i8[::1])")
def near_vertices(
    place: Array, shapes: Shapes, pair: int, side: int, n: Array, depth: float, found: Array, vertices: Array
) -> int:
    """Write the vertices of a hull within a depth of the outermost one along n, and their numbers; return how many.

    The hull is one side of a pair. The outermost vertex goes first.
    """
    s, points = shapes.sides[pair, side], shapes.points
    begin, end = shapes.first_point[s], shapes.first_point[s + 1]
    x, y, z = dot(place[0], n), dot(place[1], n), dot(place[2], n)
    best = outermost_of_shape(shapes, s, x, y, z, shapes.start[pair, side])
    lowest = points[best, 0] * x + points[best, 1] * y + points[best, 2] * z - depth
    count = connected(
        points, begin, end, shapes.first, shapes.neighbour, x, y, z, best, lowest, len(found), vertices, shapes.taken
    )
    for i in range(count):
        p = points[vertices[i]]
        for c in range(3):
            found[i, c] = p[0] * place[0, c] + p[1] * place[1, c] + p[2] * place[2, c] + place[3, c]
    return count


@kernel("i8(f8[:,::1], f8[::1], f8[::1], f8, f8[:,::1])")
def near_corners(place: Array, sizes: Array, n: Array, depth: float, found: Array) -> int:
    """Write the points of a shape that is no hull within a depth of the outermost one along n; return how many.

    Of a box these are corners; of a capsule, ends of a line on its side; of a cylinder, such ends, or points of a rim.
    """
    x, y, z, ball, disk = dot(place[0], n), dot(place[1], n), dot(place[2], n), sizes[3], sizes[4]
    across = np.sqrt(x * x + y * y)
    top = abs(x) * sizes[0] + abs(y) * sizes[1] + abs(z) * sizes[2] + ball + disk * across
    top += np.sqrt((sizes[5] * x) ** 2 + (sizes[6] * y) ** 2 + (sizes[7] * z) ** 2)
    lowest, count = top - depth + dot(place[3], n), 0
    swell = top - abs(x) * sizes[0] - abs(y) * sizes[1] - abs(z) * sizes[2] - ball - disk * across
    for corner in range(8):
        i, j, k = corner & 1, corner >> 1 & 1, corner >> 2 & 1
        # a half edge of zero has one end
        if (i and sizes[0] == 0.0) or (j and sizes[1] == 0.0) or (k and sizes[2] == 0.0):
            continue
        u, v = (2 * i - 1) * sizes[0] + ball * x, (2 * j - 1) * sizes[1] + ball * y
        w = (2 * k - 1) * sizes[2] + ball * z
        if swell > 0.0:
            u += sizes[5] ** 2 * x / swell
            v += sizes[6] ** 2 * y / swell
            w += sizes[7] ** 2 * z / swell
        if disk == 0.0:
            count = _gather(place, n, lowest, u, v, w, found, count)
            continue
        if across > 0.0:
            count = _gather(place, n, lowest, u + disk * x / across, v + disk * y / across, w, found, count)
        if across < TILTED:
            for turn in range(_RIM):
                angle = 2.0 * np.pi * turn / _RIM
                count = _gather(place, n, lowest, u + disk * np.cos(angle), v + disk * np.sin(angle), w, found, count)
    return count


@kernel("f8(f8[::1], f8[::1], f8)")
def _leave_ball(point: Array, direction: Array, radius: float) -> float:
    """Return the distance from a point to where a line along a unit vector leaves a ball about 0 [m]."""
    along = dot(point, direction)
    return np.sqrt(max(along * along - dot(point, point) + radius * radius, 0.0)) - along


@kernel("f8[:,::1](f8[:,::1], Shapes, i8, i8[::1], i8, f8[:,::1], f8)")
def lines_out(
    place: Array, shapes: Shapes, shape: int, vertices: Array, count: int, frame: Array, height: float
) -> Array:  # fmt: skip
    """Return how far lines run to the faces at the first `count` vertices of a hull, shape (f, 3).

    Parameters
    ----------
    place, shapes, shape
        The hull.
    vertices : ndarray of int, shape (g,)
        The vertices.
    count : int
        How many of them.
    frame : ndarray, shape (3, 3)
        The direction of the lines, and two directions of a plane across it.
    height : float
        How far the plane is from the world's origin along the direction [m].

    Returns
    -------
    ndarray, shape (f, 3)
        From the point x, y of the plane the line runs as far as the least of a + x b + y c, one row for each face [m].
    """
    first_face, face, planes, size = shapes.first_face, shapes.face, shapes.planes, 0
    # each face is a triangle, and is listed at three vertices
    begin, end = first_face[shapes.first_point[shape]] // 3, first_face[shapes.first_point[shape + 1]] // 3
    listed = np.zeros(end - begin, np.bool_)
    for i in range(count):
        size += first_face[vertices[i] + 1] - first_face[vertices[i]]
    # in the frame of the shape: the direction, the plane's, and the plane's origin
    local, found, kept = np.empty((4, 3)), np.empty((size, 3)), 0
    for k in range(3):
        apart = 0.0
        for c in range(3):
            apart += place[k, c] * (height * frame[0, c] - place[3, c])
        local[3, k] = apart
        for j in range(3):
            local[j, k] = dot(place[k], frame[j])
    for i in range(count):
        for j in range(first_face[vertices[i]], first_face[vertices[i] + 1]):
            if listed[face[j] - begin]:
                continue
            listed[face[j] - begin] = True
            plane = planes[face[j]]
            slope = plane[0] * local[0, 0] + plane[1] * local[0, 1] + plane[2] * local[0, 2]
            if slope > FACING:
                ahead = plane[3]
                for k in range(3):
                    ahead -= plane[k] * local[3, k]
                found[kept, 0] = ahead / slope
                for c in range(1, 3):
                    along = plane[0] * local[c, 0] + plane[1] * local[c, 1] + plane[2] * local[c, 2]
                    found[kept, c] = -along / slope
                kept += 1
    return found[:kept]


@kernel("f8(f8[:,::1], f8, f8)")
def least_line(lines: Array, x: float, y: float) -> float:
    """Return the least of `lines_out` at a point [m]."""
    length = np.inf
    for i in range(len(lines)):
        length = min(length, lines[i, 0] + x * lines[i, 1] + y * lines[i, 2])
    return length


@kernel("f8(f8[:,::1], Shapes, i8, f8[::1], f8[::1])")
def leave(place: Array, shapes: Shapes, shape: int, point: Array, n: Array) -> float:
    """Return the distance from a point to where the line along n leaves a shape that is no hull [m]."""
    sizes = shapes.sizes[shape]
    x = y = z = 0.0
    for c in range(3):
        apart = point[c] - place[3, c]
        x, y, z = x + place[0, c] * apart, y + place[1, c] * apart, z + place[2, c] * apart
    u, v, w = dot(place[0], n), dot(place[1], n), dot(place[2], n)
    length = np.inf
    local, way = np.empty(3), np.empty(3)
    if sizes[3] > 0.0:
        # a capsule, seen from the nearest point of its axis
        local[0], local[1], local[2] = x, y, z - min(max(z, -sizes[2]), sizes[2])
        way[0], way[1], way[2] = u, v, w
        return _leave_ball(local, way, sizes[3])
    if abs(w) > FACING:
        length = min(length, (sizes[2] - np.sign(w) * z) / abs(w))
    if sizes[4] > 0.0:
        across = np.sqrt(u * u + v * v)
        if across > FACING:
            local[0], local[1], local[2] = x, y, 0.0
            way[0], way[1], way[2] = u / across, v / across, 0.0
            length = min(length, _leave_ball(local, way, sizes[4]) / across)
        return length
    if abs(u) > FACING:
        length = min(length, (sizes[0] - np.sign(u) * x) / abs(u))
    if abs(v) > FACING:
        length = min(length, (sizes[1] - np.sign(v) * y) / abs(v))
    return length


@kernel("f8(f8[:,::1], Shapes, i8, i8, f8[::1], f8[::1])")
def facing(place: Array, shapes: Shapes, pair: int, side: int, n: Array, normal: Array) -> float:
    """Write the outward normal, in the world, of the face of a shape that faces n most; return its cosine with n.

    The shape is one side of a pair. Of a hull the faces at the vertex `start` are looked at, which must be the
    outermost one along n. A shape without faces returns -1.
    """
    sizes, vertex, most = shapes.sizes[shapes.sides[pair, side]], shapes.start[pair, side], -1.0
    first, end = shapes.first_face[vertex], shapes.first_face[vertex + 1]
    u, v, w, x, y, z = dot(place[0], n), dot(place[1], n), dot(place[2], n), 0.0, 0.0, 0.0
    if end > first:
        for i in range(first, end):
            plane = shapes.planes[shapes.face[i]]
            along = plane[0] * u + plane[1] * v + plane[2] * w
            if along > most:
                most, x, y, z = along, plane[0], plane[1], plane[2]
    elif sizes[4] > 0.0:
        most, z = abs(w), 1.0 if w > 0.0 else -1.0
    elif sizes[0] > 0.0 and sizes[1] > 0.0:
        most = max(abs(u), abs(v), abs(w))
        if abs(u) == most:
            x = 1.0 if u > 0.0 else -1.0
        elif abs(v) == most:
            y = 1.0 if v > 0.0 else -1.0
        else:
            z = 1.0 if w > 0.0 else -1.0
    if most > -1.0:
        for c in range(3):
            normal[c] = x * place[0, c] + y * place[1, c] + z * place[2, c]
    return most

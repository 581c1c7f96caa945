"""Kernels of rows that keep their features: vertices, edges, faces, the axes and rims of round shapes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...compiled import kernel, record
from ...system.mechanisms.frames import cross_product, turned

Array = np.ndarray

# which features touch: a vertex of the first shape and a face of the second, the reverse, or two edges
VERTEX_FACE, FACE_VERTEX, EDGES = range(3)
# the rim of a disc and a face; an edge, or an axis, and a vertex, or the end of an axis; two of the latter. The number
# between these and the others is that of limits of joints
FACE_RIM, RIM_FACE, LINE_VERTEX, VERTEX_LINE, POINTS = range(4, 9)
# sine of the angle between a disc and a face below which any point of the rim counts as the lowest
LEVEL = 1e-9


@kernel("UniTuple(f8, 3)(f8[::1], f8[::1])")
def lowest_of_rim(n: Array, axis: Array) -> tuple[float, float, float]:
    """Return the way from the centre of a disc to the lowest point of its rim along n; `axis` has its radius as length.

    Both have shape (3,).
    """
    square = axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2]
    radius, s = np.sqrt(square), (n[0] * axis[0] + n[1] * axis[1] + n[2] * axis[2]) / square
    x, y, z = n[0] - s * axis[0], n[1] - s * axis[1], n[2] - s * axis[2]
    size = np.sqrt(x * x + y * y + z * z)
    if size <= LEVEL:
        x, y, z = cross_product(axis[0], axis[1], axis[2], 1.0, 0.0, 0.0)
        if x * x + y * y + z * z < 0.25 * square:
            x, y, z = cross_product(axis[0], axis[1], axis[2], 0.0, 1.0, 0.0)
        size = np.sqrt(x * x + y * y + z * z)
    share = -radius / size
    return share * x, share * y, share * z


@kernel("f8(i8, f8[:,:,::1], f8, f8[:,::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1])")
def touch(
    kind: int, parts: Array, radius: float, first: Array, second: Array, along: Array, point: Array, normal: Array
) -> float:  # fmt: skip
    """Write where two features touch; return their gap [m].

    Parameters
    ----------
    kind : int
        Which features touch.
    parts : ndarray, shape (2, 2, 3)
        A point and a direction on either body, in its frame; see `FeatureRows`. Of a disc they are its centre and its
        axis, whose length is the radius.
    radius : float
        What surfaces lie outside vertices and axes [m].
    first, second : ndarray, shape (4, 3)
        Placements of the bodies.
    along : ndarray, shape (2, 3)
        Receives the directions in the world.
    point, normal : ndarray, shape (3,)
        Receive the contact point, on the feature itself, and the normal from the first to the second body.
    """
    along[0, 0], along[0, 1], along[0, 2] = turned(first, parts[0, 1, 0], parts[0, 1, 1], parts[0, 1, 2])
    along[1, 0], along[1, 1], along[1, 2] = turned(second, parts[1, 1, 0], parts[1, 1, 1], parts[1, 1, 2])
    a, b, c = turned(first, parts[0, 0, 0], parts[0, 0, 1], parts[0, 0, 2])
    x, y, z = turned(second, parts[1, 0, 0], parts[1, 0, 1], parts[1, 0, 2])
    a, b, c = a + first[3, 0], b + first[3, 1], c + first[3, 2]
    x, y, z = x + second[3, 0] - a, y + second[3, 1] - b, z + second[3, 2] - c
    moved = 1.0 if kind == FACE_VERTEX or kind == FACE_RIM or kind == LINE_VERTEX else 0.0
    if kind == EDGES:
        d, e = along[0], along[1]
        n0, n1, n2 = cross_product(d[0], d[1], d[2], e[0], e[1], e[2])
        square = n0 * n0 + n1 * n1 + n2 * n2
        s0, s1, s2 = cross_product(x, y, z, e[0], e[1], e[2])
        # the nearest point of the first line
        share, size = (s0 * n0 + s1 * n1 + s2 * n2) / square, np.sqrt(square)
        normal[0], normal[1], normal[2] = n0 / size, n1 / size, n2 / size
        point[0], point[1], point[2] = a + share * d[0], b + share * d[1], c + share * d[2]
    elif kind >= LINE_VERTEX:
        u, v, w = x, y, z
        if kind != POINTS:
            line = along[0 if kind == LINE_VERTEX else 1]
            share = x * line[0] + y * line[1] + z * line[2]
            u, v, w = x - share * line[0], y - share * line[1], z - share * line[2]
        size = np.sqrt(u * u + v * v + w * w)
        normal[0], normal[1], normal[2] = u / size, v / size, w / size
        point[0], point[1], point[2] = a + moved * x, b + moved * y, c + moved * z
    else:
        side = 1 if kind == VERTEX_FACE or kind == RIM_FACE else 0
        normal[0], normal[1], normal[2] = along[side, 0], along[side, 1], along[side, 2]
        if kind == FACE_RIM:
            d0, d1, d2 = lowest_of_rim(normal, along[1])
            x, y, z = x + d0, y + d1, z + d2
        elif kind == RIM_FACE:
            # the highest point of the rim is opposite
            d0, d1, d2 = lowest_of_rim(normal, along[0])
            a, b, c, x, y, z = a - d0, b - d1, c - d2, x + d0, y + d1, z + d2
        point[0], point[1], point[2] = a + moved * x, b + moved * y, c + moved * z
    return normal[0] * x + normal[1] * y + normal[2] * z - radius


@record("f8[:,::1], i8[:,:,::1], f8[:,::1], i8[:,::1]")
class Surfaces(NamedTuple):
    """The surfaces that the features of k rows are on.

    Attributes
    ----------
    planes : ndarray, shape (n, 4)
        Outward normals and offsets of faces, in frames of bodies.
    faces : ndarray of int, shape (k, 2, 2)
        Of each row where the faces of either shape begin and end.
    directions : ndarray, shape (m, 3)
        What `bounding_directions` returns.
    bounds : ndarray of int, shape (k, 3)
        Of each row where its directions begin and end, and which shape they belong to.
    """

    planes: Array
    faces: Array
    directions: Array
    bounds: Array


@kernel("void(i8[::1], f8[::1], f8[:,:,:,::1], f8[::1], f8[:,::1], f8[:,::1], Surfaces, f8[::1])")
def write_outside(
    kind: Array, radius: Array, places: Array, gap: Array, point: Array, normal: Array, surfaces: Surfaces,
    outside: Array,
) -> None:  # fmt: skip
    """Write how far the contact points of some rows are outside the features that they are on, beyond their gaps.

    Parameters
    ----------
    kind, radius, places, gap, point, normal
        As of `touch_each`.
    surfaces : Surfaces
        Those of these rows.
    outside : ndarray, shape (k,)
        Receives the lengths [m].
    """
    for i in range(len(kind)):
        outside[i] = -np.inf
        for side in range(2):
            # vertices, and ends of axes, are on their shapes
            if kind[i] == POINTS or kind[i] == (FACE_VERTEX if side == 1 else VERTEX_FACE):
                continue
            if kind[i] == (LINE_VERTEX if side == 1 else VERTEX_LINE):
                continue
            P = places[i, side]
            x, y, z = point[i, 0] - P[3, 0], point[i, 1] - P[3, 1], point[i, 2] - P[3, 2]
            u = P[0, 0] * x + P[0, 1] * y + P[0, 2] * z
            v = P[1, 0] * x + P[1, 1] * y + P[1, 2] * z
            w = P[2, 0] * x + P[2, 1] * y + P[2, 2] * z
            for f in range(surfaces.faces[i, side, 0], surfaces.faces[i, side, 1]):
                n = surfaces.planes[f]
                outside[i] = max(outside[i], n[0] * u + n[1] * v + n[2] * w - n[3])
        begin, end, side = surfaces.bounds[i]
        for b in range(begin, end):
            # from the polyhedron to the centre of the round shape
            d, along = surfaces.directions[b], radius[i] if side == 0 else -radius[i]
            x, y, z = turned(places[i, side], d[0], d[1], d[2])
            outside[i] = max(outside[i], along * (normal[i, 0] * x + normal[i, 1] * y + normal[i, 2] * z))
        outside[i] -= abs(gap[i])


@kernel("void(i8[::1], f8[:,:,:,::1], f8[::1], f8[:,:,:,::1], f8[:,:,::1], f8[::1], f8[:,::1], f8[:,::1])")
def touch_each(
    kind: Array, parts: Array, radius: Array, places: Array, along: Array, gap: Array, point: Array, normal: Array
) -> None:  # fmt: skip
    """Write `touch` of several rows: placements (k, 2, 4, 3), directions (k, 2, 3), gaps (k,), the others (k, 3)."""
    for i in range(len(kind)):
        gap[i] = touch(kind[i], parts[i], radius[i], places[i, 0], places[i, 1], along[i], point[i], normal[i])

"""Which features of a convex core and of a bent mesh touch: vertices, edges and faces, with a normal both can have.

A core vertex touches a triangle, a peak touches a face of the core, and an edge of the core crosses a ridge. Flat edges
and valleys have no rows of their own, so that nothing stops at an edge between two triangles of one face.

Two features can be separated along several normals. Where the end of one is about to pass another one, or has sunk in
less along another normal, the row of this other normal is the one that counts (`_outdone`): a box that slides over a
trench with its lowest face 1e-9 m too low is not stopped by the far side.
"""

from __future__ import annotations

import numpy as np

from ...arguments import Array
from ...compiled import kernel
from ..meshes.creases import RIDGE, VALLEY, Creases
from ..shapes.convex_cores import Cores

# sine of an angle by which a normal may lie beyond those that a feature can have
BESIDE = 1e-6
# sine of the angle of two edges below which they do not cross
_CROSS = 1e-3
# share of an edge beyond its ends at which another that crosses there is looked at more closely
_SLACK = 1e-6
# cosine of the angle of two normals above which neither hinders a body that should pass along the other
_ALIKE = 0.95


@kernel("f8(f8[:,:,::1], i8, i8, f8, f8, f8)")
def above(planes: Array, t: int, k: int, x: float, y: float, z: float) -> float:
    """Return the height of a point above plane k of triangle t of `Creases.planes` [m]."""
    return planes[t, k, 0] * x + planes[t, k, 1] * y + planes[t, k, 2] * z - planes[t, k, 3]


@kernel("b1(f8[:,:,::1], i8, f8[::1], f8)")
def looks_at(planes: Array, t: int, middle: Array, height: float) -> bool:
    """Return whether a core's middle is above a triangle, and farther than its point of a height [m]."""
    return above(planes, t, 0, middle[0], middle[1], middle[2]) > max(height, 0.0)


@kernel("b1(Creases, i8, f8, f8, f8, f8)")
def in_cone(mesh: Creases, peak: int, x: float, y: float, z: float, beside: float) -> bool:
    """Return whether a unit vector is one of the normals that a peak can have, or beside these by a sine."""
    for i in range(mesh.first[peak], mesh.first[peak + 1]):
        if mesh.edges[i, 0] * x + mesh.edges[i, 1] * y + mesh.edges[i, 2] * z > beside:
            return False
    return True


@kernel("b1(Creases, i8, i8, f8, f8, f8)")
def in_arc(mesh: Creases, t: int, k: int, x: float, y: float, z: float) -> bool:
    """Return whether a unit vector across the ridge at edge k of triangle t is one of the normals it can have."""
    planes, u = mesh.planes, mesh.beyond[t, k]
    if planes[t, 1 + k, 0] * x + planes[t, 1 + k, 1] * y + planes[t, 1 + k, 2] * z > BESIDE:
        return False
    if u < 0:
        return planes[t, 0, 0] * x + planes[t, 0, 1] * y + planes[t, 0, 2] * z >= -BESIDE
    j = 1 + shared_side(mesh, u, t)
    return planes[u, j, 0] * x + planes[u, j, 1] * y + planes[u, j, 2] * z <= BESIDE


@kernel("i8(Creases, i8, i8)")
def shared_side(mesh: Creases, u: int, t: int) -> int:
    """Return which edge of triangle u it shares with triangle t."""
    return 0 if mesh.beyond[u, 0] == t else (1 if mesh.beyond[u, 1] == t else 2)


@kernel("b1(f8, f8, f8, f8)")
def _outdone(gap: float, other: float, alike: float, margin: float) -> bool:
    """Return whether a row gives way to one of another gap, whose normal has a cosine of `alike` with its own.

    Of features that overlap the one that has sunk in less counts; one that is apart gives way to one that touches.
    """
    return alike < _ALIKE and (other > gap if gap <= 0.0 else other >= -margin)


@kernel("b1(Creases, f8[::1], i8, f8[:,::1], i8, f8, f8, f8, f8)")
def on_triangle(
    mesh: Creases, middle: Array, t: int, points: Array, i: int, height: float, inner: float, margin: float, eps: float
) -> bool:
    """Return whether a vertex of a polyhedron, at a height above triangle t, touches this triangle.

    Parameters
    ----------
    mesh : Creases
    middle : ndarray, shape (3,)
        Middle of the core.
    t : int
        The triangle.
    points, i
        Vertices in the world, and the number of this one.
    height : float
        Its height above the triangle's plane [m].
    inner, margin, eps : float
        The greatest depth; how far features give way to others; rounding [m].
    """
    planes, x, y, z = mesh.planes, points[i, 0], points[i, 1], points[i, 2]
    if not looks_at(planes, t, middle, height):
        return False
    for k in range(3):
        side, bend, u = above(planes, t, 1 + k, x, y, z), mesh.bend[t, k], mesh.beyond[t, k]
        if side < -eps:
            if bend != VALLEY:
                return False
            # in the corner below both triangles of a valley both count
            if side < -margin and (
                height > margin or side < -inner or above(planes, u, 1 + shared_side(mesh, u, t), x, y, z) > margin
            ):
                return False
        elif bend == RIDGE and side <= margin + max(-height, 0.0):
            other = above(planes, u, 0, x, y, z)
            if looks_at(planes, u, middle, other):
                alike = -1.0
                if height > 0.0:
                    alike = planes[t, 0, 0] * planes[u, 0, 0] + planes[t, 0, 1] * planes[u, 0, 1]
                    alike += planes[t, 0, 2] * planes[u, 0, 2]
                if _outdone(height, other, alike, margin):
                    return False
    return True


@kernel("b1(Creases, Cores, i8, i8, f8[:,::1], f8[:,::1], i8, i8, f8, f8, f8)")
def on_core_face(
    mesh: Creases, cores: Cores, first_point: int, first_face: int, points: Array, faces: Array, face: int, peak: int,
    gap: float, margin: float, eps: float,
) -> bool:  # fmt: skip
    """Return whether the vertex `peak` of a mesh, a gap outside of the plane of a core's face, touches this face.

    Parameters
    ----------
    mesh, cores
        The mesh and all cores.
    first_point, first_face : int
        The first vertex and face of the core in `cores`.
    points, faces : ndarray, shapes (n, 3) and (f, 4)
        Vertices and faces of the core in the world.
    face, peak, gap, margin, eps
        The face of the core, the vertex of the mesh; see `on_triangle`.
    """
    x, y, z = mesh.vertices[peak, 0], mesh.vertices[peak, 1], mesh.vertices[peak, 2]
    p, q, r = faces[face, 0], faces[face, 1], faces[face, 2]
    if not in_cone(mesh, mesh.peak[peak], -p, -q, -r, BESIDE):
        return False
    for i in range(cores.first_side[first_face + face], cores.first_side[first_face + face + 1]):
        a, b = cores.sides[i, 0] - first_point, cores.sides[i, 1] - first_point
        u, v, w = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]
        length = np.sqrt(u * u + v * v + w * w)
        side = (q * w - r * v) * (x - points[a, 0]) + (r * u - p * w) * (y - points[a, 1])
        side = (side + (p * v - q * u) * (z - points[a, 2])) / length
        if side < -eps:
            return False
        if side <= margin + max(-gap, 0.0):
            j = cores.sides[i, 2] - first_face
            other = faces[j, 0] * x + faces[j, 1] * y + faces[j, 2] * z - faces[j, 3]
            alike = -1.0
            if gap > 0.0:
                alike = p * faces[j, 0] + q * faces[j, 1] + r * faces[j, 2]
            if _outdone(gap, other, alike, margin) and in_cone(
                mesh, mesh.peak[peak], -faces[j, 0], -faces[j, 1], -faces[j, 2], BESIDE
            ):
                return False
    return True


@kernel("b1(f8[:,::1], i8, i8, f8[:,::1], i8, i8, f8, f8[::1])")
def crossing(points: Array, a: int, b: int, vertices: Array, c: int, d: int, eps: float, out: Array) -> bool:
    """Write where the lines of two edges are nearest to each other; return whether that is within both edges.

    Parameters
    ----------
    points, a, b, vertices, c, d
        Vertices of the core and of the mesh, and which ones are the ends of each edge.
    eps : float
        Rounding [m].
    out : ndarray, shape (12,)
        Receives the point on the first edge, the unit vector across both edges, the distance along it from the second
        edge to the first; then distances from the ends a, b, c and d [m].
    """
    u0, u1, u2 = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]
    w0, w1, w2 = vertices[d, 0] - vertices[c, 0], vertices[d, 1] - vertices[c, 1], vertices[d, 2] - vertices[c, 2]
    r0, r1, r2 = vertices[c, 0] - points[a, 0], vertices[c, 1] - points[a, 1], vertices[c, 2] - points[a, 2]
    n0, n1, n2 = u1 * w2 - u2 * w1, u2 * w0 - u0 * w2, u0 * w1 - u1 * w0
    square = n0 * n0 + n1 * n1 + n2 * n2
    # shares of both edges, times the square
    s = (r1 * w2 - r2 * w1) * n0 + (r2 * w0 - r0 * w2) * n1 + (r0 * w1 - r1 * w0) * n2
    t = (r1 * u2 - r2 * u1) * n0 + (r2 * u0 - r0 * u2) * n1 + (r0 * u1 - r1 * u0) * n2
    if min(s, t) < -_SLACK * square or max(s, t) > (1.0 + _SLACK) * square:
        return False
    one, two = np.sqrt(u0 * u0 + u1 * u1 + u2 * u2), np.sqrt(w0 * w0 + w1 * w1 + w2 * w2)
    sine = np.sqrt(square)
    if sine < _CROSS * one * two:
        return False
    s, t = s / square, t / square
    if s * one < -eps or t * two < -eps or (s - 1.0) * one > eps or (t - 1.0) * two > eps:
        return False
    out[0], out[1], out[2] = points[a, 0] + s * u0, points[a, 1] + s * u1, points[a, 2] + s * u2
    out[3], out[4], out[5] = n0 / sine, n1 / sine, n2 / sine
    out[6] = -(out[3] * r0 + out[4] * r1 + out[5] * r2)
    out[7], out[8], out[9], out[10] = s * one, (1.0 - s) * one, t * two, (1.0 - t) * two
    return True


@kernel("b1(f8[:,::1], f8[:,::1], i8, i8, i8, i8, f8, f8[::1])")
def crossing_beyond(vertices: Array, points: Array, a: int, b: int, c: int, d: int, eps: float, out: Array) -> bool:
    """Do what `crossing` does, where the edge of the mesh is longer at both ends by that of the core.

    Distances from the ends c and d are below zero beyond them.
    """
    longer, one, two = np.empty((2, 3)), 0.0, 0.0
    for i in range(3):
        one, two = one + (points[b, i] - points[a, i]) ** 2, two + (vertices[d, i] - vertices[c, i]) ** 2
    more, two = np.sqrt(one), np.sqrt(two)
    for i in range(3):
        along = more / two * (vertices[d, i] - vertices[c, i])
        longer[0, i], longer[1, i] = vertices[c, i] - along, vertices[d, i] + along
    if not crossing(points, a, b, longer, 0, 1, eps, out):
        return False
    out[9], out[10] = out[9] - more, out[10] - more
    return True


@kernel("b1(Creases, Cores, i8, i8, f8[:,::1], f8[:,::1], f8[::1], i8, i8, i8, f8, f8, f8[::1])")
def across_ridge(
    mesh: Creases, cores: Cores, first_point: int, first_face: int, points: Array, faces: Array, middle: Array, t: int,
    k: int, edge: int, margin: float, eps: float, out: Array,
) -> bool:  # fmt: skip
    """Return whether an edge of a core touches the ridge at edge k of triangle t; write point, normal and distance.

    Parameters
    ----------
    mesh, cores, first_point, first_face, points, faces, middle, margin, eps
        See `on_core_face` and `on_triangle`.
    t, k, edge : int
        The ridge, and the edge in `cores`.
    out : ndarray, shape (12,)
        See `crossing`; the normal leads from the mesh to the core.
    """
    a, b = cores.edges[edge, 0] - first_point, cores.edges[edge, 1] - first_point
    c, d = mesh.triangles[t, k], mesh.triangles[t, (k + 1) % 3]
    if not crossing(points, a, b, mesh.vertices, c, d, eps, out) and not (
        cores.edges[edge, 2] >= 0 and crossing_beyond(mesh.vertices, points, a, b, c, d, eps, out)
    ):
        return False
    planes, u = mesh.planes, mesh.beyond[t, k]
    outward = 0.0
    for i in range(3):
        outward += out[3 + i] * (planes[t, 0, i] + (planes[u, 0, i] if u >= 0 else -planes[t, 1 + k, i]))
    if outward < 0.0:
        for i in range(3, 7):
            out[i] = -out[i]
    x, y, z, gap = out[3], out[4], out[5], out[6]
    if not in_arc(mesh, t, k, x, y, z):
        return False
    for end in range(2):
        v = c if end == 0 else d
        # beyond an end is the solid if the mesh rises there above what the normal is across to: in the corner of a hole
        if out[9 + end] < -eps and (
            gap > margin
            or out[9 + end] < -margin - max(-gap, 0.0)
            or (mesh.peak[v] >= 0 and in_cone(mesh, mesh.peak[v], x, y, z, BESIDE))
        ):
            return False
    if cores.edges[edge, 2] < 0:
        return gap > 0.0
    e0, e1, e2 = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]
    length, along, near = out[7] + out[8], out[9] + out[10], margin + max(-gap, 0.0)
    # an end from which its edge goes on inwards is not what touches there, and has no row that would count instead
    for turn in range(2):
        j = cores.edges[edge, 2 + turn] - first_face
        p, q, r = faces[j, 0], faces[j, 1], faces[j, 2]
        into = (q * e2 - r * e1) * x + (r * e0 - p * e2) * y + (p * e1 - q * e0) * z
        if (into if turn == 0 else -into) < -BESIDE * length:
            return False
        for end in range(2):
            v = c if end == 0 else d
            if out[9 + end] <= near and mesh.peak[v] >= 0:
                other = p * mesh.vertices[v, 0] + q * mesh.vertices[v, 1] + r * mesh.vertices[v, 2] - faces[j, 3]
                o = d if end == 0 else c
                beyond = p * mesh.vertices[o, 0] + q * mesh.vertices[o, 1] + r * mesh.vertices[o, 2] - faces[j, 3]
                alike = -(p * x + q * y + r * z)
                if (
                    beyond >= other - BESIDE * along
                    and _outdone(gap, other, alike, margin)
                    and in_cone(mesh, mesh.peak[v], -p, -q, -r, BESIDE)
                ):
                    return False
            v, o, w = (a if end == 0 else b), (b if end == 0 else a), (t if turn == 0 else u)
            if out[7 + end] <= near and w >= 0:
                other = above(planes, w, 0, points[v, 0], points[v, 1], points[v, 2])
                beyond = above(planes, w, 0, points[o, 0], points[o, 1], points[o, 2])
                alike = planes[w, 0, 0] * x + planes[w, 0, 1] * y + planes[w, 0, 2] * z
                if (
                    beyond >= other - BESIDE * length
                    and _outdone(gap, other, alike, margin)
                    and looks_at(planes, w, middle, other)
                ):
                    return False
    return True


@kernel("b1(Creases, i8, f8[:,::1], i8, f8)")
def above_triangle(mesh: Creases, t: int, points: Array, i: int, eps: float) -> bool:
    """Return whether the foot of a point on the plane of a triangle lies within the triangle."""
    x, y, z = points[i, 0], points[i, 1], points[i, 2]
    for k in range(1, 4):
        if above(mesh.planes, t, k, x, y, z) < -eps:
            return False
    return True


@kernel("f8(f8[:,::1], i8, f8[:,::1], i8, i8, f8[::1])")
def from_segment(points: Array, i: int, ends: Array, a: int, b: int, out: Array) -> float:
    """Write the unit vector from the nearest point of a segment's inside to a point; return the distance [m].

    The distance is -1 if the nearest point is an end. A segment whose ends are one is a point.
    """
    u0, u1, u2 = ends[b, 0] - ends[a, 0], ends[b, 1] - ends[a, 1], ends[b, 2] - ends[a, 2]
    r0, r1, r2 = points[i, 0] - ends[a, 0], points[i, 1] - ends[a, 1], points[i, 2] - ends[a, 2]
    square = u0 * u0 + u1 * u1 + u2 * u2
    if a != b:
        share = (u0 * r0 + u1 * r1 + u2 * r2) / square
        if not 0.0 <= share <= 1.0:
            return -1.0
        r0, r1, r2 = r0 - share * u0, r1 - share * u1, r2 - share * u2
    distance = np.sqrt(r0 * r0 + r1 * r1 + r2 * r2)
    if distance == 0.0:
        return -1.0
    out[3], out[4], out[5], out[6] = r0 / distance, r1 / distance, r2 / distance, distance
    return distance

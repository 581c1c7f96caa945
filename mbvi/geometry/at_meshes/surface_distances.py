"""Distances of convex cores from a triangle mesh that is solid behind its triangles."""

from __future__ import annotations

import numpy as np

from ...arguments import Array
from ...compiled import kernel
from ..meshes.creases import Creases
from ..meshes.triangles import FEW
from ..shapes.convex_cores import Cores
from .cores_at_mesh import CoresAtMesh, place_core
from .mesh_tree import box_apart
from .near_triangles import nearest_on_triangle
from .surface_features import above, crossing, from_segment

_DEEPEST = 64


@kernel("f8(Cores, i8, i8, f8[:,::1], f8[:,::1], i8, f8, f8, f8, f8)")
def height_over_face(
    cores: Cores, first_point: int, first_face: int, points: Array, faces: Array, face: int, x: float, y: float,
    z: float, most: float,
) -> float:  # fmt: skip
    """Return the height of a point over a face of a core, if it is below `most` and its foot in the face; else -1."""
    p, q, r = faces[face, 0], faces[face, 1], faces[face, 2]
    height = p * x + q * y + r * z - faces[face, 3]
    if height < 0.0 or height >= most:
        return -1.0
    for i in range(cores.first_side[first_face + face], cores.first_side[first_face + face + 1]):
        a, b = cores.sides[i, 0] - first_point, cores.sides[i, 1] - first_point
        u, v, w = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]
        side = (q * w - r * v) * (x - points[a, 0]) + (r * u - p * w) * (y - points[a, 1])
        if side + (p * v - q * u) * (z - points[a, 2]) < 0.0:
            return -1.0
    return height


@kernel("b1(f8[:,::1], i8, i8, f8[:,::1], i8[:,::1], i8, f8)")
def is_far(points: Array, a: int, b: int, vertices: Array, triangles: Array, t: int, best: float) -> bool:
    """Return whether a box about two points is farther than a distance from one about a triangle, along an axis."""
    i, j, k = triangles[t, 0], triangles[t, 1], triangles[t, 2]
    for c in range(3):
        x, y, z = vertices[i, c], vertices[j, c], vertices[k, c]
        p, q = points[a, c], points[b, c]
        if min(p, q) - max(x, y, z) >= best or min(x, y, z) - max(p, q) >= best:
            return True
    return False


@kernel("f8(Creases, Cores, i8, i8, f8[:,::1], f8[:,::1], f8, f8[::1], f8[::1], f8[::1])")
def nearer(
    mesh: Creases, cores: Cores, s: int, t: int, points: Array, faces: Array, best: float, found: Array, out: Array,
    heights: Array,
) -> float:  # fmt: skip
    """Return the distance of core s from triangle t if it is below `best`, else `best`; write where that is.

    Parameters
    ----------
    mesh, cores, s, t, points, faces
        See `all_rows`.
    best : float
        The least distance so far [m].
    found : ndarray, shape (6,)
        Receives the nearest point of the core, and the unit vector to it from that of the triangle.
    out, heights : ndarray, shapes (12,) and (n,)
        Scratch; the heights of vertices above the triangle's plane, than which they are no nearer to it.
    """
    first, face, corners, x = cores.first_point[s], cores.first_face[s], mesh.triangles, mesh.vertices
    number, lowest = cores.first_point[s + 1] - first, np.inf
    for i in range(number):
        heights[i] = above(mesh.planes, t, 0, points[i, 0], points[i, 1], points[i, 2])
        lowest = min(lowest, heights[i])
    if lowest >= best:
        return best
    for i in range(number):
        if heights[i] >= best or is_far(points, i, i, x, corners, t, best):
            continue
        _, far = nearest_on_triangle(x, corners, t, points, i, out)
        if 0.0 < far < best:
            best = far
            for c in range(3):
                found[c], found[3 + c] = points[i, c], (points[i, c] - out[c]) / far
    for e in range(cores.first_edge[s], cores.first_edge[s + 1]):
        a, b = cores.edges[e, 0] - first, cores.edges[e, 1] - first
        if min(heights[a], heights[b]) >= best or is_far(points, a, b, x, corners, t, best):
            continue
        for k in range(3):
            c, d = corners[t, k], corners[t, (k + 1) % 3]
            if crossing(points, a, b, x, c, d, 0.0, out) and 0.0 < abs(out[6]) < best:
                best = abs(out[6])
                for i in range(3):
                    found[i], found[3 + i] = out[i], out[3 + i] if out[6] > 0.0 else -out[3 + i]
            far = from_segment(x, c, points, a, b, out)
            if 0.0 < far < best:
                best = far
                for i in range(3):
                    found[i], found[3 + i] = x[c, i] - far * out[3 + i], -out[3 + i]
    for f in range(cores.first_face[s + 1] - face):
        for k in range(3):
            c = corners[t, k]
            far = height_over_face(cores, first, face, points, faces, f, x[c, 0], x[c, 1], x[c, 2], best)
            if 0.0 < far < best:
                best = far
                for i in range(3):
                    found[i], found[3 + i] = x[c, i] - far * faces[f, i], -faces[f, i]
    return best


@kernel("void(CoresAtMesh, f8[:,:,::1], i8[::1], f8[::1], f8[:,::1], f8[:,::1])")
def surface_distances(
    at: CoresAtMesh, places: Array, some: Array, distance: Array, point: Array, normal: Array
) -> None:
    """Write the distances of some cores from a mesh that they do not overlap; infinite behind all triangles.

    Parameters
    ----------
    at, places, some
        See `surface_contacts`.
    distance, point, normal : ndarray, shapes (k,), (k, 3), (k, 3)
        Receive, of each of them, the distance, the core's nearest point, and the unit vector to it from the mesh.
    """
    mesh, table, stack, found = at.mesh, at.cores, np.empty(_DEEPEST, np.int64), np.empty(6)
    points, faces, out, heights = at.points, at.faces, at.out, np.empty(len(at.points))
    low, high, middle, leaves = np.empty(3), np.empty(3), np.empty(3), len(mesh.boxes) // 2
    for n in range(len(some)):
        s = some[n]
        place_core(places, table, s, points, faces, middle)
        radius, number, best = table.sizes[s, 3], table.first_point[s + 1] - table.first_point[s], np.inf
        for c in range(3):
            found[c], found[3 + c] = middle[c], 1.0 if c == 2 else 0.0
            low[c], high[c] = points[0, c], points[0, c]
            for i in range(1, number):
                low[c], high[c] = min(low[c], points[i, c]), max(high[c], points[i, c])
        stack[0], waiting = 1, 1
        while waiting > 0:
            waiting -= 1
            k = stack[waiting]
            # written so that an empty box, at an infinite distance, is left out
            if not box_apart(mesh.boxes, k, low, high) < best:
                continue
            if k < leaves:
                far = 2 * k
                if box_apart(mesh.boxes, far, low, high) < box_apart(mesh.boxes, far + 1, low, high):
                    far += 1
                stack[waiting], stack[waiting + 1] = far, far ^ 1
                waiting += 2
                continue
            begin = (k - leaves) * FEW
            for j in range(begin, min(begin + FEW, len(mesh.order))):
                t = mesh.order[j]
                if above(mesh.planes, t, 0, middle[0], middle[1], middle[2]) > 0.0:
                    best = nearer(mesh, table, s, t, points, faces, best, found, out, heights)
        distance[n] = best - radius
        for c in range(3):
            point[n, c], normal[n, c] = found[c] - radius * found[3 + c], found[3 + c]

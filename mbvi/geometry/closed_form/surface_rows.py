"""Contacts of convex cores with a triangle mesh that is solid behind its triangles; see `surface_features`."""

from __future__ import annotations

import numpy as np

from ...arguments import Array
from ...compiled import kernel
from ..meshes.creases import Creases
from ..meshes.triangles import FEW
from ..narrow.spread import BESIDE, FEW_POINTS, FLAT, few_corners, one_face, spread_out
from ..shapes.convex_cores import Cores
from ..shapes.shapes import TILTED
from ..vectors import within_plane
from .surface_features import (
    above,
    above_triangle,
    across_ridge,
    from_segment,
    in_arc,
    in_cone,
    on_core_face,
    on_triangle,
)

# the most boxes that wait in a search: one for each time that the number of triangles is halved, and one more
_DEEPEST = 64
# one less the cosine of the angle of two normals that are the same
_SAME = 1e-12
# rows nearer to each other than this are one, relative to the radius of the shape
_EQUAL = 1e-9
# how far features give way to others, relative to the radius of a ball inside the shape
_MARGIN = 1e-3


@kernel("i8(Creases, f8[::1], f8[::1], i8[::1])")
def triangles_in_box(mesh: Creases, low: Array, high: Array, found: Array) -> int:
    """List the triangles whose boxes meet a box, ascending by their places in the tree; count all if room is short.

    Parameters
    ----------
    mesh : Creases
    low, high : ndarray, shape (3,)
        Least and largest coordinates of the box [m].
    found : ndarray of int, shape (k,)
        Receives the triangles.
    """
    boxes, leaves, stack, count = mesh.boxes, len(mesh.boxes) // 2, np.empty(_DEEPEST, np.int64), 0
    stack[0], waiting = 1, 1
    while waiting > 0:
        waiting -= 1
        k, apart = stack[waiting], False
        for c in range(3):
            # an empty box is apart from all
            apart = apart or boxes[k, c] > high[c] or boxes[k, 3 + c] < low[c]
        if apart:
            continue
        if k < leaves:
            stack[waiting], stack[waiting + 1] = 2 * k + 1, 2 * k
            waiting += 2
            continue
        begin = (k - leaves) * FEW
        for j in range(begin, min(begin + FEW, len(mesh.order))):
            t, apart = mesh.order[j], False
            a, b, d = mesh.triangles[t, 0], mesh.triangles[t, 1], mesh.triangles[t, 2]
            for c in range(3):
                x, y, z = mesh.vertices[a, c], mesh.vertices[b, c], mesh.vertices[d, c]
                apart = apart or min(x, y, z) > high[c] or max(x, y, z) < low[c]
            if not apart:
                if count < len(found):
                    found[count] = t
                count += 1
    return count


@kernel("void(f8[:,:,::1], Cores, i8, f8[:,::1], f8[:,::1], f8[::1])")
def place_core(places: Array, cores: Cores, s: int, points: Array, faces: Array, middle: Array) -> None:
    """Write the vertices, the faces and the middle of core s in the world.

    Parameters
    ----------
    places : ndarray, shape (b, 4, 3)
        Placements of the bodies: columns of the rotation, then the origin.
    points, faces, middle : ndarray, shapes (n, 3), (f, 4) and (3,)
        Receive them in their first places.
    """
    f, first, face = cores.frame[s], cores.first_point[s], cores.first_face[s]
    for c in range(3):
        middle[c] = places[f, 3, c]
        for k in range(3):
            middle[c] += cores.sizes[s, k] * places[f, k, c]
        for i in range(cores.first_point[s + 1] - first):
            points[i, c] = places[f, 3, c]
            for k in range(3):
                points[i, c] += cores.points[first + i, k] * places[f, k, c]
        for i in range(cores.first_face[s + 1] - face):
            faces[i, c] = 0.0
            for k in range(3):
                faces[i, c] += cores.faces[face + i, k] * places[f, k, c]
    for i in range(cores.first_face[s + 1] - face):
        faces[i, 3] = cores.faces[face + i, 3]
        for c in range(3):
            faces[i, 3] += faces[i, c] * places[f, 3, c]


@kernel("b1(Creases, i8, i8, f8[::1], f8[::1], f8)")
def edge_near(mesh: Creases, a: int, b: int, low: Array, high: Array, around: float) -> bool:
    """Return whether the box about an edge of the mesh meets another box that is widened [m]."""
    for c in range(3):
        x, y = mesh.vertices[a, c], mesh.vertices[b, c]
        if min(x, y) > high[c] + around or max(x, y) < low[c] - around:
            return False
    return True


@kernel("i8(f8[:,::1], i8, f8, f8, f8, f8, f8[::1])")
def _add(rows: Array, count: int, gap: float, x: float, y: float, z: float, out: Array) -> int:
    """Write a row of a gap, a point of the core and the normal in `out`, if there is room; return the new count."""
    if count < len(rows):
        rows[count, 0], rows[count, 1], rows[count, 2], rows[count, 3] = gap, x, y, z
        for c in range(3):
            rows[count, 4 + c] = out[3 + c]
    return count + 1


@kernel("i8(Creases, Cores, i8, i8, f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8[::1], f8, f8, f8[:,::1], i8, f8[::1])")
def sharp_rows(
    mesh: Creases, cores: Cores, s: int, t: int, points: Array, faces: Array, middle: Array, low: Array, high: Array,
    tolerance: float, eps: float, rows: Array, count: int, out: Array,
) -> int:  # fmt: skip
    """Add the rows of a polyhedron, in a box, with the ridges and peaks of one triangle; see `all_rows`."""
    first, face, inner = cores.first_point[s], cores.first_face[s], cores.sizes[s, 4]
    for k in range(3):
        p, around = mesh.triangles[t, k], tolerance + eps
        if mesh.ridge[t, k] >= 0 and edge_near(mesh, p, mesh.triangles[t, (k + 1) % 3], low, high, around):
            for e in range(cores.first_edge[s], cores.first_edge[s + 1]):
                found = across_ridge(
                    mesh, cores, first, face, points, faces, middle, t, k, e, _MARGIN * inner, eps, out
                )
                if found and -inner <= out[6] <= tolerance:
                    count = _add(rows, count, out[6], out[0], out[1], out[2], out)
        if mesh.owned[t, k] >= 0 and edge_near(mesh, p, p, low, high, around):
            x, y, z = mesh.vertices[p, 0], mesh.vertices[p, 1], mesh.vertices[p, 2]
            for f in range(cores.first_face[s + 1] - face):
                gap = faces[f, 0] * x + faces[f, 1] * y + faces[f, 2] * z - faces[f, 3]
                if -inner <= gap <= tolerance and on_core_face(
                    mesh, cores, first, face, points, faces, f, p, gap, _MARGIN * inner, eps
                ):
                    for c in range(3):
                        out[3 + c] = -faces[f, c]
                    count = _add(rows, count, gap, x + gap * out[3], y + gap * out[4], z + gap * out[5], out)
    return count


@kernel("i8(Creases, Cores, i8, i8, f8[:,::1], f8[:,::1], f8[::1], f8, f8, f8[:,::1], i8, f8[::1])")
def round_rows(
    mesh: Creases, cores: Cores, s: int, t: int, points: Array, faces: Array, middle: Array, tolerance: float,
    eps: float, rows: Array, count: int, out: Array,
) -> int:  # fmt: skip
    """Add the rows of a segment with a radius with the ridges and peaks of one triangle; see `all_rows`."""
    radius = cores.sizes[s, 3]
    most, vertices = radius + tolerance, mesh.vertices
    for k in range(3):
        a, b = mesh.triangles[t, k], mesh.triangles[t, (k + 1) % 3]
        if mesh.ridge[t, k] >= 0:
            for i in range(2):
                far = from_segment(points, i, vertices, a, b, out)
                if 0.0 < far <= most and in_arc(mesh, t, k, out[3], out[4], out[5]):
                    x, y, z = points[i, 0] - radius * out[3], points[i, 1] - radius * out[4], points[i, 2]
                    count = _add(rows, count, far - radius, x, y, z - radius * out[5], out)
            if across_ridge(mesh, cores, cores.first_point[s], 0, points, faces, middle, t, k, cores.first_edge[s],
                            0.0, eps, out) and out[6] <= most:  # fmt: skip
                x, y, z = out[0] - radius * out[3], out[1] - radius * out[4], out[2] - radius * out[5]
                count = _add(rows, count, out[6] - radius, x, y, z, out)
        if mesh.owned[t, k] >= 0:
            for i in range(3):
                # the ends, then what is between them
                if i < 2:
                    far, sign = from_segment(points, i, vertices, a, a, out), 1.0
                else:
                    far, sign = from_segment(vertices, a, points, 0, 1, out), -1.0
                for c in range(3, 6):
                    out[c] = sign * out[c]
                if 0.0 < far <= most and in_cone(mesh, mesh.owned[t, k], out[3], out[4], out[5]):
                    gap = far - radius
                    x, y, z = vertices[a, 0] + gap * out[3], vertices[a, 1] + gap * out[4], vertices[a, 2]
                    count = _add(rows, count, gap, x, y, z + gap * out[5], out)
    return count


@kernel("i8(Creases, Cores, i8, i8, f8[:,::1], i8, f8[::1], f8, f8, f8[:,::1], i8, f8[::1])")
def vertex_row(
    mesh: Creases, cores: Cores, s: int, t: int, points: Array, i: int, middle: Array, tolerance: float, eps: float,
    rows: Array, count: int, out: Array,
) -> int:  # fmt: skip
    """Add the row of point i of a core with triangle t, if it touches; see `all_rows`."""
    radius, inner = cores.sizes[s, 3], cores.sizes[s, 4]
    height = above(mesh.planes, t, 0, points[i, 0], points[i, 1], points[i, 2])
    gap = height - radius
    # the ends of a segment may sink by its radius more
    if not -inner - radius <= gap <= tolerance:
        return count
    if radius > 0.0 and height > 0.0:
        touches = above_triangle(mesh, t, points, i, eps)
    else:
        touches = on_triangle(mesh, middle, t, points, i, height, inner, _MARGIN * inner, eps)
    if not touches:
        return count
    for c in range(3):
        out[3 + c] = mesh.planes[t, 0, c]
    x, y, z = points[i, 0] - radius * out[3], points[i, 1] - radius * out[4], points[i, 2] - radius * out[5]
    return _add(rows, count, gap, x, y, z, out)


@kernel("b1(f8[:,:,::1], Creases, Cores, i8, i8, f8[:,::1], i8, f8[::1])")
def lowest_of_rims(
    places: Array, mesh: Creases, cores: Cores, s: int, t: int, points: Array, number: int, middle: Array
) -> bool:
    """Write the lowest point of each rim of cylinder s over triangle t behind its vertices, if the rims are tilted.

    Returns whether they are; see `shapes.TILTED`.
    """
    f, axis, down = cores.frame[s], np.empty(3), np.empty(3)
    along, square, length = 0.0, 0.0, 0.0
    for c in range(3):
        axis[c] = 0.0
        for k in range(3):
            axis[c] += cores.rims[s, k] * places[f, k, c]
        along += axis[c] * mesh.planes[t, 0, c]
        square += axis[c] * axis[c]
    for c in range(3):
        down[c] = along / square * axis[c] - mesh.planes[t, 0, c]
        length += down[c] * down[c]
    if length < TILTED * TILTED:
        return False
    for c in range(3):
        lower = middle[c] + cores.rims[s, 3] * down[c] / np.sqrt(length)
        points[number, c], points[number + 1, c] = lower - axis[c], lower + axis[c]
    return True


@kernel("Tuple((i8, i8))(f8[:,:,::1], Creases, Cores, i8, f8, f8, i8[::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[::1])")
def all_rows(
    places: Array, mesh: Creases, cores: Cores, s: int, tolerance: float, eps: float, near: Array, points: Array,
    faces: Array, rows: Array, out: Array,
) -> tuple[int, int]:  # fmt: skip
    """Write the rows of core s with a mesh whose gap is at most the tolerance.

    Parameters
    ----------
    places, mesh, cores, s
        See `place_core`.
    tolerance, eps : float
        The greatest gap; rounding [m].
    near, points, faces, out
        Scratch; `near` has room for triangles, `points` and `faces` for those of any core.
    rows : ndarray, shape (k, 7)
        Receives gap, point of the core's surface and normal from the mesh to the core.

    Returns
    -------
    triangles, count : int
        How many triangles are near and how many rows there are; if there is no room for them, they are not written.
    """
    low, high, wide, middle, count = np.empty(3), np.empty(3), np.empty((2, 3)), np.empty(3), 0
    place_core(places, cores, s, points, faces, middle)
    radius, inner, number = cores.sizes[s, 3], cores.sizes[s, 4], cores.first_point[s + 1] - cores.first_point[s]
    # rims reach beyond the vertices that stand for them
    around = radius + max(tolerance, inner) + 0.01 * cores.rims[s, 3]
    for c in range(3):
        low[c], high[c] = points[0, c], points[0, c]
        for i in range(1, number):
            low[c], high[c] = min(low[c], points[i, c]), max(high[c], points[i, c])
        wide[0, c], wide[1, c] = low[c] - around, high[c] + around
    triangles = triangles_in_box(mesh, wide[0], wide[1], near)
    if triangles > len(near):
        return triangles, 0
    for j in range(triangles):
        begin, end = 0, number
        # a rim that is tilted stands on its lowest point only
        if cores.rims[s, 3] > 0.0 and lowest_of_rims(places, mesh, cores, s, near[j], points, number, middle):
            begin, end = number, number + 2
        for i in range(begin, end):
            count = vertex_row(mesh, cores, s, near[j], points, i, middle, tolerance, eps, rows, count, out)
    for j in range(triangles):
        if radius > 0.0:
            count = round_rows(mesh, cores, s, near[j], points, faces, middle, tolerance, eps, rows, count, out)
        else:
            count = sharp_rows(
                mesh, cores, s, near[j], points, faces, middle, low, high, tolerance, eps, rows, count, out
            )
    return triangles, count


@kernel("i8(f8[:,::1], i8, f8, i8[::1])")
def few_of_each_normal(rows: Array, count: int, bound: float, group: Array) -> int:
    """Keep of equal rows one, and of more than `FEW_POINTS` rows of one normal few; return how many are kept.

    Parameters
    ----------
    rows, count
        See `all_rows`; the kept ones are moved to the front.
    bound : float
        Radius of the shape [m].
    group : ndarray of int, shape (count,)
        Scratch.
    """
    along, across, place, gap = np.empty(3), np.empty(3), np.empty((count, 2)), np.empty(count)
    index, chosen = np.empty(count, np.int64), np.empty(count + FEW_POINTS + 1, np.int64)
    for i in range(count):
        group[i] = -1
    for i in range(count):
        if group[i] != -1:
            continue
        within_plane(rows[i, 4:7], along, across)
        number, least = 0, np.inf
        for j in range(i, count):
            alike = rows[i, 4] * rows[j, 4] + rows[i, 5] * rows[j, 5] + rows[i, 6] * rows[j, 6]
            if group[j] != -1 or alike < 1.0 - _SAME:
                continue
            u = along[0] * rows[j, 1] + along[1] * rows[j, 2] + along[2] * rows[j, 3]
            v = across[0] * rows[j, 1] + across[1] * rows[j, 2] + across[2] * rows[j, 3]
            group[j], known = i, False
            for k in range(number):
                known = (
                    known or max(abs(place[k, 0] - u), abs(place[k, 1] - v), abs(gap[k] - rows[j, 0])) < 1e-9 * bound
                )
            if known:
                group[j] = -2
                continue
            place[number, 0], place[number, 1], gap[number], index[number] = u, v, rows[j, 0], j
            least = min(least, rows[j, 0])
            number += 1
        if number <= FEW_POINTS:
            continue
        for k in range(number):
            group[index[k]] = -2
        if one_face(place[:number], gap[:number], bound):
            kept = few_corners(place[:number], gap[:number], max(least, 0.0) + FLAT * bound, chosen)
        else:
            kept = spread_out(place[:number], gap[:number], BESIDE * bound, chosen)
        for k in range(kept):
            group[index[chosen[k]]] = i
    kept = 0
    for i in range(count):
        if group[i] != -2:
            for c in range(7):
                rows[kept, c] = rows[i, c]
            kept += 1
    return kept


@kernel(
    "Tuple((i8, i8, i8))(f8[:,:,::1], Tuple(Creases), Tuple(Cores), i8[::1], f8, f8, i8[::1], f8[:,::1], f8[:,::1],"
    " f8[:,::1], f8[::1], i8[::1], f8[::1], f8[:,::1], f8[:,::1])"
)
def surface_contacts(
    places: Array, creases: tuple[Array, ...], cores: tuple[Array, ...], some: Array, tolerance: float, eps: float,
    near: Array, points: Array, faces: Array, rows: Array, out: Array, shape: Array, gap: Array, point: Array,
    normal: Array,
) -> tuple[int, int, int]:  # fmt: skip
    """Write the contacts of some cores with a mesh.

    Parameters
    ----------
    places, creases, cores
        See `all_rows`.
    some : ndarray of int
        The cores, ascending.
    tolerance, eps, near, points, faces, rows, out
        See `all_rows`.
    shape, gap, point, normal : ndarray, shapes (k,), (k,), (k, 3), (k, 3)
        Receive the core of each contact, its gap, its point on the core's surface, and the normal towards the core.

    Returns
    -------
    count, most_triangles, most_rows : int
        How many contacts there are, and the most that there must be room for in `near` and in `rows`.
    """
    mesh, table, count, most, rows_at_most = Creases(*creases), Cores(*cores), 0, 0, 0
    for s in some:
        triangles, number = all_rows(places, mesh, table, s, tolerance, eps, near, points, faces, rows, out)
        most, rows_at_most = max(most, triangles), max(rows_at_most, number)
        if triangles > len(near) or number > len(rows):
            continue
        number = few_of_each_normal(rows, number, table.sizes[s, 5], near)
        for i in range(number):
            if count < len(shape):
                shape[count], gap[count] = s, rows[i, 0]
                for c in range(3):
                    point[count, c], normal[count, c] = rows[i, 1 + c], rows[i, 4 + c]
            count += 1
    return count, most, rows_at_most

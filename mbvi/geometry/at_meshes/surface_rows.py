"""Contacts of convex cores with a triangle mesh that is solid behind its triangles; see `surface_features`."""

from __future__ import annotations

import numpy as np

from ...arguments import Array
from ...compiled import kernel
from ..meshes.creases import RIDGE, Creases
from ..shapes.convex_cores import Cores
from ..shapes.shapes import TILTED
from .cores_at_mesh import ON_IT, ON_RIM, PEAK, CoresAtMesh, middle_of, place_feature, travel_from, write_place
from .feature_clearance import clearance_of_feature, rim_clearance
from .few_rows import few_of_each_patch
from .mesh_tree import is_crossed
from .near_features import list_features
from .surface_features import BESIDE as BESIDE_NORMALS
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

# how far features give way to others, relative to the radius of a ball inside the shape
_MARGIN = 1e-3
# steps of a swift core that a list is good for, and how many times wider than others it may be
_STEPS, _WIDEST = 1.5, 4.0


@kernel("i8(f8[:,::1], i8, f8, f8, f8, f8, f8[::1])")
def _add(rows: Array, count: int, gap: float, x: float, y: float, z: float, out: Array) -> int:
    """Write a row of a gap, a point of the core and the normal in `out`, if there is room; return the new count."""
    if count < len(rows):
        rows[count, 0], rows[count, 1], rows[count, 2], rows[count, 3] = gap, x, y, z
        for c in range(3):
            rows[count, 4 + c] = out[3 + c]
    return count + 1


@kernel("b1(CoresAtMesh, i8, i8, f8, f8[::1])")
def is_under_overhang(at: CoresAtMesh, t: int, i: int, height: float, middle: Array) -> bool:
    """Return whether point i of a core, at a height below triangle t, is under a part of the mesh that t is on top of.

    The free side of the mesh is then between both. The point came there through the mesh if this is between it and the
    middle of the core, which is shape (3,).
    """
    point, foot = np.empty(3), np.empty(3)
    for c in range(3):
        point[c] = at.points[i, c]
        foot[c] = point[c] - height * at.mesh.planes[t, 0, c]
    return is_crossed(at.mesh, point, foot, True, at.eps, at.near) and not is_crossed(
        at.mesh, point, middle, False, at.eps, at.near
    )


@kernel("i8(CoresAtMesh, i8, i8, i8, f8[::1], f8, i8)")
def vertex_row(at: CoresAtMesh, s: int, t: int, i: int, middle: Array, tolerance: float, count: int) -> int:
    """Add the row of vertex i of core s with triangle t, if they touch; see `all_rows`."""
    mesh, points, out, radius, inner = at.mesh, at.points, at.out, at.cores.sizes[s, 3], at.cores.sizes[s, 4]
    height = above(mesh.planes, t, 0, points[i, 0], points[i, 1], points[i, 2])
    gap = height - radius
    # the ends of a segment may sink by its radius more
    if not -inner - radius <= gap <= tolerance:
        return count
    if radius > 0.0 and height > 0.0:
        touches = above_triangle(mesh, t, points, i, at.eps)
    else:
        # the lowest point of a rim over the other side of a ridge is another one: both would give way to each other
        deep = height if i < at.cores.first_point[s + 1] - at.cores.first_point[s] else max(height, 0.0)
        touches = on_triangle(mesh, middle, t, points, i, deep, inner, _MARGIN * inner, at.eps)
    if not touches or (height < -_MARGIN * inner and is_under_overhang(at, t, i, height, middle)):
        return count
    for c in range(3):
        out[3 + c] = mesh.planes[t, 0, c]
    x, y, z = points[i, 0] - radius * out[3], points[i, 1] - radius * out[4], points[i, 2]
    return _add(at.rows, count, gap, x, y, z - radius * out[5], out)


@kernel("b1(f8[:,:,::1], Creases, Cores, i8, i8, f8[:,::1], f8[::1])")
def lowest_of_rims(
    places: Array, mesh: Creases, cores: Cores, s: int, t: int, points: Array, middle: Array
) -> bool:  # fmt: skip
    """Write the lowest point of each rim of cylinder s over triangle t behind its vertices, if the rims are tilted.

    Returns whether they are; see `shapes.TILTED`.
    """
    f, number = cores.frame[s], cores.first_point[s + 1] - cores.first_point[s]
    ax = ay = az = 0.0
    for k in range(3):
        rim = cores.rims[s, k]
        ax, ay, az = ax + rim * places[f, k, 0], ay + rim * places[f, k, 1], az + rim * places[f, k, 2]
    nx, ny, nz = mesh.planes[t, 0, 0], mesh.planes[t, 0, 1], mesh.planes[t, 0, 2]
    share = (ax * nx + ay * ny + az * nz) / (ax * ax + ay * ay + az * az)
    dx, dy, dz = share * ax - nx, share * ay - ny, share * az - nz
    square = dx * dx + dy * dy + dz * dz
    if square < TILTED * TILTED:
        return False
    out = cores.rims[s, 3] / np.sqrt(square)
    x, y, z = middle[0] + out * dx, middle[1] + out * dy, middle[2] + out * dz
    points[number, 0], points[number, 1], points[number, 2] = x - ax, y - ay, z - az
    points[number + 1, 0], points[number + 1, 1], points[number + 1, 2] = x + ax, y + ay, z + az
    return True


@kernel("b1(CoresAtMesh, i8, i8, i8, f8[::1])")
def rim_is_beyond(at: CoresAtMesh, s: int, t: int, i: int, middle: Array) -> bool:
    """Return whether the lowest point over triangle t of the rim of vertex i lies beyond a ridge of the triangle.

    The vertices of the prism within the rim stand for it there: their rows are those that an edge across the ridge
    gives way to. The lowest points of both rims are behind the vertices, see `lowest_of_rims`.
    """
    points, number, along = at.points, at.cores.first_point[s + 1] - at.cores.first_point[s], 0.0
    for c in range(3):
        along += (points[number + 1, c] - points[number, c]) * (points[i, c] - middle[c])
    lowest = number + 1 if along > 0.0 else number
    x, y, z = points[lowest, 0], points[lowest, 1], points[lowest, 2]
    for k in range(3):
        if at.mesh.bend[t, k] == RIDGE and above(at.mesh.planes, t, 1 + k, x, y, z) < -at.eps:
            return True
    return False


@kernel("i8(CoresAtMesh, i8, i8, i8, i8, f8[::1], f8, i8)")
def sharp_row(at: CoresAtMesh, s: int, t: int, k: int, e: int, middle: Array, tolerance: float, count: int) -> int:
    """Add the row of a polyhedron with a ridge or a peak of triangle t, if they touch; see `all_rows`."""
    mesh, cores, points, faces, out = at.mesh, at.cores, at.points, at.faces, at.out
    first, face, inner = cores.first_point[s], cores.first_face[s], cores.sizes[s, 4]
    if k < PEAK:
        if across_ridge(mesh, cores, first, face, points, faces, middle, t, k, e, _MARGIN * inner, at.eps, out):
            if -inner <= out[6] <= tolerance:
                count = _add(at.rows, count, out[6], out[0], out[1], out[2], out)
        return count
    p = mesh.triangles[t, k - PEAK]
    x, y, z = mesh.vertices[p, 0], mesh.vertices[p, 1], mesh.vertices[p, 2]
    gap = faces[e, 0] * x + faces[e, 1] * y + faces[e, 2] * z - faces[e, 3]
    if -inner <= gap <= tolerance and on_core_face(
        mesh, cores, first, face, points, faces, e, p, gap, _MARGIN * inner, at.eps
    ):
        for c in range(3):
            out[3 + c] = -faces[e, c]
        count = _add(at.rows, count, gap, x + gap * out[3], y + gap * out[4], z + gap * out[5], out)
    return count


@kernel("i8(CoresAtMesh, i8, i8, i8, f8[::1], f8, i8)")
def round_rows(at: CoresAtMesh, s: int, t: int, k: int, middle: Array, tolerance: float, count: int) -> int:
    """Add the rows of a segment with a radius with a ridge or a peak of triangle t; see `all_rows`."""
    mesh, cores, points, faces, out = at.mesh, at.cores, at.points, at.faces, at.out
    radius, vertices = cores.sizes[s, 3], mesh.vertices
    most = radius + tolerance
    if k < PEAK:
        a, b = mesh.triangles[t, k], mesh.triangles[t, (k + 1) % 3]
        for i in range(2):
            far = from_segment(points, i, vertices, a, b, out)
            if 0.0 < far <= most and in_arc(mesh, t, k, out[3], out[4], out[5]):
                x, y, z = points[i, 0] - radius * out[3], points[i, 1] - radius * out[4], points[i, 2]
                count = _add(at.rows, count, far - radius, x, y, z - radius * out[5], out)
        if across_ridge(mesh, cores, cores.first_point[s], 0, points, faces, middle, t, k, cores.first_edge[s],
                        0.0, at.eps, out) and out[6] <= most:  # fmt: skip
            x, y, z = out[0] - radius * out[3], out[1] - radius * out[4], out[2] - radius * out[5]
            count = _add(at.rows, count, out[6] - radius, x, y, z, out)
        return count
    a = mesh.triangles[t, k - PEAK]
    for i in range(3):
        # the ends, then what is between them
        if i < 2:
            far, sign = from_segment(points, i, vertices, a, a, out), 1.0
        else:
            far, sign = from_segment(vertices, a, points, 0, 1, out), -1.0
        for c in range(3, 6):
            out[c] = sign * out[c]
        if 0.0 < far <= most and in_cone(mesh, mesh.peak[a], out[3], out[4], out[5], BESIDE_NORMALS):
            gap = far - radius
            x, y, z = vertices[a, 0] + gap * out[3], vertices[a, 1] + gap * out[4], vertices[a, 2]
            count = _add(at.rows, count, gap, x, y, z + gap * out[5], out)
    return count


@kernel("Tuple((i8, i8, i8))(CoresAtMesh, f8[:,:,::1], i8, f8)")
def all_rows(at: CoresAtMesh, places: Array, s: int, tolerance: float) -> tuple[int, int, int]:
    """Write the rows of core s with a mesh whose gap is at most the tolerance to `rows`.

    Parameters
    ----------
    at : CoresAtMesh
        The mesh, the cores and their lists, which are made again where they do not hold.
    places, s
        See `place_core`.
    tolerance : float
        The greatest gap [m].

    Returns
    -------
    triangles, features, count : int
        How many triangles and features there must be room for, and how many rows there are; if there is no room for
        any of them, the rows are not written.
    """
    cores, count, most = at.cores, 0, max(tolerance, 0.0)
    step = travel_from(at, at.last[s], places, s)
    at.way[s] += step
    write_place(at, places, s, at.last[s])
    # written so that lists are made again at a place that is not finite
    if not (tolerance <= at.reach[s] and travel_from(at, at.place[s], places, s) <= at.slack[s]):
        # a core that moves nearly so far from search to search would need a list each time
        wide = _STEPS * step
        at.skin[s] = wide if at.least_skin[s] < wide <= _WIDEST * at.least_skin[s] else at.least_skin[s]
        triangles, features = list_features(at, places, s, tolerance, _MARGIN * cores.sizes[s, 4])
        if at.slack[s] < 0.0:
            return triangles, features, 0
    if at.counts[s] == 0:
        return 0, 0, 0
    begin, way = 0, at.way[s] + most
    while begin < at.counts[s] and at.clear_to[s, begin] > way:
        begin += 1
    if begin == at.counts[s]:
        return 0, begin, 0
    middle, placed = np.empty(3), np.zeros((2, max(len(at.points), len(at.faces))), np.bool_)
    for c in range(3):
        middle[c] = middle_of(places, cores, s, c)
    for n in range(begin, at.counts[s]):
        if at.clear_to[s, n] > way:
            continue
        t, k, e = at.features[s, n, 0], at.features[s, n, 1], at.features[s, n, 2]
        place_feature(at, places, s, k, e, placed)
        if k == ON_RIM:
            far = rim_clearance(at, places, s, t, middle)
        else:
            far = clearance_of_feature(at, s, t, k, e, middle)
        at.clear_to[s, n] = at.way[s] + far
        if far > most:
            continue
        if k >= ON_IT:
            # a rim that is tilted stands on its lowest point only, where that is not beyond a ridge
            tilted = cores.rims[s, 3] > 0.0 and lowest_of_rims(places, at.mesh, cores, s, t, at.points, middle)
            if k == ON_IT and (not tilted or rim_is_beyond(at, s, t, e, middle)):
                count = vertex_row(at, s, t, e, middle, tolerance, count)
            elif k == ON_RIM and tilted:
                e = cores.first_point[s + 1] - cores.first_point[s]
                count = vertex_row(at, s, t, e, middle, tolerance, count)
                count = vertex_row(at, s, t, e + 1, middle, tolerance, count)
        elif cores.sizes[s, 3] > 0.0:
            count = round_rows(at, s, t, k, middle, tolerance, count)
        else:
            count = sharp_row(at, s, t, k, e, middle, tolerance, count)
    return 0, at.counts[s], count


@kernel("f8(CoresAtMesh, f8[:,:,::1], i8, f8)")
def lowest_gap(at: CoresAtMesh, places: Array, s: int, tolerance: float) -> float:
    """Return the least gap of core s within a tolerance [m]; infinite if there is none, -inf if there is no room."""
    _, _, count = all_rows(at, places, s, tolerance)
    lowest = np.inf
    if at.slack[s] < 0.0 or count > len(at.rows):
        return -np.inf
    for i in range(count):
        lowest = min(lowest, at.rows[i, 0])
    return lowest


@kernel("Tuple((i8, i8, i8, i8))(CoresAtMesh, f8[:,:,::1], i8[::1], f8)")
def surface_contacts(at: CoresAtMesh, places: Array, some: Array, tolerance: float) -> tuple[int, int, int, int]:
    """Write the contacts of some cores with a mesh.

    Parameters
    ----------
    at, places, tolerance
        See `all_rows`.
    some : ndarray of int
        The cores, ascending.

    Returns
    -------
    count, triangles, features, rows : int
        How many contacts there are; and the most triangles, features and rows of a core. If there is no room for any of
        these, the contacts are not all written.
    """
    count, triangles, features, most = 0, 0, 0, 0
    for s in some:
        near, listed, number = all_rows(at, places, s, tolerance)
        triangles, features, most = max(triangles, near), max(features, listed), max(most, number)
        if number > len(at.rows):
            continue
        number = few_of_each_patch(at.rows, number, at.cores.sizes[s, 5], at.group)
        for i in range(number):
            if count < len(at.shape):
                at.shape[count], at.gap[count] = s, at.rows[i, 0]
                for c in range(3):
                    at.point[count, c], at.normal[count, c] = at.rows[i, 1 + c], at.rows[i, 4 + c]
            count += 1
    return count, triangles, features, most

"""Features of convex cores that may touch features of a mesh, listed once and kept until the cores have moved far.

A list holds all features that touch before a core has moved by a given length, so that what touches does not depend on
when it was made. `surface_rows` looks at the listed features only.
"""

from __future__ import annotations

import numpy as np

from ...arguments import Array
from ...compiled import kernel
from ..meshes.creases import VALLEY
from .cores_at_mesh import (
    ON_IT,
    ON_RIM,
    PEAK,
    CoresAtMesh,
    lever_of,
    middle_of,
    place_face_once,
    place_point,
    write_place,
)
from .mesh_tree import ACUTE, RIMS, drop_below, narrow_cone, tree_apart, triangles_in_box, write_excess
from .surface_features import BESIDE, above, in_cone, shared_side

# what a part of an arc of normals may add to the larger of the heights of its ends, relative to its chord
_ARC = 0.71


@kernel("b1(CoresAtMesh, i8, i8, i8, i8, f8)")
def may_cross(at: CoresAtMesh, s: int, t: int, k: int, edge: int, turn: float) -> bool:
    """Return whether an edge of core s, which is placed, and edge k of triangle t, a ridge, may have equal normals.

    `turn` is how far a unit vector may move with the core.
    """
    mesh, cores, points, faces = at.mesh, at.cores, at.points, at.faces
    first, face = cores.first_point[s], cores.first_face[s]
    a, b = cores.edges[edge, 0] - first, cores.edges[edge, 1] - first
    c, d = mesh.triangles[t, k], mesh.triangles[t, (k + 1) % 3]
    u0, u1, u2 = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]
    w0, w1, w2 = (
        mesh.vertices[d, 0] - mesh.vertices[c, 0],
        mesh.vertices[d, 1] - mesh.vertices[c, 1],
        mesh.vertices[d, 2] - mesh.vertices[c, 2],
    )
    x, y, z = u1 * w2 - u2 * w1, u2 * w0 - u0 * w2, u0 * w1 - u1 * w0
    one, two = np.sqrt(u0 * u0 + u1 * u1 + u2 * u2), np.sqrt(w0 * w0 + w1 * w1 + w2 * w2)
    length = np.sqrt(x * x + y * y + z * z)
    sine = length / (one * two)
    if sine <= 4.0 * turn:
        return True
    x, y, z, change = x / length, y / length, z / length, 2.0 * turn / sine
    planes, u = mesh.planes, mesh.beyond[t, k]
    outward = 0.0
    for i in range(3):
        n = x if i == 0 else (y if i == 1 else z)
        outward += n * (planes[t, 0, i] + (planes[u, 0, i] if u >= 0 else -planes[t, 1 + k, i]))
    if abs(outward) <= 2.0 * change:
        return True
    if outward < 0.0:
        x, y, z = -x, -y, -z
    most = BESIDE + change
    if planes[t, 1 + k, 0] * x + planes[t, 1 + k, 1] * y + planes[t, 1 + k, 2] * z > most:
        return False
    if u < 0:
        if planes[t, 0, 0] * x + planes[t, 0, 1] * y + planes[t, 0, 2] * z < -most:
            return False
    else:
        j = 1 + shared_side(mesh, u, t)
        if planes[u, j, 0] * x + planes[u, j, 1] * y + planes[u, j, 2] * z > most:
            return False
    for turned in range(2):
        j = cores.edges[edge, 2 + turned] - face
        p, q, r = faces[j, 0], faces[j, 1], faces[j, 2]
        into = ((q * u2 - r * u1) * x + (r * u0 - p * u2) * y + (p * u1 - q * u0) * z) / one
        if (into if turned == 0 else -into) < -most - turn:
            return False
    return True


@kernel("b1(f8[::1], f8[::1], f8[:,::1], i8)")
def meets_box(low: Array, high: Array, boxes: Array, k: int) -> bool:
    """Return whether a box and the box in row k of others meet."""
    for c in range(3):
        if low[c] > boxes[k, 3 + c] or high[c] < boxes[k, c]:
            return False
    return True


@kernel("i8(CoresAtMesh, i8, i8, i8, i8, i8)")
def append(at: CoresAtMesh, s: int, count: int, t: int, k: int, e: int) -> int:
    """Append a feature of core s to its list, if there is room; return the new count."""
    if count < at.features.shape[1]:
        at.features[s, count, 0], at.features[s, count, 1], at.features[s, count, 2] = t, k, e
    return count + 1


@kernel("b1(f8[:,::1], i8, f8[::1], f8[::1], f8, f8)")
def is_beyond_middle(points: Array, i: int, middle: Array, axis: Array, least: float, skin: float) -> bool:
    """Return whether a vertex is farther than the middle of its core along each normal of a cone, by twice the skin.

    `axis` and `least` are those of `narrow_cone`.
    """
    along = square = 0.0
    for c in range(3):
        x = middle[c] - points[i, c]
        along += x * axis[c]
        square += x * x
    across = np.sqrt(max(square - along * along, 0.0))
    if along > 0.0 and along * along >= least * least * square:
        return False
    return along * least + across * np.sqrt(1.0 - least * least) <= -2.0 * skin


@kernel("i8(CoresAtMesh, i8, i8, f8, f8[::1], f8[::1], f8, f8[::1])")
def list_vertices(
    at: CoresAtMesh, s: int, triangles: int, margin: float, middle: Array, axis: Array, least: float, excess: Array
) -> int:
    """List the vertices of core s, which is placed, that may touch near triangles; return how many.

    Parameters
    ----------
    margin : float
        How far features give way to others [m].
    middle : ndarray, shape (3,)
        Middle of the core.
    axis, least
        Of `narrow_cone`.
    excess
        Of `write_excess`.
    """
    mesh, points, skin, count, over = at.mesh, at.points, at.skin[s] + at.eps, 0, np.empty(triangles)
    for j in range(triangles):
        over[j] = above(mesh.planes, at.near[j], 0, middle[0], middle[1], middle[2])
    radius, inner = at.cores.sizes[s, 3], at.cores.sizes[s, 4]
    # in the corner below both triangles of a valley both count
    corner = skin + max(inner, margin)
    for i in range(at.cores.first_point[s + 1] - at.cores.first_point[s]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        if excess[i] > 0.0:
            continue
        if radius == 0.0 and least > 0.0 and is_beyond_middle(points, i, middle, axis, least, skin):
            continue
        for j in range(triangles):
            t = at.near[j]
            height, k = above(mesh.planes, t, 0, x, y, z) - radius, 0
            if not -inner - radius - skin <= height <= at.reach[s] + skin:
                continue
            if radius == 0.0 and over[j] < height - 2.0 * skin:
                continue
            while k < 3 and above(mesh.planes, t, 1 + k, x, y, z) >= (-corner if mesh.bend[t, k] == VALLEY else -skin):
                k += 1
            if k == 3:
                count = append(at, s, count, t, ON_IT, i)
    return count


@kernel("i8(CoresAtMesh, f8[:,:,::1], i8, f8[::1], f8, f8, f8, f8[::1], b1[:,::1])")
def choose_edges(
    at: CoresAtMesh, places: Array, s: int, axis: Array, least: float, turn: float, around: float, excess: Array,
    placed: Array,
) -> int:  # fmt: skip
    """List the edges of core s that may have a normal of the near triangles, and place their faces; return how many.

    Parameters
    ----------
    axis, least
        Of `narrow_cone`, the axis in the frame of the core's body.
    turn : float
        How far a unit vector may move with the core.
    around : float
        By how much the box about each edge is widened [m].
    excess, placed
        See `write_excess` and `place_feature`.
    """
    cores, points, count = at.cores, at.points, 0
    first, face = cores.first_point[s], cores.first_face[s]
    for e in range(cores.first_edge[s], cores.first_edge[s + 1]):
        a, b, p, q = cores.edges[e, 0] - first, cores.edges[e, 1] - first, cores.edges[e, 2], cores.edges[e, 3]
        if p >= 0:
            if min(excess[a], excess[b]) > 0.0:
                continue
            one = two = chord = 0.0
            for c in range(3):
                one -= cores.faces[p, c] * axis[c]
                two -= cores.faces[q, c] * axis[c]
                chord += (cores.faces[p, c] - cores.faces[q, c]) ** 2
            if max(one, two) + _ARC * np.sqrt(chord) < least - turn - BESIDE:
                continue
            place_face_once(at, places, s, p - face, placed)
            place_face_once(at, places, s, q - face, placed)
        at.chosen[0, count] = e
        for c in range(3):
            x, y = points[a, c], points[b, c]
            at.boxes[count, c], at.boxes[count, 3 + c] = min(x, y) - around, max(x, y) + around
        count += 1
    return count


@kernel("i8(CoresAtMesh, f8[:,:,::1], i8, f8[::1], f8, f8, b1[:,::1])")
def choose_faces(
    at: CoresAtMesh, places: Array, s: int, axis: Array, least: float, turn: float, placed: Array
) -> int:  # fmt: skip
    """List the faces of core s that may have a normal of the near triangles, and place them; see `choose_edges`."""
    cores, count, face = at.cores, 0, at.cores.first_face[s]
    for f in range(cores.first_face[s + 1] - face):
        along = 0.0
        for c in range(3):
            along -= cores.faces[face + f, c] * axis[c]
        if along >= least - turn - BESIDE:
            place_face_once(at, places, s, f, placed)
            at.chosen[1, count] = f
            count += 1
    return count


@kernel("b1(CoresAtMesh, i8, i8, i8, f8)")
def may_hold(at: CoresAtMesh, s: int, f: int, p: int, turn: float) -> bool:
    """Return whether face f of core s, which is placed, may come to touch vertex p of the mesh, a peak.

    `turn` is how far a unit vector may move with the core.
    """
    mesh, cores, points, faces, skin = at.mesh, at.cores, at.points, at.faces, at.skin[s] + at.eps
    x, y, z = mesh.vertices[p, 0], mesh.vertices[p, 1], mesh.vertices[p, 2]
    d, m, n = faces[f, 0], faces[f, 1], faces[f, 2]
    gap = d * x + m * y + n * z - faces[f, 3]
    if not -cores.sizes[s, 4] - skin <= gap <= at.reach[s] + skin:
        return False
    if not in_cone(mesh, mesh.peak[p], -d, -m, -n, BESIDE + turn):
        return False
    first, face = cores.first_point[s], cores.first_face[s] + f
    for i in range(cores.first_side[face], cores.first_side[face + 1]):
        a, b = cores.sides[i, 0] - first, cores.sides[i, 1] - first
        u, v, w = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]
        side = (m * w - n * v) * (x - points[a, 0]) + (n * u - d * w) * (y - points[a, 1])
        if side + (d * v - m * u) * (z - points[a, 2]) < -skin * np.sqrt(u * u + v * v + w * w):
            return False
    return True


@kernel("i8(CoresAtMesh, i8, i8, i8, i8, f8, i8)")
def list_at_triangle(at: CoresAtMesh, s: int, t: int, edges: int, faces: int, turn: float, count: int) -> int:
    """List what may touch the ridges and peaks of a triangle, and rims that may touch it; return the new count.

    `edges` and `faces` are how many of core s are chosen, and `turn` is how far a unit vector may move with it.
    """
    mesh, round_core, low, high = at.mesh, at.cores.sizes[s, 3] > 0.0, np.empty(3), np.empty(3)
    if at.cores.rims[s, 3] > 0.0:
        count = append(at, s, count, t, ON_RIM, 0)
    for k in range(3):
        a, b = mesh.triangles[t, k], mesh.triangles[t, (k + 1) % 3]
        if mesh.ridge[t, k] >= 0:
            for c in range(3):
                x, y = mesh.vertices[a, c], mesh.vertices[b, c]
                low[c], high[c] = min(x, y), max(x, y)
            for i in range(edges):
                e = at.chosen[0, i]
                if meets_box(low, high, at.boxes, i) and (round_core or may_cross(at, s, t, k, e, turn)):
                    count = append(at, s, count, t, k, e)
        if mesh.owned[t, k] >= 0 and round_core:
            if meets_box(mesh.vertices[a], mesh.vertices[a], at.boxes, 0):
                count = append(at, s, count, t, PEAK + k, 0)
        elif mesh.owned[t, k] >= 0:
            for i in range(faces):
                if may_hold(at, s, at.chosen[1, i], a, turn):
                    count = append(at, s, count, t, PEAK + k, at.chosen[1, i])
    return count


@kernel("Tuple((i8, i8))(CoresAtMesh, f8[:,:,::1], i8, f8, f8)")
def list_features(at: CoresAtMesh, places: Array, s: int, tolerance: float, margin: float) -> tuple[int, int]:
    """List the features of core s that may touch the mesh while it moves by at most its skin.

    Parameters
    ----------
    places, s
        See `place_core`.
    tolerance : float
        The greatest gap [m].
    margin : float
        How far features give way to others [m].

    Returns
    -------
    triangles, features : int
        How many triangles are near and how many features there are; if there is no room for them, `slack` is negative.
    """
    mesh, cores, points = at.mesh, at.cores, at.points
    low, high, middle, axis, own_axis = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    radius, inner, f, number = cores.sizes[s, 3], cores.sizes[s, 4], cores.frame[s], cores.first_point[s + 1]
    number -= cores.first_point[s]
    for i in range(number):
        place_point(places, cores, s, i, points)
    # searches of a step differ in their tolerance
    at.reach[s], at.slack[s] = max(tolerance, at.skin[s]), -1.0
    around = radius + max(at.reach[s], inner) + at.skin[s] + at.eps + RIMS * cores.rims[s, 3]
    write_place(at, places, s, at.place[s])
    for c in range(3):
        middle[c] = middle_of(places, cores, s, c)
        low[c], high[c] = points[0, c], points[0, c]
        for i in range(1, number):
            low[c], high[c] = min(low[c], points[i, c]), max(high[c], points[i, c])
        low[c], high[c] = low[c] - around, high[c] + around
    triangles = triangles_in_box(mesh, low, high, at.near)
    if triangles > len(at.near):
        return triangles, 0
    if triangles == 0:
        at.slack[s] = at.skin[s] + tree_apart(mesh.boxes, low, high)
        at.counts[s] = 0
        return 0, 0
    turn = at.skin[s] / lever_of(at, s)
    least = narrow_cone(at, triangles, axis)
    kept = drop_below(at, s, triangles) if least > ACUTE else triangles
    if kept == 0:
        # `free_way` knows by a slack beyond the skin that the core is above the mesh
        at.counts[s], at.slack[s] = 0, at.skin[s] + 0.5 * at.eps
        return triangles, 0
    for k in range(3):
        own_axis[k] = 0.0
        for c in range(3):
            own_axis[k] += places[f, k, c] * axis[c]
    excess, placed = np.empty(number), np.zeros((2, max(len(at.points), len(at.faces))), np.bool_)
    write_excess(at, s, kept, margin, axis, least, excess)
    count = list_vertices(at, s, kept, margin, middle, axis, least, excess)
    edges = choose_edges(at, places, s, own_axis, least, turn, around, excess, placed)
    faces = choose_faces(at, places, s, own_axis, least, turn, placed)
    for j in range(kept):
        count = list_at_triangle(at, s, at.near[j], edges, faces, turn, count)
    if count <= at.features.shape[1]:
        at.counts[s], at.way[s], at.slack[s] = count, 0.0, at.skin[s]
        for n in range(count):
            at.clear_to[s, n] = 0.0
    return triangles, count

"""Convex cores at a mesh, where they are, and how far they may move until they can touch it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...arguments import Array
from ...compiled import kernel, record
from ..meshes.creases import Creases
from ..shapes.convex_cores import Cores

# kinds of features: an edge of the core across ridge k of a triangle, a face of the core at the peak in its corner, a
# vertex of the core on it, the rims of a cylinder on it
PEAK, ON_IT, ON_RIM = 3, 6, 7


@record(
    "Creases, Cores, f8, f8[::1], f8[::1], f8[::1], f8[::1], f8[:,:,::1], i8[:,:,::1], i8[::1], f8[:,:,::1], f8[::1],"
    " f8[:,::1], i8[::1], f8[:,::1], f8[:,::1], i8[:,::1], f8[:,::1], f8[:,::1], i8[::1], f8[::1], i8[::1], f8[::1],"
    " f8[:,::1], f8[:,::1]"
)
class CoresAtMesh(NamedTuple):
    """A mesh and convex cores, with the features of each core that may touch it.

    Attributes
    ----------
    mesh, cores : Creases, Cores
        The mesh, and s cores.
    eps : float
        Rounding [m].
    least_skin, skin : ndarray, shape (s,)
        How far each core may move until its features are listed again, at least and at present [m].
    reach : ndarray, shape (s,)
        The greatest gap at which the listed features touch [m]; the greatest depth is the radius of the ball inside.
    slack : ndarray, shape (s,)
        How far each core may move from where they were listed [m]; negative before the first list.
    place : ndarray, shape (s, 4, 3)
        The columns of its rotation there, and its middle.
    features : ndarray of int, shape (s, k, 3)
        A triangle; `k` for its edge k, `PEAK` + k for its corner k, `ON_IT` and `ON_RIM` for the triangle itself; and
        the edge, face or vertex of the core, edges counted in `cores`, the others in the core; 0 for its rims.
    counts : ndarray of int, shape (s,)
        How many features are listed.
    last : ndarray, shape (s, 4, 3)
        As `place`, of the last search.
    way : ndarray, shape (s,)
        How far each core has moved from search to search since its features were listed [m].
    clear_to : ndarray, shape (s, k)
        The `way` up to which each feature touches nothing; within a tolerance of a row it is that much less.
    near, points, faces, chosen, boxes : ndarray
        Room for triangles; for vertices and faces of any core in the world, for its edges and boxes about them.
    rows, group, out : ndarray, shapes (r, 7), (r,) and (12,)
        Room for the rows of one core.
    shape, gap, point, normal : ndarray, shapes (m,), (m,), (m, 3), (m, 3)
        Receive the core of each contact, its gap, its point on the core's surface, and the normal towards the core.
    """

    mesh: Creases
    cores: Cores
    eps: float
    least_skin: Array
    skin: Array
    reach: Array
    slack: Array
    place: Array
    features: Array
    counts: Array
    last: Array
    way: Array
    clear_to: Array
    near: Array
    points: Array
    faces: Array
    chosen: Array
    boxes: Array
    rows: Array
    group: Array
    out: Array
    shape: Array
    gap: Array
    point: Array
    normal: Array


@kernel("f8(f8[:,:,::1], Cores, i8, i8)")
def middle_of(places: Array, cores: Cores, s: int, c: int) -> float:
    """Return coordinate c of the middle of core s in the world; see `place_core`."""
    f = cores.frame[s]
    x = places[f, 3, c]
    for k in range(3):
        x += cores.sizes[s, k] * places[f, k, c]
    return x


@kernel("void(f8[:,:,::1], Cores, i8, i8, f8[:,::1])")
def place_point(places: Array, cores: Cores, s: int, i: int, points: Array) -> None:
    """Write vertex i of core s in the world; see `place_core`."""
    f, a = cores.frame[s], cores.first_point[s] + i
    # numbers of their own: a store in one array hinders reading another
    x, y, z = cores.points[a, 0], cores.points[a, 1], cores.points[a, 2]
    for c in range(3):
        points[i, c] = places[f, 3, c] + x * places[f, 0, c] + y * places[f, 1, c] + z * places[f, 2, c]


@kernel("void(f8[:,:,::1], Cores, i8, i8, f8[:,::1])")
def place_face(places: Array, cores: Cores, s: int, i: int, faces: Array) -> None:
    """Write face i of core s in the world; see `place_core`."""
    f, a = cores.frame[s], cores.first_face[s] + i
    x, y, z, offset = cores.faces[a, 0], cores.faces[a, 1], cores.faces[a, 2], cores.faces[a, 3]
    for c in range(3):
        along = x * places[f, 0, c] + y * places[f, 1, c] + z * places[f, 2, c]
        faces[i, c] = along
        offset += along * places[f, 3, c]
    faces[i, 3] = offset


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
    for c in range(3):
        middle[c] = middle_of(places, cores, s, c)
    for i in range(cores.first_point[s + 1] - cores.first_point[s]):
        place_point(places, cores, s, i, points)
    for i in range(cores.first_face[s + 1] - cores.first_face[s]):
        place_face(places, cores, s, i, faces)


@kernel("f8(CoresAtMesh, i8)")
def lever_of(at: CoresAtMesh, s: int) -> float:
    """Return the radius of a ball about the middle of core s that holds all that it may touch [m]."""
    return at.cores.sizes[s, 5] + max(at.reach[s], at.cores.sizes[s, 4]) + at.skin[s]


@kernel("void(CoresAtMesh, f8[:,:,::1], i8, f8[:,::1])")
def write_place(at: CoresAtMesh, places: Array, s: int, out: Array) -> None:
    """Write the columns of the rotation of core s and its middle, shape (4, 3)."""
    f = at.cores.frame[s]
    for c in range(3):
        out[3, c] = middle_of(places, at.cores, s, c)
        for k in range(3):
            out[k, c] = places[f, k, c]


@kernel("f8(CoresAtMesh, f8[:,::1], f8[:,:,::1], i8)")
def travel_from(at: CoresAtMesh, before: Array, places: Array, s: int) -> float:
    """Return a bound of how far any point near core s has moved with it [m].

    `before`, shape (4, 3), has the columns of its rotation and its middle where it was.
    """
    f, turned, moved = at.cores.frame[s], 0.0, 0.0
    for c in range(3):
        moved += (middle_of(places, at.cores, s, c) - before[3, c]) ** 2
        for k in range(3):
            turned += (places[f, k, c] - before[k, c]) ** 2
    # a rotation moves no unit vector farther than its Frobenius norm divided by the root of 2
    return np.sqrt(moved) + np.sqrt(0.5 * turned) * lever_of(at, s)


@kernel("f8(CoresAtMesh, f8[:,:,::1], i8)")
def free_way(at: CoresAtMesh, places: Array, s: int) -> float:
    """Return a lower bound of how far core s may move until it can touch the mesh [m]; not above 0 where it is near."""
    if at.counts[s] == 0 and at.slack[s] <= at.skin[s]:
        return 0.0
    free = at.slack[s] - travel_from(at, at.place[s], places, s)
    if at.counts[s] > 0 and free > 0.0:
        way = at.way[s] + travel_from(at, at.last[s], places, s)
        for n in range(at.counts[s]):
            free = min(free, at.clear_to[s, n] - way)
    return free


@kernel("void(CoresAtMesh, f8[:,:,::1], i8, i8, b1[:,::1])")
def place_point_once(at: CoresAtMesh, places: Array, s: int, i: int, placed: Array) -> None:
    """Write vertex i of core s in the world, if it is not there yet; see `place_feature`."""
    if not placed[0, i]:
        placed[0, i] = True
        place_point(places, at.cores, s, i, at.points)


@kernel("void(CoresAtMesh, f8[:,:,::1], i8, i8, b1[:,::1])")
def place_face_once(at: CoresAtMesh, places: Array, s: int, i: int, placed: Array) -> None:
    """Write face i of core s in the world, if it is not there yet; see `place_feature`."""
    if not placed[1, i]:
        placed[1, i] = True
        place_face(places, at.cores, s, i, at.faces)


@kernel("void(CoresAtMesh, f8[:,:,::1], i8, i8, i8, b1[:,::1])")
def place_feature(at: CoresAtMesh, places: Array, s: int, k: int, e: int, placed: Array) -> None:
    """Write the vertices and faces that a feature of core s has in the world; k and e are those of `features`.

    `placed`, shape (2, n), says which vertices and faces are there already.
    """
    cores, first, face = at.cores, at.cores.first_point[s], at.cores.first_face[s]
    if k == ON_IT:
        place_point_once(at, places, s, e, placed)
    elif k < PEAK or cores.sizes[s, 3] > 0.0:
        # a segment is its only edge
        edge = e if k < PEAK else cores.first_edge[s]
        for i in range(2):
            place_point_once(at, places, s, cores.edges[edge, i] - first, placed)
            if cores.edges[edge, 2] >= 0:
                place_face_once(at, places, s, cores.edges[edge, 2 + i] - face, placed)
    elif k < ON_IT:
        place_face_once(at, places, s, e, placed)
        for i in range(cores.first_side[face + e], cores.first_side[face + e + 1]):
            place_point_once(at, places, s, cores.sides[i, 0] - first, placed)
            place_point_once(at, places, s, cores.sides[i, 1] - first, placed)
            place_face_once(at, places, s, cores.sides[i, 2] - face, placed)

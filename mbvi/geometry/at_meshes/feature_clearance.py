"""How far a convex core may move before a feature of it touches one of a mesh: a bound for each kind of feature.

A core that moves by d, see `travel_from`, moves each point near it by at most d, and turns unit vectors by d / lever.
What a row demands of heights, sides and normals then changes by no more than a multiple of d: the demand that is missed
most tells how far the row is away. Gaps count as 0; a row within a tolerance is nearer by no more than that.
"""

from __future__ import annotations

import numpy as np

from ...arguments import Array
from ...compiled import kernel
from ..meshes.creases import VALLEY
from .cores_at_mesh import ON_IT, PEAK, CoresAtMesh, lever_of
from .surface_features import BESIDE, above, shared_side

# sine of the angle of two edges below which nothing is said of them, and what rounding leaves of a bound
_ASKEW, _ROUNDED = 1e-3, 0.999
# how far beyond the ends of a ridge rows go on at most, relative to the greatest depth
_BEYOND = 1.01


@kernel("f8(CoresAtMesh, i8, i8, i8, f8[::1])")
def vertex_clearance(at: CoresAtMesh, s: int, t: int, i: int, middle: Array) -> float:
    """Return how far core s may move until its vertex i touches triangle t [m]; see `clearance_of_feature`."""
    mesh, radius, inner = at.mesh, at.cores.sizes[s, 3], at.cores.sizes[s, 4]
    x, y, z = at.points[i, 0], at.points[i, 1], at.points[i, 2]
    height = above(mesh.planes, t, 0, x, y, z)
    far = max(height - radius, -inner - height)
    if radius == 0.0:
        # the middle is above the vertex and the triangle; both may move
        far = max(far, 0.5 * (max(height, 0.0) - above(mesh.planes, t, 0, middle[0], middle[1], middle[2])))
    for k in range(3):
        outside = -above(mesh.planes, t, 1 + k, x, y, z)
        far = max(far, outside - (inner if mesh.bend[t, k] == VALLEY else 0.0))
    return far


@kernel("f8(CoresAtMesh, i8, i8, i8, f8[::1])")
def face_clearance(at: CoresAtMesh, s: int, p: int, f: int, middle: Array) -> float:
    """Return how far core s may move until its face f touches vertex p, a peak [m]; see `clearance_of_feature`."""
    mesh, cores, points, faces = at.mesh, at.cores, at.points, at.faces
    x, y, z = mesh.vertices[p, 0], mesh.vertices[p, 1], mesh.vertices[p, 2]
    d, m, n = faces[f, 0], faces[f, 1], faces[f, 2]
    gap = d * x + m * y + n * z - faces[f, 3]
    far = max(gap, -cores.sizes[s, 4] - gap)
    first, face = cores.first_point[s], cores.first_face[s] + f
    for i in range(cores.first_side[face], cores.first_side[face + 1]):
        a, b = cores.sides[i, 0] - first, cores.sides[i, 1] - first
        u, v, w = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]
        side = (m * w - n * v) * (x - points[a, 0]) + (n * u - d * w) * (y - points[a, 1])
        side += (d * v - m * u) * (z - points[a, 2])
        far = max(far, -side / np.sqrt(u * u + v * v + w * w))
    # seen from the core a peak far from it moves farther
    lever = lever_of(at, s)
    away = np.sqrt((x - middle[0]) ** 2 + (y - middle[1]) ** 2 + (z - middle[2]) ** 2)
    far /= max(1.0, away / lever)
    k = mesh.peak[p]
    for i in range(mesh.first[k], mesh.first[k + 1]):
        beyond = -(mesh.edges[i, 0] * d + mesh.edges[i, 1] * m + mesh.edges[i, 2] * n)
        far = max(far, lever * (beyond - BESIDE))
    return far


@kernel("f8(CoresAtMesh, i8, i8, i8, i8, f8[::1])")
def missed_normals(at: CoresAtMesh, s: int, t: int, k: int, e: int, out: Array) -> float:
    """Return by how much a normal is beyond those that edge e of core s and the ridge at edge k of t can have.

    `out` has the unit vector along the core's edge, that along the ridge, and the normal.
    """
    planes, v, cores = at.mesh.planes, at.mesh.beyond[t, k], at.cores
    x, y, z = out[6], out[7], out[8]
    beyond = planes[t, 1 + k, 0] * x + planes[t, 1 + k, 1] * y + planes[t, 1 + k, 2] * z
    if v < 0:
        beyond = max(beyond, -(planes[t, 0, 0] * x + planes[t, 0, 1] * y + planes[t, 0, 2] * z))
    else:
        j = 1 + shared_side(at.mesh, v, t)
        beyond = max(beyond, planes[v, j, 0] * x + planes[v, j, 1] * y + planes[v, j, 2] * z)
    for turn in range(2):
        f = cores.edges[e, 2 + turn] - cores.first_face[s]
        p, q, r = at.faces[f, 0], at.faces[f, 1], at.faces[f, 2]
        into = (q * out[2] - r * out[1]) * x + (r * out[0] - p * out[2]) * y + (p * out[1] - q * out[0]) * z
        beyond = max(beyond, -into if turn == 0 else into)
    return beyond - BESIDE


@kernel("f8(f8, f8, f8, f8, f8, f8, f8, f8)")
def ends_beside(
    length: float, cosine: float, sine: float, a: float, b: float, square: float, still: float, bend: float
) -> float:
    """Return how far a core may move until the ends of a segment are not on one side of a line any more [m].

    The side of an end is seen along the normal across both, which changes by `bend` for each metre.

    Parameters
    ----------
    length, cosine, sine : float
        Length of the segment [m]; cosine and sine of the angle of its direction and that of the line.
    a, b, square : float
        Of the vector from a point of the line to the first end, what is along the segment and along the line, and its
        square.
    still : float
        How far the foot of an end may move with a core that moves by 1.
    """
    low, high = np.inf, -np.inf
    for i in range(2):
        x = i * length
        foot = b + x * cosine
        off = np.sqrt(max(square + 2.0 * x * a + x * x - foot * foot, 0.0))
        far = (a + x - foot * cosine) / sine / (still + bend * off)
        low, high = min(low, far), max(high, far)
    return max(low, -high)


@kernel("f8(CoresAtMesh, i8, i8, i8, i8, f8[::1])")
def edge_clearance(at: CoresAtMesh, s: int, t: int, k: int, e: int, middle: Array) -> float:
    """Return how far core s may move until its edge e touches the ridge k of triangle t [m], as `clearance_of_feature`.

    The normal across both, u x w over its length, the sine, changes by at most 2 / sine times what u turns by.
    """
    mesh, cores, points, planes, out = at.mesh, at.cores, at.points, at.mesh.planes, at.out
    a, b = cores.edges[e, 0] - cores.first_point[s], cores.edges[e, 1] - cores.first_point[s]
    c, d, v = mesh.triangles[t, k], mesh.triangles[t, (k + 1) % 3], mesh.beyond[t, k]
    one = two = 0.0
    for i in range(3):
        out[i], out[3 + i] = points[b, i] - points[a, i], mesh.vertices[d, i] - mesh.vertices[c, i]
        one, two = one + out[i] * out[i], two + out[3 + i] * out[3 + i]
    one, two = np.sqrt(one), np.sqrt(two)
    for i in range(3):
        out[i], out[3 + i] = out[i] / one, out[3 + i] / two
    cosine = ru = rw = square = mu = away = sine = outward = gap = 0.0
    for i in range(3):
        n = out[(i + 1) % 3] * out[3 + (i + 2) % 3] - out[(i + 2) % 3] * out[3 + (i + 1) % 3]
        r, m = points[a, i] - mesh.vertices[c, i], points[a, i] - middle[i]
        cosine, ru, rw = cosine + out[i] * out[3 + i], ru + r * out[i], rw + r * out[3 + i]
        square, mu, away, sine, gap = square + r * r, mu + m * out[i], away + m * m, sine + n * n, gap + r * n
        outward += n * (planes[t, 0, i] + (planes[v, 0, i] if v >= 0 else -planes[t, 1 + k, i]))
        out[6 + i] = n
    sine = np.sqrt(sine)
    if sine < _ASKEW:
        return 0.0
    lever, sign = lever_of(at, s), 1.0 if outward >= 0.0 else -1.0
    for i in range(3):
        out[6 + i] *= sign / sine
    bend, gap = 2.0 / (sine * lever), sign * gap / sine
    # until then the normal is outward where it is now
    outwards = 0.5 * abs(outward) / sine / bend
    far = min(outwards, missed_normals(at, s, t, k, e, out) / (bend + 1.0 / lever))
    # of points of both edges that are near each other, the gap changes with them and with the normal
    x = min(max((cosine * rw - ru) / (sine * sine), 0.0), one)
    y = min(max(rw + x * cosine, 0.0), two)
    apart = square + x * x + y * y + 2.0 * (x * ru - y * rw - x * y * cosine)
    apart = max(gap, -cores.sizes[s, 4] - gap) / (1.0 + bend * np.sqrt(max(apart, 0.0)))
    far = max(far, min(outwards, apart))
    # edges do not cross while both ends of one are on one side of the other
    far = max(far, ends_beside(one, cosine, sine, ru, rw, square, 1.0, bend))
    # in the corner of a hole rows go on beyond the ends of a ridge, see `across_ridge`
    # seen from the core points far from it move farther
    more, most = _BEYOND * cores.sizes[s, 4], 0.0
    for i in range(2):
        foot = (i * two + (2 * i - 1) * more) * cosine - ru
        most = max(most, away + 2.0 * foot * mu + foot * foot)
    still, square = max(1.0, np.sqrt(most) / lever), square + 2.0 * more * rw + more * more
    first, beside = -rw - more, -ru - more * cosine
    return max(far, ends_beside(two + 2.0 * more, cosine, sine, first, beside, square, still, bend + 1.0 / lever))


@kernel("f8(CoresAtMesh, f8[:,:,::1], i8, i8, f8[::1])")
def rim_clearance(at: CoresAtMesh, places: Array, s: int, t: int, middle: Array) -> float:
    """Return how far cylinder s may move until a rim touches triangle t [m]: its least height above the plane of t."""
    cores, planes, f = at.cores, at.mesh.planes, at.cores.frame[s]
    along = square = 0.0
    for k in range(3):
        rim = cores.rims[s, k]
        square += rim * rim
        for c in range(3):
            along += rim * places[f, k, c] * planes[t, 0, c]
    across = cores.rims[s, 3] * np.sqrt(max(1.0 - along * along / square, 0.0))
    return above(planes, t, 0, middle[0], middle[1], middle[2]) - abs(along) - across - 4.0 * at.eps


@kernel("f8(CoresAtMesh, i8, i8, i8, i8, f8[::1])")
def clearance_of_feature(at: CoresAtMesh, s: int, t: int, k: int, e: int, middle: Array) -> float:
    """Return a bound of how far core s may move until one of its features has a row whose gap is 0 or less [m].

    Parameters
    ----------
    at : CoresAtMesh
        With the feature placed by `place_feature`.
    s, t, k, e
        The core, and the feature, not one of rims, for which there is `rim_clearance`; see `features`.
    middle : ndarray, shape (3,)
        Middle of the core.
    """
    far = 0.0
    if k == ON_IT:
        far = vertex_clearance(at, s, t, e, middle)
    elif at.cores.sizes[s, 3] == 0.0:
        far = (
            edge_clearance(at, s, t, k, e, middle)
            if k < PEAK
            else face_clearance(at, s, at.mesh.triangles[t, k - PEAK], e, middle)
        )
    return far - 4.0 * at.eps

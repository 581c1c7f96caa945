"""The lowest points of shapes above half-spaces, and their gaps.

A support point is fixed in its body, or it is the lowest point of a rim or an ellipsoid. Each is a row of the array
`numbers`, shape (k, 17): 0-2 its position in the body, or the centre of the rim or ellipsoid [m]; 3-11 the three half
axes of that in the body, zero for a fixed point; 12-14 the normal of the half-space; 15 the radius of the ball around
the point; 16 that radius plus the offset of the half-space [m].
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...arguments import Array
from ...compiled import kernel, record
from ..shapes.hull_graph import connected, outermost
from ..shapes.shapes import TILTED
from ..vectors import within_plane
from .spread import BESIDE, FEW_POINTS, FLAT, few_corners, spread_out

# a rim tilted by less than this angle is level: all of its points are lowest, and the first axis gives one [rad]
_LEVEL = 1e-9


@record(
    "i8[::1], i8[::1], f8[:,::1], i8[::1], i8[::1], f8[::1], f8[::1], i8[::1], i8[::1], i8[::1], f8[:,::1], i8[::1],"
    " i8[::1], b1[::1], f8[::1]"
)
class Points(NamedTuple):
    """The support points of all pairs of a shape and a half-space, as kernels take them.

    Attributes
    ----------
    body : ndarray of int, shape (n,)
        The place of each pair's body in the placements.
    begin : ndarray of int, shape (n + 1,)
        The first point of each pair.
    numbers : ndarray, shape (k, 17)
        The points as above.
    first, neighbour : ndarray of int, shapes (k + 1,) and (e,)
        Which points are neighbours on hulls of many vertices.
    size : ndarray, shape (n,)
        Bounding radius of the shape of each pair [m].
    width : ndarray, shape (n,)
        Half the width of the hull of each pair across its longest axis [m].
    faces : ndarray of int, shape (n + 1,)
        The first flat face of each pair; see `flat_faces`.
    face : ndarray of int, shape (f + 1,)
        Where the corners of each face begin.
    corner : ndarray of int, shape (c,)
        The points that are corners of faces, ascending in each.
    facing : ndarray, shape (f, 3)
        Normals of the faces in their bodies.
    start : ndarray of int, shape (n,)
        The lowest point of each pair at the last call; written by kernels.
    found : ndarray of int, shape (k + 1,)
        Receives the points within the tolerance.
    taken : ndarray of bool, shape (k,)
        False for every point, between calls.
    out : ndarray, shape (4,)
        Scratch for `lowest`: kernels that make no arrays are faster.
    """

    body: Array
    begin: Array
    numbers: Array
    first: Array
    neighbour: Array
    size: Array
    width: Array
    faces: Array
    face: Array
    corner: Array
    facing: Array
    start: Array
    found: Array
    taken: Array
    out: Array


@kernel("void(f8[:,:,::1], i8, f8[:,::1], i8, f8[::1])")
def lowest(places: Array, body: int, numbers: Array, i: int, out: Array) -> None:
    """Write contact point and gap, shape (4,), of one point of a body above a half-space.

    Parameters
    ----------
    places : ndarray, shape (b, 4, 3)
        Placements of the bodies: columns of the rotation, then the origin.
    body : int
        The body of the point, as a place in `places`.
    numbers, i
        The array of all points, and the row of this one.
    """
    P, n = places, numbers
    x, y, z = n[i, 0], n[i, 1], n[i, 2]
    if n[i, 3] != 0.0 or n[i, 4] != 0.0 or n[i, 5] != 0.0:
        u = P[body, 0, 0] * n[i, 12] + P[body, 0, 1] * n[i, 13] + P[body, 0, 2] * n[i, 14]
        v = P[body, 1, 0] * n[i, 12] + P[body, 1, 1] * n[i, 13] + P[body, 1, 2] * n[i, 14]
        w = P[body, 2, 0] * n[i, 12] + P[body, 2, 1] * n[i, 13] + P[body, 2, 2] * n[i, 14]
        a = n[i, 3] * u + n[i, 4] * v + n[i, 5] * w
        b = n[i, 6] * u + n[i, 7] * v + n[i, 8] * w
        c = n[i, 9] * u + n[i, 10] * v + n[i, 11] * w
        length, largest = np.sqrt(a * a + b * b + c * c), 0.0
        for k in range(3, 12):
            largest = max(largest, abs(n[i, k]))
        if length > _LEVEL * largest:
            a, b, c = -a / length, -b / length, -c / length
        else:
            a, b, c = 1.0, 0.0, 0.0
        x += n[i, 3] * a + n[i, 6] * b + n[i, 9] * c
        y += n[i, 4] * a + n[i, 7] * b + n[i, 10] * c
        z += n[i, 5] * a + n[i, 8] * b + n[i, 11] * c
    out[3] = -n[i, 16]
    for k in range(3):
        where = x * P[body, 0, k] + y * P[body, 1, k] + z * P[body, 2, k] + P[body, 3, k]
        out[3] += where * n[i, 12 + k]
        out[k] = where - n[i, 15] * n[i, 12 + k]


@kernel("void(f8[:,:,::1], i8[:,::1], f8[:,::1], f8[::1], f8[:,::1])")
def stand(places: Array, owners: Array, numbers: Array, gap: Array, point: Array) -> None:
    """Write gaps, shape (k,), and contact points, shape (k, 3), of points of bodies above half-spaces.

    Parameters
    ----------
    places : ndarray, shape (b, 4, 3)
        Placements of the bodies: columns of the rotation, then the origin.
    owners : ndarray of int, shape (k, 2)
        The place of each point's body in `places`, and the point's pair.
    numbers
        As above.
    """
    out = np.empty(4)
    for i in range(len(owners)):
        lowest(places, owners[i, 0], numbers, i, out)
        point[i, 0], point[i, 1], point[i, 2], gap[i] = out[0], out[1], out[2], out[3]


@kernel("b1(f8[:,:,::1], i8, f8[:,::1], i8)")
def is_tilted(places: Array, body: int, numbers: Array, i: int) -> bool:
    """Return whether point i is that of a rim, and not one of an ellipsoid, and the rim is tilted; see `lowest`."""
    P, n, square, across = places, numbers, 0.0, 0.0
    for k in range(9, 12):
        if n[i, k] != 0.0:
            return False
    for j in range(3, 9, 3):
        along = 0.0
        for k in range(3):
            up = P[body, k, 0] * n[i, 12] + P[body, k, 1] * n[i, 13] + P[body, k, 2] * n[i, 14]
            along += n[i, j + k] * up
            square += n[i, j + k] * n[i, j + k]
        across += along * along
    # both half axes are radii
    return across > TILTED * TILTED * 0.5 * square


@kernel("Tuple((i8, f8))(f8[:,:,::1], Points, i8, f8, i8)")
def each_point_below(places: Array, points: Points, pair: int, tolerance: float, at: int) -> tuple[int, float]:
    """Do what `points_below` does by looking at every point."""
    out, count, least, body, numbers = points.out, 0, np.inf, points.body[pair], points.numbers
    begin, end = points.begin[pair], points.begin[pair + 1]
    # the rims of a cylinder come behind its fixed points
    tilted = end > begin and is_tilted(places, body, numbers, end - 1)
    for i in range(begin, end):
        if tilted and not (numbers[i, 3] != 0.0 or numbers[i, 4] != 0.0 or numbers[i, 5] != 0.0):
            continue
        lowest(places, body, numbers, i, out)
        least = min(least, out[3])
        if out[3] <= tolerance:
            points.found[at + count] = i
            count += 1
    return count, least


@kernel("Tuple((i8, f8))(f8[:,:,::1], Points, i8, f8, i8)")
def points_below(places: Array, points: Points, pair: int, tolerance: float, at: int) -> tuple[int, float]:
    """List the points of the shape of a pair whose gap is within a tolerance, ascending, from place `at` of `found` on.

    On a hull with a graph these are found from the lowest one, through neighbours: they are connected.

    Returns
    -------
    count : int
        How many points there are.
    least : float
        The least gap [m].
    """
    out, count, least, body, numbers = points.out, 0, np.inf, points.body[pair], points.numbers
    first, neighbour, found = points.first, points.neighbour, points.found
    begin, end = points.begin[pair], points.begin[pair + 1]
    if first[begin + 1] == first[begin]:
        return each_point_below(places, points, pair, tolerance, at)
    P, n = places[body], numbers[begin]
    x = -(P[0, 0] * n[12] + P[0, 1] * n[13] + P[0, 2] * n[14])
    y = -(P[1, 0] * n[12] + P[1, 1] * n[13] + P[1, 2] * n[14])
    z = -(P[2, 0] * n[12] + P[2, 1] * n[13] + P[2, 2] * n[14])
    best = outermost(numbers, begin, end, first, neighbour, x, y, z, points.start[pair])
    points.start[pair] = best
    lowest(places, body, numbers, best, out)
    least = out[3]
    if not least <= tolerance:
        return 0, least
    # a little farther than the tolerance, for rounding; then exactly
    low = numbers[best, 0] * x + numbers[best, 1] * y + numbers[best, 2] * z
    low -= (tolerance - least) + 1e-12 * (abs(low) + tolerance - least)
    near = connected(numbers, begin, end, first, neighbour, x, y, z, best, low, end - begin, found[at:], points.taken)
    for i in range(at, at + near):
        lowest(places, body, numbers, found[i], out)
        if out[3] <= tolerance:
            # in its place by its number
            k, j = found[i], at + count
            while j > at and found[j - 1] > k:
                found[j] = found[j - 1]
                j -= 1
            found[j] = k
            count += 1
    return count, least


@kernel("b1(f8[:,::1], Points, i8, f8)")
def stays_above(place: Array, points: Points, k: int, tilt: float) -> bool:
    """Return whether a vertex stays above one of its neighbours on a hull that is tilted by a slope of at most `tilt`.

    `place`, shape (4, 3), is the placement of the body. The neighbour may stay above another one, and so on, but the
    last of them does not: as long as that one is above the half-space, so is the vertex.
    """
    n = points.numbers
    x = place[0, 0] * n[k, 12] + place[0, 1] * n[k, 13] + place[0, 2] * n[k, 14]
    y = place[1, 0] * n[k, 12] + place[1, 1] * n[k, 13] + place[1, 2] * n[k, 14]
    z = place[2, 0] * n[k, 12] + place[2, 1] * n[k, 13] + place[2, 2] * n[k, 14]
    for i in range(points.first[k], points.first[k + 1]):
        j = points.neighbour[i]
        u, v, w = n[k, 0] - n[j, 0], n[k, 1] - n[j, 1], n[k, 2] - n[j, 2]
        height = u * x + v * y + w * z
        if height > 0.0 and height * height > tilt * tilt * (u * u + v * v + w * w - height * height):
            return True
    return False


@kernel("void(Points, i8, i8, f8[::1], f8, b1[::1])")
def few_of_each_face(points: Points, pair: int, at: int, gap: Array, low: float, wanted: Array) -> None:
    """Keep of the points of each flat face those that `few_corners` chooses.

    Parameters
    ----------
    points, pair, at
        See `spread_below`.
    gap : ndarray, shape (k,)
        Gaps of the points from place `at` of `found` on [m].
    low : float
        The gap up to which points count as touching [m].
    wanted : ndarray of bool, shape (k,)
        Which of them are kept.
    """
    place, own, index = np.empty((len(gap), 2)), np.empty(len(gap)), np.empty(len(gap), np.int64)
    along, across, chosen, size = np.empty(3), np.empty(3), np.empty(FEW_POINTS, np.int64), points.size[pair]
    for f in range(points.faces[pair], points.faces[pair + 1]):
        j, end, number, least = points.face[f], points.face[f + 1], 0, np.inf
        within_plane(points.facing[f], along, across)
        for i in range(len(gap)):
            k = points.found[at + i]
            # both ascend
            while j < end and points.corner[j] < k:
                j += 1
            if wanted[i] and j < end and points.corner[j] == k:
                n, place[number, 0], place[number, 1] = points.numbers[k], 0.0, 0.0
                for c in range(3):
                    place[number, 0] += n[c] * along[c]
                    place[number, 1] += n[c] * across[c]
                index[number], own[number], least = i, gap[i], min(least, gap[i])
                number += 1
        if number <= FEW_POINTS:
            continue
        touching = max(low, least + FLAT * size)
        kept = few_corners(place[:number], own[:number], touching, chosen)
        for i in range(number):
            wanted[index[i]] = False
        for i in range(kept):
            wanted[index[chosen[i]]] = True


@kernel("i8(f8[:,:,::1], Points, i8, f8, i8, i8)")
def spread_below(places: Array, points: Points, pair: int, tolerance: float, at: int, count: int) -> int:
    """Keep few of the points that `points_below` has listed within a tolerance, if there are more than `FEW_POINTS`.

    Points that touch are those below the surface of the half-space, or about as low as the lowest one.

    - A point above these is left out if it stays above a neighbour however the hull turns, unless a point of the hull
      moves farther than the tolerance.
    - Of each flat face of the hull at most `FEW_POINTS` corners are kept.
    - Of points of several faces that touch together those are kept that `spread_out` chooses.

    They are the `count` ones from place `at` of `found` on, of which the kept ones are moved to the front. Returns how
    many are kept.
    """
    if count <= FEW_POINTS:
        return count
    found, body, numbers, size = points.found, points.body[pair], points.numbers, points.size[pair]
    out, along, across, least = points.out, np.empty(3), np.empty(3), np.inf
    place, gap, wanted = np.empty((count, 2)), np.empty(count), np.ones(count, np.bool_)
    within_plane(numbers[found[at], 12:15], along, across)
    for i in range(count):
        lowest(places, body, numbers, found[at + i], out)
        gap[i], least = out[3], min(least, out[3])
        place[i, 0] = out[0] * along[0] + out[1] * along[1] + out[2] * along[2]
        place[i, 1] = out[0] * across[0] + out[1] * across[1] + out[2] * across[2]
    low, tilt = max(least, 0.0) + FLAT * size, (tolerance - min(least, 0.0)) / points.width[pair]
    for i in range(count):
        wanted[i] = gap[i] <= low or not stays_above(places[body], points, found[at + i], tilt)
    few_of_each_face(points, pair, at, gap, low, wanted)
    face, chosen, flat = np.empty(count, np.int64), np.empty(count + 1, np.int64), 0
    for i in range(count):
        if wanted[i] and gap[i] <= low:
            # the next place is not behind this one
            gap[flat], face[flat], place[flat, 0], place[flat, 1] = gap[i], i, place[i, 0], place[i, 1]
            flat += 1
    if flat > FEW_POINTS:
        for i in range(flat):
            wanted[face[i]] = False
        for i in range(spread_out(place[:flat], gap[:flat], BESIDE * size, chosen)):
            wanted[face[chosen[i]]] = True
    kept = 0
    for i in range(count):
        if wanted[i]:
            found[at + kept] = found[at + i]
            kept += 1
    return kept

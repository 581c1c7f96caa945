"""The lowest points of shapes above half-spaces, and their gaps.

A support point is fixed in its body, or it is the lowest point of a rim or an ellipsoid. Each is a row of the array
`numbers`, shape (k, 17): 0-2 its position in the body, or the centre of the rim or ellipsoid [m]; 3-11 the three half
axes of that in the body, zero for a fixed point; 12-14 the normal of the half-space; 15 the radius of the ball around
the point; 16 that radius plus the offset of the half-space [m].
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..arguments import Array
from ..compiled import kernel, record
from .hull_graph import connected, outermost
from .spread import BESIDE, FEW_POINTS, FLAT, spread_out
from .vectors import within_plane

# a rim tilted by less than this angle is level: all of its points are lowest, and the first axis gives one [rad]
_LEVEL = 1e-9


@record("i8[::1], i8[::1], f8[:,::1], i8[::1], i8[::1], f8[::1], i8[::1], i8[::1], b1[::1], f8[::1]")
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


@kernel("Tuple((i8, f8))(f8[:,:,::1], Points, i8, f8, i8)")
def each_point_below(places: Array, points: Points, pair: int, tolerance: float, at: int) -> tuple[int, float]:
    """Do what `points_below` does by looking at every point."""
    out, count, least, body, numbers = points.out, 0, np.inf, points.body[pair], points.numbers
    for i in range(points.begin[pair], points.begin[pair + 1]):
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


@kernel("i8(f8[:,:,::1], Points, i8, i8, i8)")
def spread_below(places: Array, points: Points, pair: int, at: int, count: int) -> int:
    """Keep few of the points that `points_below` has listed, if they touch a half-space together; see `spread_out`.

    They are the `count` ones from place `at` of `found` on, of which the kept ones are moved to the front. Returns how
    many are kept.
    """
    if count <= FEW_POINTS:
        return count
    found, body, numbers, size = points.found, points.body[pair], points.numbers, points.size[pair]
    out, along, across, least = points.out, np.empty(3), np.empty(3), np.inf
    place, gap = np.empty((count, 2)), np.empty(count)
    face, chosen = np.empty(count, np.int64), np.empty(count + 1, np.int64)
    within_plane(numbers[found[at], 12:15], along, across)
    for i in range(count):
        lowest(places, body, numbers, found[at + i], out)
        least = min(least, out[3])
    # the face: all points that are below the half-space's surface, or about as low as the lowest
    flat = 0
    for i in range(count):
        lowest(places, body, numbers, found[at + i], out)
        if out[3] <= max(least, 0.0) + FLAT * size:
            gap[flat], face[flat] = out[3], i
            place[flat, 0] = out[0] * along[0] + out[1] * along[1] + out[2] * along[2]
            place[flat, 1] = out[0] * across[0] + out[1] * across[1] + out[2] * across[2]
            flat += 1
    if flat <= FEW_POINTS:
        return count
    number = spread_out(place[:flat], gap[:flat], BESIDE * size, chosen)
    kept, next_flat, next_chosen = 0, 0, 0
    for i in range(count):
        wanted = True
        if next_flat < flat and face[next_flat] == i:
            wanted = next_chosen < number and chosen[next_chosen] == next_flat
            next_flat += 1
            if wanted:
                next_chosen += 1
        if wanted:
            found[at + kept] = found[at + i]
            kept += 1
    return kept

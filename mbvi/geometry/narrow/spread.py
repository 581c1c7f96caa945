"""Few of many points of one shape near a plane: those of which the others are combinations, within a tolerance.

The rates of the gaps of points on one body above one plane are linear in the place of the point within the plane. A
point within the convex hull of others therefore adds nothing to the impact law. A point that lies outside the hull of
the chosen ones by d sinks by no more than d times the angle by which the body turns in a step; then it is the deepest
one, and is chosen.

Points of one flat face have gaps that are linear in the place too: of these at most `FEW_POINTS` corners are chosen.
"""

from __future__ import annotations

import numpy as np

from ...arguments import Array
from ...compiled import kernel

# up to this number all points are kept; of one flat face no more are kept
FEW_POINTS = 8
# how far outside the hull of the chosen points another may lie, relative to the bounding radius of its shape: a body
# that turns by 1e-2 rad in a step sinks by at most 1e-4 of its size
BESIDE = 1e-2
# by how much gaps of a face above its plane may differ, relative to the same radius
FLAT = 1e-4
# points are on one flat face within this part of the same radius, a tenth of the tolerance that simplifies meshes
ONE_FACE = 1e-5
# which of two points is farther is decided by their numbers, if they are equal to this relative difference: where
# rounding decided, other points would be chosen at every step
_EQUAL = 1e-9
# how far a circle lies outside its octagon, relative to its radius
_OCTAGON = 1.0 - np.cos(np.pi / 8.0)
# points that touch are chosen first up to this number, so that others of their face remain as it tilts
_MOST_TOUCHING = 6
_DIAGONAL = np.sqrt(0.5)


@kernel("i8(f8[:,::1], f8[::1], f8, i8)")
def _farthest(place: Array, gap: Array, low: float, a: int) -> int:
    """Return the point with a gap of at most `low` [m] that is farthest from point a; a itself if there is no other."""
    best, far = a, 0.0
    for i in range(len(gap)):
        if gap[i] <= low:
            square = (place[i, 0] - place[a, 0]) ** 2 + (place[i, 1] - place[a, 1]) ** 2
            if square > far * (1.0 + _EQUAL):
                best, far = i, square
    return best


@kernel("Tuple((i8, f8))(f8[:,::1], f8[::1], f8, i8, i8)")
def _outside(place: Array, gap: Array, low: float, a: int, b: int) -> tuple[int, float]:
    """Return the point with a gap of at most `low` that is farthest to the right of the line from a to b, and how far.

    Of points equally far, as on an edge along the line, it is the last one: a corner. The distance is times that of a
    and b [m^2]. Where there is no such point these are a and zero.
    """
    x, y, best, far, last = place[b, 0] - place[a, 0], place[b, 1] - place[a, 1], a, 0.0, 0.0
    for i in range(len(gap)):
        if gap[i] <= low:
            u, v = place[i, 0] - place[a, 0], place[i, 1] - place[a, 1]
            area, along = u * y - v * x, u * x + v * y
            if area > far * (1.0 + _EQUAL) or (best != a and area > far * (1.0 - _EQUAL) and along > last):
                best, far, last = i, area, along
    return best, far


@kernel("i8(f8[:,::1], f8[::1], f8, f8, i8[::1], i8, i8)")
def _grow(place: Array, gap: Array, low: float, beside: float, corner: Array, count: int, most: int) -> int:
    """Add corners to a polygon, each time the one that adds the largest triangle; return how many there are then.

    Parameters
    ----------
    place, gap
        See `few_corners`.
    low, beside : float
        Points with a gap of at most `low`, and farther than `beside` outside an edge, are added [m].
    corner : ndarray of int, shape (FEW_POINTS,)
        The corners, counter-clockwise.
    count, most : int
        How many there are, at least one, and how many there may be.
    """
    if count == 1:
        far = _farthest(place, gap, low, corner[0])
        x, y = place[far, 0] - place[corner[0], 0], place[far, 1] - place[corner[0], 1]
        if x * x + y * y <= beside * beside:
            return count
        corner[1], count = far, 2
    while count < most:
        best, side, largest = -1, 0, 0.0
        for k in range(count):
            a, b = corner[k], corner[(k + 1) % count]
            i, area = _outside(place, gap, low, a, b)
            x, y = place[b, 0] - place[a, 0], place[b, 1] - place[a, 1]
            if area > largest * (1.0 + _EQUAL) and area > beside * np.sqrt(x * x + y * y):
                best, side, largest = i, k, area
        if best < 0:
            break
        for k in range(count, side + 1, -1):
            corner[k] = corner[k - 1]
        corner[side + 1] = best
        count += 1
    return count


@kernel("void(i8[::1], i8)")
def make_ascending(index: Array, count: int) -> None:
    """Sort the first `count` indices."""
    for k in range(1, count):
        i, j = index[k], k
        while j > 0 and index[j - 1] > i:
            index[j] = index[j - 1]
            j -= 1
        index[j] = i


@kernel("i8(f8[:,::1], f8[::1], f8, i8[::1])")
def few_corners(place: Array, gap: Array, low: float, chosen: Array) -> int:
    """Choose at most `FEW_POINTS` of the points of one flat face, the deepest one among them.

    Points that touch go first, up to six of them: corners of their convex hull, until the others lie outside of it by
    less than eight corners leave on a circle, 0.08 of its radius. The rest are corners of the hull of all. A face of at
    most `FEW_POINTS` corners keeps all of them.

    Parameters
    ----------
    place : ndarray, shape (k, 2)
        Places within the face [m].
    gap : ndarray, shape (k,)
        Gaps [m].
    low : float
        The gap up to which points count as touching, at least the least gap [m].
    chosen : ndarray of int, shape (FEW_POINTS,)
        Receives the indices of the chosen points, ascending, in its first places.

    Returns
    -------
    int
        How many are chosen.
    """
    deepest = 0
    for i in range(len(gap)):
        if gap[i] < gap[deepest]:
            deepest = i
    one = _farthest(place, gap, np.inf, deepest)
    other = _farthest(place, gap, np.inf, one)
    radius = 0.5 * np.sqrt((place[one, 0] - place[other, 0]) ** 2 + (place[one, 1] - place[other, 1]) ** 2)
    corner, bottom = chosen, gap[deepest] + _EQUAL * radius
    # of several points as deep the first that is a corner, so that rounding does not choose
    first = 0
    while gap[first] > bottom:
        first += 1
    corner[0] = _farthest(place, gap, bottom, first)
    count = _grow(place, gap, low, _OCTAGON * radius, corner, 1, _MOST_TOUCHING)
    count = _grow(place, gap, np.inf, _EQUAL * radius, corner, count, FEW_POINTS)
    make_ascending(corner, count)
    return count


@kernel("b1(f8[:,::1], f8[::1], f8)")
def one_face(place: Array, gap: Array, size: float) -> bool:
    """Return whether gaps, shape (k,), are linear in the places, shape (k, 2), within `ONE_FACE` of a radius [m]."""
    a = _farthest(place, gap, np.inf, 0)
    b = _farthest(place, gap, np.inf, a)
    best, most, sign = a, 0.0, 1.0
    for turn in range(2):
        i, area = _outside(place, gap, np.inf, a if turn == 0 else b, b if turn == 0 else a)
        if area > most:
            best, most, sign = i, area, 1.0 - 2.0 * turn
    x, y = place[b, 0] - place[a, 0], place[b, 1] - place[a, 1]
    length = np.sqrt(x * x + y * y)
    u = v = 0.0
    if length > 0.0:
        along = (gap[b] - gap[a]) / length
        across = 0.0
        if most > _EQUAL * size * length:
            s = ((place[best, 0] - place[a, 0]) * x + (place[best, 1] - place[a, 1]) * y) / length
            across = (gap[best] - gap[a] - along * s) / (most / length)
        # the direction in which `best` lies beside the line from a to b
        u, v = (along * x + sign * across * y) / length, (along * y - sign * across * x) / length
    for i in range(len(gap)):
        apart = gap[i] - gap[a] - u * (place[i, 0] - place[a, 0]) - v * (place[i, 1] - place[a, 1])
        if abs(apart) > ONE_FACE * size:
            return False
    return True


@kernel("i8(f8[:,::1], f8[::1], f8, i8[::1])")
def spread_out(place: Array, gap: Array, beside: float, chosen: Array) -> int:
    """Choose the deepest of some points, and points whose convex hull holds all others to a tolerance.

    Parameters
    ----------
    place : ndarray, shape (k, 2)
        Places within the plane [m].
    gap : ndarray, shape (k,)
        Gaps [m].
    beside : float
        By how much other points may lie beyond an edge of the hull of the chosen ones [m].
    chosen : ndarray of int, shape (k + 1,)
        Receives the indices of the chosen points, ascending, in its first places.

    Returns
    -------
    int
        How many are chosen.
    """
    k, corners, count = len(gap), np.empty(len(gap) + 9, np.int64), 0
    for turn in range(8):
        # the eight directions counter-clockwise
        x = 1.0 if turn == 0 else (-1.0 if turn == 4 else 0.0)
        y = 1.0 if turn == 2 else (-1.0 if turn == 6 else 0.0)
        if turn % 2 == 1:
            x = _DIAGONAL if turn == 1 or turn == 7 else -_DIAGONAL
            y = _DIAGONAL if turn == 1 or turn == 3 else -_DIAGONAL
        best = 0
        for i in range(1, k):
            if (place[i, 0] - place[best, 0]) * x + (place[i, 1] - place[best, 1]) * y > 0.0:
                best = i
        if count == 0 or (best != corners[count - 1] and best != corners[0]):
            corners[count] = best
            count += 1
    at = 0
    while at < count and count < k:
        a, b = corners[at], corners[(at + 1) % count]
        x, y = place[b, 0] - place[a, 0], place[b, 1] - place[a, 1]
        length = np.sqrt(x * x + y * y)
        far, best = beside * length, -1
        for i in range(k):
            beyond = (place[i, 0] - place[a, 0]) * y - (place[i, 1] - place[a, 1]) * x
            if beyond > far:
                far, best = beyond, i
        if best < 0 or best == a or best == b:
            at += 1
            continue
        for i in range(count, at + 1, -1):
            corners[i] = corners[i - 1]
        corners[at + 1] = best
        count += 1
    deepest = 0
    for i in range(1, k):
        if gap[i] < gap[deepest]:
            deepest = i
    number = 0
    for i in range(k):
        wanted = i == deepest
        for c in range(count):
            wanted = wanted or corners[c] == i
        if wanted:
            chosen[number] = i
            number += 1
    return number

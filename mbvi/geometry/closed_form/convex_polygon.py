"""Convex polygons in a plane, which may be segments or points: the hull of points, and the common part of two."""

from __future__ import annotations

import numpy as np

from ...arguments import Array
from ...compiled import kernel

# lengths within this part of the size of the polygons are rounding
_ROUND = 1e-9
# of more points than this those inside the octagon of the outermost ones are left out, if they are inside by more than
# this part of the size
_MANY, _INSIDE = 16, 1e-6
# two segments whose angle has a smaller sine are parallel
_PARALLEL = 1e-6


@kernel("f8(f8[:,::1], i8, i8, f8, f8)")
def _beyond(place: Array, a: int, b: int, x: float, y: float) -> float:
    """Return how far a point lies to the right of the line from one corner to another; 0 if the corners coincide."""
    u, v = place[b, 0] - place[a, 0], place[b, 1] - place[a, 1]
    length = np.sqrt(u * u + v * v)
    return ((x - place[a, 0]) * v - (y - place[a, 1]) * u) / length if length > 0.0 else 0.0


@kernel("b1(f8[:,::1], i8, i8, f8, f8, f8)")
def _turns_right(place: Array, a: int, b: int, x: float, y: float, size: float) -> bool:
    """Return whether `_beyond` is above zero, or below it by no more than rounding."""
    u, v = place[b, 0] - place[a, 0], place[b, 1] - place[a, 1]
    area = (x - place[a, 0]) * v - (y - place[a, 1]) * u
    if area >= 0.0:
        return True
    # most are far below: these need no root
    if area * area > 4.0 * (_ROUND * size) ** 2 * (u * u + v * v):
        return False
    return area / np.sqrt(u * u + v * v) >= -_ROUND * size


@kernel("i8(f8[:,::1], i8, f8, i8[::1])")
def _list_outer(place: Array, count: int, size: float, order: Array) -> int:
    """List the points that may be corners of the hull, shape (count,); return how many there are."""
    if count <= _MANY:
        for i in range(count):
            order[i] = i
        return count
    # lines between the outermost points along eight directions, counter-clockwise: a x + b y >= c inside
    end, most, lines, left = np.zeros(8, np.int64), np.full(8, -np.inf), np.empty((8, 3)), 0
    for i in range(count):
        x, y = place[i, 0], place[i, 1]
        for k in range(4):
            along = x if k == 0 else x + y if k == 1 else y if k == 2 else y - x
            if along > most[k]:
                most[k], end[k] = along, i
            if -along > most[k + 4]:
                most[k + 4], end[k + 4] = -along, i
    for k in range(8):
        a, b = end[k], end[(k + 1) % 8]
        u, v = place[b, 0] - place[a, 0], place[b, 1] - place[a, 1]
        lines[k, 0], lines[k, 1] = -v, u
        lines[k, 2] = u * place[a, 1] - v * place[a, 0] + _INSIDE * size * np.sqrt(u * u + v * v)
    for i in range(count):
        inside = True
        for k in range(8):
            inside = inside and lines[k, 0] * place[i, 0] + lines[k, 1] * place[i, 1] >= lines[k, 2]
        if not inside:
            order[left] = i
            left += 1
    return left


@kernel("i8(f8[:,::1], i8, f8, f8[:,::1])")
def convex_hull(place: Array, count: int, size: float, corners: Array) -> int:
    """Write the corners of the convex hull of points, counter-clockwise.

    Parameters
    ----------
    place, count : ndarray, shape (k, 2), and int
        The points, of which the first `count` are meant [m].
    size : float
        The length of which rounding is a part [m].
    corners : ndarray, shape (2 k, 2)
        Receives the corners.

    Returns
    -------
    int
        How many corners there are: 2 of a segment, 1 of a point.
    """
    order = np.empty(count, np.int64)
    count, m = _list_outer(place, count, size, order), 0
    # from left to right, of equal ones from below
    for i in range(count):
        k, j = order[i], i
        x, y = place[k, 0], place[k, 1]
        while j > 0 and (place[order[j - 1], 0] > x or (place[order[j - 1], 0] == x and place[order[j - 1], 1] > y)):
            order[j] = order[j - 1]
            j -= 1
        order[j] = k
    for turn in range(2):
        # the lower chain from left to right, then the upper one back
        floor = m + 1 if turn == 0 else m
        for i in range(count):
            k = order[i] if turn == 0 else order[count - 1 - i]
            x, y = place[k, 0], place[k, 1]
            while m > floor and _turns_right(corners, m - 2, m - 1, x, y, size):
                m -= 1
            if m == 0 or abs(corners[m - 1, 0] - x) + abs(corners[m - 1, 1] - y) > _ROUND * size:
                corners[m, 0], corners[m, 1] = x, y
                m += 1
    # the chains end where they began
    if m > 1 and abs(corners[m - 1, 0] - corners[0, 0]) + abs(corners[m - 1, 1] - corners[0, 1]) <= _ROUND * size:
        m -= 1
    return m


@kernel("i8(f8[:,::1], i8, f8[:,::1], i8, f8, f8[:,::1])")
def _common_segment(one: Array, m: int, other: Array, k: int, size: float, common: Array) -> int:
    """Write the common part of two parallel segments or points on one line; return how many ends it has."""
    a, b = one, other
    if m == 1:
        a, b, m, k = other, one, k, m
    if m == 1:
        apart = abs(a[0, 0] - b[0, 0]) + abs(a[0, 1] - b[0, 1])
        common[0, 0], common[0, 1] = a[0, 0], a[0, 1]
        return 1 if apart <= _ROUND * size else 0
    x, y = a[1, 0] - a[0, 0], a[1, 1] - a[0, 1]
    length = np.sqrt(x * x + y * y)
    x, y = x / length, y / length
    low, high = np.inf, -np.inf
    for i in range(k):
        u, v = b[i, 0] - a[0, 0], b[i, 1] - a[0, 1]
        along = u * x + v * y
        low, high = min(low, along), max(high, along)
    u, v = b[k - 1, 0] - b[0, 0], b[k - 1, 1] - b[0, 1]
    beside = abs((b[0, 0] - a[0, 0]) * y - (b[0, 1] - a[0, 1]) * x)
    if abs(u * y - v * x) > _PARALLEL * np.sqrt(u * u + v * v) or beside > _PARALLEL * size:
        return 0
    low, high = max(low, 0.0), min(high, length)
    if low > high + _ROUND * size:
        return 0
    common[0, 0], common[0, 1] = a[0, 0] + low * x, a[0, 1] + low * y
    common[1, 0], common[1, 1] = a[0, 0] + high * x, a[0, 1] + high * y
    return 2


@kernel("i8(f8[:,::1], i8, f8[:,::1], i8, f8, f8[:,::1], f8[:,::1])")
def common_polygon(one: Array, m: int, other: Array, k: int, size: float, common: Array, scratch: Array) -> int:
    """Write the corners of the common part of two convex polygons, counter-clockwise.

    Parameters
    ----------
    one, m, other, k : ndarray, shape (a, 2), and int
        The polygons as `convex_hull` writes them, and how many corners they have.
    size : float
        The length of which rounding is a part [m].
    common, scratch : ndarray, shape (2 (m + k), 2)
        `common` receives the corners.

    Returns
    -------
    int
        How many corners there are; two segments that cross have none.
    """
    if m == 0 or k == 0:
        return 0
    if m < 3 and k < 3:
        return _common_segment(one, m, other, k, size, common)
    part, by, count, sides = one, other, m, k
    if k < 3:
        part, by, count, sides = other, one, k, m
    for i in range(count):
        common[i, 0], common[i, 1] = part[i, 0], part[i, 1]
    for side in range(sides):
        end, kept = (side + 1) % sides, 0
        first = there = _beyond(by, side, end, common[0, 0], common[0, 1]) if count > 0 else 0.0
        for i in range(count):
            j = (i + 1) % count
            x, y, here = common[i, 0], common[i, 1], there
            there = _beyond(by, side, end, common[j, 0], common[j, 1]) if j > 0 else first
            if here <= _ROUND * size:
                scratch[kept, 0], scratch[kept, 1] = x, y
                kept += 1
            if (here > _ROUND * size) != (there > _ROUND * size):
                share = min(max(here / (here - there), 0.0), 1.0)
                scratch[kept, 0] = x + share * (common[j, 0] - x)
                scratch[kept, 1] = y + share * (common[j, 1] - y)
                kept += 1
        count = kept
        for i in range(count):
            common[i, 0], common[i, 1] = scratch[i, 0], scratch[i, 1]
    return count

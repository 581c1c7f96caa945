"""Few of the points of one shape near one plane: at most `FEW_POINTS`, which bear load as all of them do.

The gaps of points on one body above one plane change by a function that is linear in the place of the point within the
plane. A point within the convex hull of others that are as low therefore adds nothing to the impact law. Of points that
touch the plane together corners of their hull are chosen; the others lie outside of these by less than a fifth of the
shape's radius. Of points above them those are chosen that become lowest as the body tilts. If a point that is left out
sinks, it is the deepest one, which is chosen.
"""

from __future__ import annotations

import numpy as np

from ..arguments import Array
from ..compiled import kernel

# the most points of one shape near one plane, or of one shape near another, that become rows
FEW_POINTS = 8
# points touch a plane together if their gaps differ by no more than this part of the shape's bounding radius
_TOUCHING = 1e-7
# which of two points is farther is decided by their numbers, if they are equal to this relative difference: where
# rounding decided, other points would be chosen at every step
_EQUAL = 1e-9
# differences of gaps that rounding makes, relative to the bounding radius
_ROUNDING = 1e-12
# a polygon gets a corner more if its area grows by this part at least
_WORTH = 1e-3
_DIAGONAL = np.sqrt(0.5)


@kernel("Tuple((i8, f8))(f8[:,::1], b1[::1], i8, i8)")
def _outside(place: Array, low: Array, a: int, b: int) -> tuple[int, float]:
    """Return the point of some that is farthest to the right of the line from a to b, and twice the triangle's area.

    Where no point is, that is a, and zero.
    """
    x, y, best, far = place[b, 0] - place[a, 0], place[b, 1] - place[a, 1], a, 0.0
    for i in range(len(low)):
        if low[i]:
            area = (place[i, 0] - place[a, 0]) * y - (place[i, 1] - place[a, 1]) * x
            if area > far * (1.0 + _EQUAL):
                best, far = i, area
    return best, far


@kernel("i8(f8[:,::1], b1[::1], i8)")
def _farthest(place: Array, low: Array, a: int) -> int:
    """Return the point of some that is farthest from point a."""
    best, far = a, 0.0
    for i in range(len(low)):
        if low[i]:
            square = (place[i, 0] - place[a, 0]) ** 2 + (place[i, 1] - place[a, 1]) ** 2
            if square > far * (1.0 + _EQUAL):
                best, far = i, square
    return best


@kernel("i8(f8[:,::1], f8[::1], b1[::1], i8, f8, i8[::1])")
def _corners(place: Array, gap: Array, low: Array, deepest: int, rounding: float, corner: Array) -> int:
    """Write the corners of a polygon that holds some points, one of them as deep as the deepest; return how many.

    Each corner is the one that adds the largest triangle to the corners before it. `corner` has the shape (8,).
    """
    start = 0
    while not low[start]:
        start += 1
    corner[0] = _farthest(place, low, _farthest(place, low, start))
    corner[1] = _farthest(place, low, corner[0])
    count, last, known, total = 2, corner[1], False, 0.0
    while count < FEW_POINTS:
        best, side, most = -1, 0, 0.0
        for k in range(count):
            # the corners follow each other counter-clockwise
            i, area = _outside(place, low, corner[k], corner[(k + 1) % count])
            if area > most * (1.0 + _EQUAL):
                best, side, most = i, k, area
        if most <= _WORTH * total:
            break
        for k in range(count, side + 1, -1):
            corner[k] = corner[k - 1]
        corner[side + 1], last = best, best
        total += most
        count += 1
    for k in range(count):
        known = known or gap[corner[k]] <= gap[deepest] + rounding
    for k in range(count):
        if not known and count == FEW_POINTS and corner[k] == last:
            # in place of the corner that adds the smallest triangle
            corner[k], known = deepest, True
    if not known:
        corner[count] = deepest
        count += 1
    return count


@kernel("f8(f8[:,::1], f8[::1], i8, f8, i8)")
def _descent(place: Array, gap: Array, i: int, tilt: float, turn: int) -> float:
    """Return how far a point is below the place's origin after a small tilt in one of eight directions [m]."""
    x = 1.0 if turn == 0 else (-1.0 if turn == 4 else 0.0)
    y = 1.0 if turn == 2 else (-1.0 if turn == 6 else 0.0)
    if turn % 2 == 1:
        x = _DIAGONAL if turn == 1 or turn == 7 else -_DIAGONAL
        y = _DIAGONAL if turn == 1 or turn == 3 else -_DIAGONAL
    return tilt * (place[i, 0] * x + place[i, 1] * y) - gap[i]


@kernel("i8(f8[:,::1], f8[::1], b1[::1], f8, i8[::1], i8)")
def _add_next(place: Array, gap: Array, low: Array, tilt: float, corner: Array, count: int) -> int:
    """Add the points to a list that are lowest after tilts in eight directions, up to `FEW_POINTS`; return how many.

    Those of `low` are left out.

    Those first that are farthest below the points of the list then.
    """
    best, gain = np.empty(8, np.int64), np.empty(8)
    for turn in range(8):
        best[turn], lowest = -1, -np.inf
        for i in range(len(gap)):
            below = -np.inf if low[i] else _descent(place, gap, i, tilt, turn)
            if below > lowest:
                best[turn], lowest = i, below
        known = -np.inf
        for k in range(count):
            known = max(known, _descent(place, gap, corner[k], tilt, turn))
        gain[turn] = lowest - known
    while count < FEW_POINTS:
        first = 0
        for turn in range(1, 8):
            if gain[turn] > gain[first]:
                first = turn
        if gain[first] <= 0.0:
            break
        gain[first], new = 0.0, True
        for k in range(count):
            new = new and corner[k] != best[first]
        if new:
            corner[count] = best[first]
            count += 1
    return count


@kernel("i8(f8[:,::1], f8[::1], f8, f8, i8[::1])")
def spread_out(place: Array, gap: Array, size: float, tolerance: float, chosen: Array) -> int:
    """Choose at most `FEW_POINTS` of some points of a shape above a plane, the deepest one among them.

    Parameters
    ----------
    place : ndarray, shape (k, 2)
        Places within the plane [m].
    gap : ndarray, shape (k,)
        Gaps [m].
    size : float
        Bounding radius of the shape [m].
    tolerance : float
        The gap up to which points are contacts [m].
    chosen : ndarray of int, shape (k,)
        Receives the indices of the chosen points, ascending, in its first places.

    Returns
    -------
    int
        How many are chosen.
    """
    k, deepest, count = len(gap), 0, 0
    if k <= FEW_POINTS:
        for i in range(k):
            chosen[i] = i
        return k
    for i in range(1, k):
        if gap[i] < gap[deepest]:
            deepest = i
    low, corner, touching = np.empty(k, np.bool_), np.empty(8, np.int64), 0
    for i in range(k):
        low[i] = gap[i] <= gap[deepest] + _TOUCHING * size
        if low[i]:
            if touching < FEW_POINTS:
                corner[touching] = i
            touching += 1
    count = touching
    if touching > FEW_POINTS:
        count = _corners(place, gap, low, deepest, _ROUNDING * size, corner)
    # the tilt within which a point at the tolerance becomes lowest; points that touch lie on no line then
    tilt = min(max(tolerance - gap[deepest], 0.0), size) / size
    count = _add_next(place, gap, low, tilt, corner, count)
    for i in range(count):
        at = i
        while at > 0 and chosen[at - 1] > corner[i]:
            chosen[at] = chosen[at - 1]
            at -= 1
        chosen[at] = corner[i]
    return count

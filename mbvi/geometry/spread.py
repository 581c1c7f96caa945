"""Few of many points of one face: the corners of their convex hull, as many as a tolerance asks.

The rates of the gaps of points on one body above one plane are linear in the place of the point within the plane. A
point within the convex hull of others therefore adds nothing to the impact law. A point that lies outside the hull of
the chosen ones by d sinks by no more than d times the angle by which the body turns in a step; then it is the deepest
one, and is chosen.
"""

from __future__ import annotations

import numpy as np

from ..arguments import Array
from ..compiled import kernel

# up to this number all points are kept
FEW_POINTS = 8
# how far outside the hull of the chosen points another may lie, relative to the bounding radius of its shape: a body
# that turns by 1e-2 rad in a step sinks by at most 1e-4 of its size
BESIDE = 1e-2
# by how much gaps of a face above its plane may differ, relative to the same radius
FLAT = 1e-4
_DIAGONAL = np.sqrt(0.5)


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

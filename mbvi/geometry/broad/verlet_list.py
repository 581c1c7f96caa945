"""Pairs of spheres that are near each other, by hashed cells of several sizes and Verlet lists."""

from __future__ import annotations

import numpy as np

from ...arguments import Array
from ...compiled import kernel, plain_array

_NO_TURNS = np.zeros((0, 3, 3))
# most sizes of cells; radii within a factor of two share one
_LEVELS = 24
# the skin is adapted so that a list is valid for at least and at most so many queries
_FEWEST, _MOST = 6, 20


@kernel("i8(f8[:,::1], f8[::1], i8[::1], f8[::1], f8, i8[::1])")
def _near_balls(centres: Array, radii: Array, level: Array, cell: Array, reach: float, pairs: Array) -> int:
    """Write the pairs of balls whose gap is at most `reach`; return how many there are.

    If they are more than `pairs` has room for, only the first are written.

    Parameters
    ----------
    centres : ndarray, shape (n, 3)
        Centres [m].
    radii : ndarray, shape (n,)
        Radii [m].
    level : ndarray of int, shape (n,)
        The grid that each ball belongs to; larger balls belong to coarser grids.
    cell : ndarray, shape (l,)
        Edge of the cells of each grid: twice the largest radius there, plus `reach`.
    reach : float
        Greatest gap [m].
    pairs : ndarray of int, shape (k,)
        Receives i n + j with i < j, unsorted.
    """
    n, levels = len(radii), len(cell)
    size = 16
    while size < 2 * n:
        size *= 2
    where, bucket = np.empty((n, 3), np.int64), np.empty(n, np.int64)
    # balls sorted by bucket, level after level
    start, order = np.zeros((levels, size + 1), np.int64), np.empty(n, np.int64)
    low, inhabited = np.empty(3), np.zeros(levels, np.int64)
    for c in range(3):
        low[c] = np.inf
        for i in range(n):
            low[c] = min(low[c], centres[i, c])
    for i in range(n):
        inhabited[level[i]] += 1
        for c in range(3):
            where[i, c] = np.int64(np.floor((centres[i, c] - low[c]) / cell[level[i]]))
        key = where[i, 0] * 73856093 ^ where[i, 1] * 19349663 ^ where[i, 2] * 83492791
        bucket[i] = key & (size - 1)
        start[level[i], bucket[i] + 1] += 1
    place = 0
    for k in range(levels):
        start[k, 0] = place
        for b in range(size):
            start[k, b + 1] += start[k, b]
        place = start[k, size]
    fill = start.copy()
    for i in range(n):
        order[fill[level[i], bucket[i]]] = i
        fill[level[i], bucket[i]] += 1
    count = 0
    first, last = np.empty(3, np.int64), np.empty(3, np.int64)
    for i in range(n):
        # a pair is found from its finer ball, of the same level from its first
        for k in range(level[i], levels):
            if inhabited[k] == 0:
                continue
            far = radii[i] + 0.5 * (cell[k] - reach) + reach
            for c in range(3):
                x = centres[i, c] - low[c]
                first[c], last[c] = np.int64(np.floor((x - far) / cell[k])), np.int64(np.floor((x + far) / cell[k]))
            for x in range(first[0], last[0] + 1):
                for y in range(first[1], last[1] + 1):
                    for z in range(first[2], last[2] + 1):
                        b = (x * 73856093 ^ y * 19349663 ^ z * 83492791) & (size - 1)
                        for s in range(start[k, b], start[k, b + 1]):
                            j = order[s]
                            if (k == level[i] and j <= i) or where[j, 0] != x or where[j, 1] != y or where[j, 2] != z:
                                continue
                            square = 0.0
                            for c in range(3):
                                square += (centres[i, c] - centres[j, c]) ** 2
                            together = radii[i] + radii[j] + reach
                            if square <= together * together:
                                if count < len(pairs):
                                    pairs[count] = min(i, j) * n + max(i, j)
                                count += 1
    return count


def near_balls(centres: Array, radii: Array, reach: float) -> Array:
    """Return the pairs of balls with a gap of at most `reach`, as i n + j with i < j, ascending.

    Parameters
    ----------
    centres : ndarray, shape (n, 3)
        Centres [m].
    radii : ndarray, shape (n,)
        Radii [m].
    reach : float
        Greatest gap [m].
    """
    # radii within a factor of two share a grid, so that a coarse cell does not hold many small balls
    level = np.minimum(np.log2(radii / radii.min()).astype(np.int64), _LEVELS - 1)
    largest = np.zeros(int(level.max()) + 1)
    np.maximum.at(largest, level, radii)
    pairs = np.empty(24 * len(radii), np.int64)
    while True:
        count = _near_balls(centres, radii, level, 2.0 * largest + reach, reach, pairs)
        if count <= len(pairs):
            return np.sort(pairs[:count])
        pairs = np.empty(count, np.int64)


@kernel("f8(f8[:,::1], f8[:,::1], f8[:,:,::1], f8[:,:,::1], f8[::1])")
def farthest_moved(old: Array, new: Array, old_turns: Array, new_turns: Array, arms: Array) -> float:
    """Return the largest distance that a point of any shape has moved, less a displacement that all share [m].

    Parameters
    ----------
    old, new : ndarray, shape (n, 3)
        Centres [m].
    old_turns, new_turns : ndarray, shape (n, 3, 3)
        Rotations; shape (0, 3, 3) where they do not count.
    arms : ndarray, shape (n,)
        How far points of each shape are from its centre [m].
    """
    shared, most = np.empty(3), 0.0
    for c in range(3):
        low, high = np.inf, -np.inf
        for i in range(len(new)):
            moved = new[i, c] - old[i, c]
            low, high = min(low, moved), max(high, moved)
        shared[c] = 0.5 * (low + high)
    for i in range(len(new)):
        square = 0.0
        for c in range(3):
            square += (new[i, c] - old[i, c] - shared[c]) ** 2
        travel = np.sqrt(square)
        if len(new_turns) > 0:
            # the chord of a rotation on a sphere of unit radius
            chord = 0.0
            for k in range(3):
                for c in range(3):
                    chord += (new_turns[i, k, c] - old_turns[i, k, c]) ** 2
            travel += np.sqrt(0.5 * chord) * arms[i]
        most = max(most, travel)
    return most


class VerletList:
    """A list of near pairs of spheres, made again when two may have come nearer to each other by the skin.

    Parameters
    ----------
    radii : ndarray, shape (n,)
        Radii [m].
    arms : ndarray, shape (n,), optional
        How far points of each shape are from the centre of its sphere, where its rotation counts; 0 where it does not.

    Attributes
    ----------
    lists : int
        How many lists were made so far.
    reach : float
        The greatest gap of the pairs in the list [m].

    Notes
    -----
    L. Verlet, Physical Review 159 (1967), 98-103. A displacement that all spheres share brings no two nearer to each
    other and is not counted. The skin is widened if lists become invalid after few queries, and narrowed if they stay
    valid for many; it affects speed only.
    """

    def __init__(self, radii: Array, arms: Array | None = None) -> None:
        self._radii, self._arms = radii, np.zeros(0) if arms is None else plain_array(arms)
        self._largest_skin = 2.0 * float(np.median(radii))
        self._skin = 0.3 * self._largest_skin
        self.reach, self._queries, self.lists = -np.inf, _FEWEST, 0
        self._pairs, self._where = np.zeros(0, np.int64), np.zeros((0, 3))
        self._turns = _NO_TURNS

    def within(self, centres: Array, reach: float, turns: Array | None = None) -> Array:
        """Return all pairs with a gap of at most `reach`, and possibly more, as i n + j with i < j, ascending.

        With rotations, shape (n, 3, 3), no point of a shape within its arm has come nearer while the list is valid.
        """
        if not np.isfinite(reach):
            self.lists += 1
            self.reach, self._where = np.inf, np.zeros((0, 3))
            i, j = np.triu_indices(len(centres), 1)
            return i * len(centres) + j
        centres = plain_array(centres)
        turns = _NO_TURNS if turns is None else plain_array(turns)
        # both spheres of a pair may have moved by the largest distance, towards each other
        if len(self._where) and 2.0 * farthest_moved(self._where, centres, self._turns, turns, self._arms) + reach <= (
            self.reach
        ):
            self._queries += 1
            return self._pairs
        if self._queries < _FEWEST:
            self._skin = min(1.5 * self._skin, self._largest_skin)
        elif self._queries > _MOST:
            self._skin *= 0.8
        self._queries, self.reach, self._where, self._turns = 0, reach + self._skin, centres.copy(), turns.copy()
        self.lists += 1
        self._pairs = near_balls(self._where, self._radii, self.reach)
        return self._pairs

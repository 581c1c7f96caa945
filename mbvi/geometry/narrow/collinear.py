"""Finds points on common lines along a direction.

In a planar scene, contact points on one line normal to its plane have equal rows, so that one of them is kept.
"""

from __future__ import annotations

import numpy as np

from ...compiled import kernel, plain_array

Array = np.ndarray

# a point lies on a line if its distance from it is below this part of the extent of the points
_BESIDE = 1e-9


def unique_along(points: Array, line: Array) -> Array:
    """Return the index of the first point on each line along a direction, ascending.

    Parameters
    ----------
    points : ndarray, shape (k, 3)
        The points.
    line : ndarray, shape (3,)
        The unit direction.
    """
    kept = np.empty(len(points), np.int64)
    return kept[: first_of_lines(plain_array(points), plain_array(line), kept)]


def unique_kinds_along(points: Array, kind: Array, line: Array) -> Array:
    """Return what `unique_along` keeps of the points that are not of a kind, then of those that are.

    Parameters
    ----------
    points : ndarray, shape (k, 3)
        The points.
    kind : ndarray of bool, shape (k,)
        Which of them are of the kind; these come last.
    line : ndarray, shape (3,)
        The unit direction.
    """
    both = np.flatnonzero(~kind), np.flatnonzero(kind)
    return np.concatenate([some[unique_along(points[some], line)] for some in both])


@kernel("i8(f8[:,::1], f8[::1], i8[::1])")
def first_of_lines(points: Array, line: Array, kept: Array) -> int:
    """Write the indices that `unique_along` returns into the first places of `kept`; return how many."""
    size, count = 0.0, 0
    for c in range(3):
        least, most = np.inf, -np.inf
        for k in range(len(points)):
            least, most = min(least, points[k, c]), max(most, points[k, c])
        size = max(size, most - least)
    for i in range(len(points)):
        alone = True
        for j in range(i):
            x, y, z = points[i, 0] - points[j, 0], points[i, 1] - points[j, 1], points[i, 2] - points[j, 2]
            far = x * line[0] + y * line[1] + z * line[2]
            beside = max(abs(x - far * line[0]), abs(y - far * line[1]), abs(z - far * line[2]))
            if beside <= _BESIDE * size:
                alone = False
                break
        if alone:
            kept[count] = i
            count += 1
    return count


@kernel("i8(i8[::1], f8[:,::1], f8[::1], i8[::1])")
def keep_one_of_each_line(pair: Array, point: Array, line: Array, kept: Array) -> int:
    """List the first of the contact points of each pair on each line along a direction; return how many.

    Parameters
    ----------
    pair, point : ndarray, shapes (k,) and (k, 3)
        The contacts, pair after pair.
    line : ndarray, shape (3,)
        The unit direction.
    kept : ndarray of int, shape (k,)
        Receives which contacts are kept, in its first places.
    """
    begin, total, some = 0, 0, np.empty(len(pair), np.int64)
    while begin < len(pair):
        end = begin
        while end < len(pair) and pair[end] == pair[begin]:
            end += 1
        number = first_of_lines(point[begin:end], line, some)
        for i in range(number):
            kept[total + i] = begin + some[i]
        total += number
        begin = end
    return total

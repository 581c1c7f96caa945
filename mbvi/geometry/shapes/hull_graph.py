"""Hulls as graphs: which vertices share an edge, and the outermost vertex along a direction by hill climbing.

A linear function on a convex polyhedron has no local maximum but the global one, so that climbing from neighbour to
neighbour ends at the outermost vertex. From the outermost vertex of a similar direction that takes few steps.
"""

from __future__ import annotations

import numpy as np

from ...arguments import Array
from ...compiled import kernel

# a hull of at most this number of vertices has no graph: to look at every vertex is as fast
FEW_VERTICES = 16
# cells along the edges of a cube on whose faces directions lie, and how many cells there are
_CELLS = 8
DIRECTIONS = 6 * _CELLS**2


def neighbours(triangles: Array, count: int) -> tuple[Array, Array]:
    """Return which vertices share an edge.

    Parameters
    ----------
    triangles : ndarray of int, shape (t, 3)
        The vertices of each triangle.
    count : int
        How many vertices there are.

    Returns
    -------
    first, neighbour : ndarray of int, shapes (count + 1,) and (e,)
        The neighbours of vertex k are `neighbour[first[k] : first[k + 1]]`, ascending.
    """
    a = triangles.astype(np.int64)
    b = np.roll(a, -1, axis=1)
    # edges as numbers, because to sort pairs takes ten times as long
    vertex, other = np.divmod(np.unique(np.concatenate([a * count + b, b * count + a])), count)
    return np.searchsorted(vertex, np.arange(count + 1)), other


def stack_graphs(graphs: list[tuple[Array, Array]]) -> tuple[Array, Array]:
    """Return one graph of several: their vertices are numbered one after the other."""
    first, neighbour, points, edges = [np.zeros(1, np.int64)], [np.zeros(0, np.int64)], 0, 0
    for begin, others in graphs:
        first.append(begin[1:] + edges)
        neighbour.append(others + points)
        points, edges = points + len(begin) - 1, edges + len(others)
    return np.concatenate(first), np.concatenate(neighbour)


def no_graph(count: int) -> tuple[Array, Array]:
    """Return the graph of points without neighbours, all of which `outermost` looks at."""
    return np.zeros(count + 1, np.int64), np.zeros(0, np.int64)


def guides_of(points: Array) -> Array:
    """Return the outermost of some points, shape (k, 3), along the centre of each cell of `cell_of`."""
    middle = (np.arange(_CELLS) + 0.5) * 2.0 / _CELLS - 1.0
    axis, side, u, v = (each.ravel() for each in np.meshgrid(range(3), (-1.0, 1.0), middle, middle, indexing="ij"))
    direction = np.empty((DIRECTIONS, 3))
    for offset, values in enumerate((side, u, v)):
        direction[np.arange(DIRECTIONS), (axis + offset) % 3] = values
    # one after the other: all products of a large hull would fill the memory
    return np.array([(points @ each).argmax() for each in direction])


@kernel("i8(f8, f8, f8)")
def cell_of(x: float, y: float, z: float) -> int:
    """Return the cell on the faces of a cube in which a direction lies."""
    a, b, c = abs(x), abs(y), abs(z)
    axis, along, u, v = 2, z, x, y
    if a >= b and a >= c:
        axis, along, u, v = 0, x, y, z
    elif b >= c:
        axis, along, u, v = 1, y, z, x
    most, half = abs(along), _CELLS // 2
    face, row, column = (2 * axis + (along > 0.0)) * _CELLS, 0, 0
    # comparisons, which are false where a component is NaN
    for k in range(1, _CELLS):
        bound = most * (k - half) / half
        row += u >= bound
        column += v >= bound
    return (face + row) * _CELLS + column


@kernel("i8(f8[:,::1], i8, i8, i8[::1], i8[::1], f8, f8, f8, i8)")
def outermost(
    points: Array, begin: int, end: int, first: Array, neighbour: Array, x: float, y: float, z: float, start: int
) -> int:
    """Return the index of the point of one shape that is farthest along a direction.

    Parameters
    ----------
    points : ndarray, shape (k, 3 or more)
        The points of all shapes, in the first three columns.
    begin, end : int
        The first point of the shape, and the first one behind it.
    first, neighbour : ndarray of int, shapes (k + 1,) and (e,)
        The graph; see `neighbours`; without neighbours of its first point every point of the shape is looked at.
    x, y, z : float
        The direction.
    start : int
        A point of the shape, at which the climb begins.
    """
    best = begin
    if first[begin + 1] == first[begin]:
        far = points[begin, 0] * x + points[begin, 1] * y + points[begin, 2] * z
        for k in range(begin + 1, end):
            along = points[k, 0] * x + points[k, 1] * y + points[k, 2] * z
            if along > far:
                best, far = k, along
        return best
    best = start
    far = points[best, 0] * x + points[best, 1] * y + points[best, 2] * z
    climbs = True
    while climbs:
        climbs = False
        at = best
        for i in range(first[at], first[at + 1]):
            k = neighbour[i]
            along = points[k, 0] * x + points[k, 1] * y + points[k, 2] * z
            if along > far:
                best, far, climbs = k, along, True
    return best


@kernel("i8(f8[:,::1], i8, i8, i8[::1], i8[::1], f8, f8, f8, i8, f8, i8, i8[::1], b1[::1])")
def connected(
    points: Array, begin: int, end: int, first: Array, neighbour: Array, x: float, y: float, z: float, start: int,
    least: float, most: int, found: Array, taken: Array,
) -> int:  # fmt: skip
    """List the points of one shape that reach far enough along a direction, from one of them through neighbours.

    On a hull these are connected. Without a graph every point of the shape is looked at.

    Parameters
    ----------
    points, begin, end, first, neighbour, x, y, z
        See `outermost`.
    start : int
        The point to begin at, which is listed first.
    least : float
        The least value of point . (x, y, z) [m].
    most : int
        No more neighbours are looked at once so many points are listed.
    found : ndarray of int, shape (m,)
        Receives the points; as many as there is room for.
    taken : ndarray of bool, shape (k,)
        False for every point, before and after.

    Returns
    -------
    int
        How many are listed.
    """
    found[0], count, done, graph = start, 1, 0, first[begin + 1] > first[begin]
    taken[start] = True
    while done < count < most and (graph or done == 0):
        at = found[done]
        done += 1
        low, high = (first[at], first[at + 1]) if graph else (begin, end)
        for i in range(low, high):
            k = neighbour[i] if graph else i
            if not taken[k] and points[k, 0] * x + points[k, 1] * y + points[k, 2] * z >= least and count < len(found):
                taken[k] = True
                found[count] = k
                count += 1
    for i in range(count):
        taken[found[i]] = False
    return count

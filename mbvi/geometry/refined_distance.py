"""The signed distance of two convex shapes to rounding, from an approximate normal.

The signed distance is the largest separation d(n) over unit vectors n (`normal_search`). d is smooth except at kinks
(`kinks`). An active-set method keeps n normal to the at most two directions of the active kinks, and maximises d over
the remaining directions by Newton's method. If the multipliers of all active kinks are within bounds, n is a local
maximum. Lengths are compared with each other only, so that the unit of length is arbitrary.
"""

from __future__ import annotations

import numpy as np

from ..arguments import Array
from ..compiled import kernel
from .hull_graph import outermost
from .kinks import (
    DISK,
    NEAR_KINK,
    ROUNDING,
    SEGMENT,
    add,
    clear_common,
    common_directions,
    has,
    is_disk,
    multipliers,
    next_kink,
    release,
    turn_onto,
)
from .normal_search import climb, dot, gradient, normalise, separation_along
from .separating_axis import SeparatingAxes, pair_separation, place_shape

# active sets that are tried before the search fails, and kinks that are tried for the first set
_MOST_SETS, _MOST_TRIED = 40, 8
# cosine of the angle by which the first set may turn the normal
_ABOUT = 1.0 - 1e-4
# vertices of a large hull among which a maximum is looked for, and how often others are taken
_GATHERED, _MOST_GATHERS = 40, 6
# normals are rounded to multiples of one over this, to begin the search once more
_ROUNDED = 2.0**20
# results: no maximum was found; one with unique nearest points; one without, as of parallel faces or edges
FAILED, UNIQUE, FLAT = 0, 1, 2
# stands for a distance and a normal that are Coal's own
COAL = 3


@kernel("i8(f8[:,::1], i8, i8, i8[::1], i8[::1], f8[:,::1], f8[::1], f8, i8, i8[::1])")
def _around(
    points: Array, begin: int, end: int, first: Array, neighbour: Array, place: Array, n: Array, sign: float,
    start: int, vertices: Array,
) -> int:  # fmt: skip
    """List the points about the outermost one of a shape along n, times a sign; return how many.

    These are all points of a shape without a graph, else neighbours of neighbours until there are enough.
    """
    if first[begin + 1] == first[begin]:
        for k in range(begin, end):
            vertices[k - begin] = k
        return end - begin
    x, y, z = sign * dot(place[0], n), sign * dot(place[1], n), sign * dot(place[2], n)
    vertices[0], count, done = outermost(points, begin, end, first, neighbour, x, y, z, start), 1, 0
    while done < count < _GATHERED:
        at = vertices[done]
        done += 1
        for i in range(first[at], first[at + 1]):
            k, known = neighbour[i], count == len(vertices)
            for j in range(count):
                known = known or vertices[j] == k
            if not known:
                vertices[count] = k
                count += 1
    return count


@kernel("void(f8[:,:,::1], i8, f8[::1], f8[:,::1], i8[::1], f8[:,::1], f8[:,:,::1], f8[:,::1])")
def _describe(
    world: Array, who: int, sizes: Array, points: Array, vertices: Array, edge: Array, swell: Array, turned: Array
) -> None:
    """Write the segments and half axes of one shape of two, and its points, which for the second change sign.

    Parameters
    ----------
    world, who : ndarray, shape (2, 4, 3), and int
        Where the two shapes are, and which of them it is.
    sizes : ndarray, shape (8,)
        Half edges of a box, radii of a ball and of a disk, half axes of an ellipsoid [m].
    points, vertices : ndarray, shapes (k, 3) and (p,)
        The points of all shapes, and those that are meant.
    edge, swell, turned : ndarray, shapes (6, 3), (2, 3, 3), (p, 3)
        Receive the segments and half axes in the places of the shape, and its points.
    """
    place, side = world[who], 1.0 if who == 0 else -1.0
    for c in range(3):
        for k in range(3):
            edge[3 * who + k, c] = sizes[k] * place[k, c]
            swell[who, k, c] = (sizes[5 + k] + (sizes[4] if k < 2 else 0.0)) * place[k, c]
        for k in range(len(turned)):
            p = points[vertices[k]]
            turned[k, c] = side * (p[0] * place[0, c] + p[1] * place[1, c] + p[2] * place[2, c])


@kernel("i8(f8[:,::1], f8[::1])")
def _outermost(points: Array, n: Array) -> int:
    """Return the index of the point, of shape (k, 3), that is farthest along n."""
    best = 0
    for k in range(1, len(points)):
        if dot(points[k], n) > dot(points[best], n):
            best = k
    return best


@kernel(
    "void(f8[:,::1], f8[::1], f8[::1], f8, i8[:,::1], i8, f8[::1], f8[:,::1], f8[:,::1], i8[::1], f8[:,::1], f8[::1],"
    " f8[::1])"
)
def _midpoint(
    place: Array, sizes: Array, n: Array, apart: float, kinks: Array, count: int, t: Array, found: Array, edge: Array,
    sign: Array, at: Array, vertex: Array, nearest: Array,
) -> None:  # fmt: skip
    """Write the point midway between the surfaces: the first shape's nearest point, moved half the distance along n."""
    for c in range(3):
        nearest[c] = place[3, c] + vertex[c] + at[0, c] + (sizes[3] + 0.5 * apart) * n[c]
        for k in range(3):
            if not has(kinks, count, SEGMENT, k, 0):
                nearest[c] += sign[k] * edge[k, c]
    m = 0
    for i in range(count):
        kind, who = kinks[i, 0], kinks[i, 1]
        for _ in range(2 if kind == DISK else 1):
            if who < 3 if kind == SEGMENT else who == 0:
                for c in range(3):
                    nearest[c] += t[m] * found[m, c]
            m += 1


@kernel("i8(f8[::1], i8[:,::1], f8[:,::1], i8[::1], f8[:,:,::1], f8[:,::1], f8[:,::1], i8[::1])")
def _first_set(
    n: Array, kinks: Array, edge: Array, sign: Array, swell: Array, first: Array, second: Array, base: Array
) -> int:
    """Write the kinks near n that fit together and leave it about where it is; return how many."""
    tried, kink, near, count = np.empty((_MOST_TRIED, 3), np.int64), np.empty(3, np.int64), np.empty(3), 0
    found, basis = np.empty((6, 3)), np.empty((3, 3))
    for turn in range(_MOST_TRIED):
        if not next_kink(n, NEAR_KINK, count == 0, kink, tried, turn, edge, sign, swell, first, second, base):
            break
        for c in range(3):
            tried[turn, c], kinks[count, c], near[c] = kink[c], kink[c], n[c]
        m = turn_onto(near, kinks, count + 1, edge, swell, first, second, base, found, basis)
        if m >= 0 and dot(near, n) > _ABOUT:
            count += 1
            if m == 2:
                break
    return count


@kernel("Tuple((i8, f8))(f8[:,:,::1], f8[::1], f8[::1], f8[:,::1], i8[::1], i8[::1], f8[::1], f8[::1])")
def _maximise(
    world: Array, one: Array, other: Array, points: Array, near_first: Array, near_second: Array, n: Array,
    nearest: Array,
) -> tuple[int, float]:  # fmt: skip
    """Find a local maximum of d(n) of two shapes; see `refine_pair`.

    `one` and `other` are the sizes of the two shapes, and `near_first`, `near_second` those of their points that are
    looked at.
    """
    edge, swell, used, between = np.empty((6, 3)), np.empty((2, 3, 3)), np.empty((2, 3, 3)), np.empty(3)
    first, second = np.empty((len(near_first), 3)), np.empty((len(near_second), 3))
    _describe(world, 0, one, points, near_first, edge, swell, first)
    _describe(world, 1, other, points, near_second, edge, swell, second)
    ball, base, sign = one[3] + other[3], np.empty(2, np.int64), np.empty(6, np.int64)
    base[0], base[1] = _outermost(first, n), _outermost(second, n)
    size = 0.0
    for c in range(3):
        between[c] = world[1, 3, c] - world[0, 3, c]
        size += abs(between[c])
    for k in range(6):
        sign[k] = 1 if dot(edge[k], n) >= 0.0 else -1
    given = separation_along(n, between, ball, edge, swell, first, second)
    kinks, kink, count = np.empty((3, 3), np.int64), np.empty(3, np.int64), 0
    found, basis, left = np.empty((6, 3)), np.empty((3, 3)), np.empty(2, np.bool_)
    count = _first_set(n, kinks, edge, sign, swell, first, second, base)
    start, pull, slope, at, t = np.empty(3), np.empty(3), np.empty(3), np.empty((2, 3)), np.empty(2)
    common = np.empty(3)
    for i in range(2):
        left[i], t[i] = False, 0.0
    for _ in range(_MOST_SETS):
        m = turn_onto(n, kinks, count, edge, swell, first, second, base, found, basis)
        if m < 0:
            return FAILED, 0.0
        for who in range(2):
            flattened = count > 0 and kinks[0, 0] == DISK and kinks[0, 1] == who
            for k in range(3):
                for c in range(3):
                    used[who, k, c] = 0.0 if flattened else swell[who, k, c]
        for c in range(3):
            pull[c] = between[c] - first[base[0], c] - second[base[1], c]
        for k in range(6):
            if not has(kinks, count, SEGMENT, k, 0):
                for c in range(3):
                    pull[c] -= sign[k] * edge[k, c]
        for c in range(3):
            start[c] = n[c]
        if m < 2 and not climb(n, pull, used, basis, m):
            # along the axis of a disk there is no gradient
            who = 0 if is_disk(swell[0]) and not left[0] else 1
            if left[who] or not is_disk(swell[who]):
                return FAILED, 0.0
            left[who], count = True, 1
            kinks[0, 0], kinks[0, 1], kinks[0, 2] = DISK, who, 0
            for k in range(6):
                sign[k] = 1 if dot(edge[k], n) >= 0.0 else -1
            continue
        if next_kink(n, -ROUNDING, False, kink, kinks, count, edge, sign, swell, first, second, base):
            # beyond the kink there is another slope: back to it unless that is higher
            apart = separation_along(n, between, ball, edge, swell, first, second)
            if apart < separation_along(start, between, ball, edge, swell, first, second):
                for c in range(3):
                    n[c] = start[c]
            count = add(n, slope, kink, kinks, count, between, ball, edge, sign, swell, first, second, base)
            if count < 0:
                return FAILED, 0.0
            continue
        apart = separation_along(n, between, ball, edge, swell, first, second)
        gradient(n, used, pull, at, slope)
        along = dot(slope, n)
        for c in range(3):
            slope[c] -= along * n[c]
        flat = common_directions(n, edge, swell, first, second, base, common) if m > 0 else 0
        if flat > 0:
            remain = count
            if flat == 1 and clear_common(slope, common, found, kinks, count, t):
                # n may still turn about the common direction
                remain = release(n, t, found, kinks, count, sign, base, left)
            if remain == count:
                return (FLAT if apart >= given - ROUNDING * size else FAILED), apart
            count = remain
            continue
        multipliers(slope, found, m, t)
        remain = release(n, t, found, kinks, count, sign, base, left)
        if remain < count:
            count = remain
            continue
        _midpoint(world[0], one, n, apart, kinks, count, t, found, edge, sign, at, first[base[0]], nearest)
        # written so that a NaN is refused too
        return (UNIQUE if apart >= given - ROUNDING * size else FAILED), apart
    return FAILED, 0.0


@kernel(
    "Tuple((i8, f8))(f8[:,:,::1], f8[:,::1], f8[:,::1], i8[::1], i8[::1], i8[::1], i8[:,::1], i8[:,::1], i8, f8[::1],"
    " f8[::1])"
)
def refine_pair(
    world: Array, sizes: Array, points: Array, first_point: Array, first: Array, neighbour: Array, sides: Array,
    start: Array, pair: int, n: Array, nearest: Array,
) -> tuple[int, float]:  # fmt: skip
    """Find a local maximum of d(n) of the two shapes of a pair.

    Of large hulls only some vertices about the outermost one are looked at. If none of the others reaches farther along
    the n of the maximum, it is that of the whole hulls too.

    Parameters
    ----------
    world : ndarray, shape (2, 4, 3)
        Where the two shapes are.
    sizes, points, first_point, first, neighbour
        As of `Shapes`.
    sides, start, pair : ndarray of int, shapes (n, 2), and int
        The shapes of each pair, the points at which climbs begin, and which pair is meant.
    n : ndarray, shape (3,)
        The approximate unit normal from the first shape to the second; receives that of the maximum.
    nearest : ndarray, shape (3,)
        Receives the point midway between the surfaces where it is unique [m].

    Returns
    -------
    result : int
        `UNIQUE`, `FLAT` or `FAILED`. The search has also failed if its maximum is below d of the given normal.
    distance : float
        d(n) [m].
    """
    a, b = sides[pair, 0], sides[pair, 1]
    of_first = np.empty(max(first_point[a + 1] - first_point[a], 1), np.int64)
    of_second = np.empty(max(first_point[b + 1] - first_point[b], 1), np.int64)
    rounded = np.empty(3)
    rounded[0] = np.nan
    for _ in range(_MOST_GATHERS):
        m = _around(
            points, first_point[a], first_point[a + 1], first, neighbour, world[0], n, 1.0, start[pair, 0], of_first
        )
        k = _around(
            points, first_point[b], first_point[b + 1], first, neighbour, world[1], n, -1.0, start[pair, 1], of_second
        )
        found, apart = _maximise(world, sizes[a], sizes[b], points, of_first[:m], of_second[:k], n, nearest)
        if found == FAILED:
            return FAILED, 0.0
        # the search is repeated from its result, rounded: the last digits then do not depend on where it began
        same = True
        for c in range(3):
            x = np.round(n[c] * _ROUNDED) / _ROUNDED
            same = same and x == rounded[c]
            rounded[c] = x
        if same:
            return found, apart
        for c in range(3):
            n[c] = rounded[c]
        normalise(n)
    return FAILED, 0.0


def refined(axes: SeparatingAxes, places: Array, pair: int, normal: Array) -> tuple[int, float, Array]:
    """Refine the signed distance of a pair of shapes, starting from an approximate normal.

    Parameters
    ----------
    axes : SeparatingAxes
        The shapes and pairs.
    places : ndarray, shape (b, 4, 3)
        Placements of the bodies `axes.bodies`.
    pair : int
        The pair.
    normal : ndarray, shape (3,)
        The approximate unit normal from the first to the second; receives the refined one.

    Returns
    -------
    result : int
        `UNIQUE`; `FLAT`, then the point is meaningless; `FAILED`, then distance, point and normal are.
    distance : float
        Signed distance [m].
    point : ndarray, shape (3,)
        The point midway between the surfaces [m].
    """
    nearest, shapes, world = np.empty(3), axes.shapes, np.empty((2, 4, 3))
    for side in (0, 1):
        place_shape(places, shapes.frame, shapes.fixed, int(axes.sides[pair, side]), world[side])
    result, distance = refine_pair(world, *shapes[2:7], axes.sides, axes.start, pair, normal, nearest)
    return result, distance, nearest

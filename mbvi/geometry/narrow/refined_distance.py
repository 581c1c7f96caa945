"""The signed distance of two convex shapes to rounding, from an approximate normal.

The signed distance is the largest separation d(n) over unit vectors n (`normal_search`). d is smooth except at kinks
(`kinks`). An active-set method keeps n normal to the at most two directions of the active kinks, and maximises d over
the remaining directions by Newton's method. If the multipliers of all active kinks are within bounds, n is a local
maximum. Lengths are compared with each other only, so that the unit of length is arbitrary.
"""

from __future__ import annotations

import numpy as np

from ...arguments import Array
from ...compiled import kernel
from ..broad.separating_axis import Shapes
from ..shapes.hull_graph import connected
from ..shapes.shape_table import outermost_of_shape
from ..vectors import dot, normalise
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
from .normal_search import Separation, climb, gradient, separation_along

# active sets that are tried before the search fails, and kinks that are tried for the first set
_MOST_SETS, _MOST_TRIED = 40, 8
# cosine of the angle by which the first set may turn the normal
_ABOUT = 1.0 - 1e-4
# vertices of a large hull among which a maximum is looked for
_GATHERED = 40
# searches one after the other, and normals are rounded between them to multiples of one over the second
_MOST_SEARCHES = 6
_ROUNDED = 2.0**20
# results: no maximum was found; one with unique nearest points; one without, as of parallel faces or edges
FAILED, UNIQUE, FLAT = 0, 1, 2


@kernel("f8[:,::1](f8[:,:,::1], Shapes, i8, i8, f8[::1])")
def _points_about(world: Array, shapes: Shapes, pair: int, side: int, n: Array) -> Array:
    """Return points of one shape of a pair about its origin, shape (k, 3), those of the second times -1.

    These are the points about the outermost one along n, which is the first. Of small shapes they are all.
    """
    s, sign, place = shapes.sides[pair, side], 1.0 - 2.0 * side, world[side]
    x, y, z = sign * dot(place[0], n), sign * dot(place[1], n), sign * dot(place[2], n)
    begin, end = shapes.first_point[s], shapes.first_point[s + 1]
    listed = np.empty(end - begin, np.int64)
    best = outermost_of_shape(shapes, s, x, y, z, shapes.start[pair, side])
    count = connected(
        shapes.points, begin, end, shapes.first, shapes.neighbour, x, y, z, best, -np.inf, _GATHERED, listed,
        shapes.taken,
    )  # fmt: skip
    found = np.empty((count, 3))
    for k in range(count):
        p = shapes.points[listed[k]]
        for c in range(3):
            found[k, c] = sign * (p[0] * place[0, c] + p[1] * place[1, c] + p[2] * place[2, c])
    return found


@kernel("void(Separation, f8[::1])")
def _turn_segments(d: Separation, n: Array) -> None:
    """Write the ends of segments that are nearest along n."""
    for k in range(6):
        d.sign[k] = 1 if dot(d.edge[k], n) >= 0.0 else -1


@kernel("Separation(f8[:,:,::1], Shapes, i8, f8[::1])")
def separation_of(world: Array, shapes: Shapes, pair: int, n: Array) -> Separation:
    """Return the separation of a pair of shapes at given places, shape (2, 4, 3), about a unit vector n."""
    edge, swell, between, ball = np.empty((6, 3)), np.empty((2, 3, 3)), np.empty(3), 0.0
    for who in range(2):
        place, sizes = world[who], shapes.sizes[shapes.sides[pair, who]]
        ball += sizes[3]
        for k in range(3):
            for c in range(3):
                edge[3 * who + k, c] = sizes[k] * place[k, c]
                swell[who, k, c] = (sizes[5 + k] + (sizes[4] if k < 2 else 0.0)) * place[k, c]
    for c in range(3):
        between[c] = world[1, 3, c] - world[0, 3, c]
    first, second = _points_about(world, shapes, pair, 0, n), _points_about(world, shapes, pair, 1, n)
    d = Separation(edge, swell, first, second, between, ball, np.empty(6, np.int64), np.empty(2, np.int64))
    d.base[0] = d.base[1] = 0
    _turn_segments(d, n)
    return d


@kernel("void(f8[::1], f8, f8[::1], f8, i8[:,::1], i8, f8[::1], f8[:,::1], Separation, f8[:,::1], f8[::1])")
def _midpoint(
    origin: Array, radius: float, n: Array, apart: float, kinks: Array, count: int, t: Array, found: Array,
    d: Separation, at: Array, nearest: Array,
) -> None:  # fmt: skip
    """Write the point midway between the surfaces: the first shape's nearest point, moved half the distance along n."""
    for c in range(3):
        nearest[c] = origin[c] + d.first[d.base[0], c] + at[0, c] + (radius + 0.5 * apart) * n[c]
        for k in range(3):
            if not has(kinks, count, SEGMENT, k, 0):
                nearest[c] += d.sign[k] * d.edge[k, c]
    m = 0
    for i in range(count):
        kind, who = kinks[i, 0], kinks[i, 1]
        for _ in range(2 if kind == DISK else 1):
            if who < 3 if kind == SEGMENT else who == 0:
                for c in range(3):
                    nearest[c] += t[m] * found[m, c]
            m += 1


@kernel("i8(f8[::1], i8[:,::1], Separation)")
def _first_set(n: Array, kinks: Array, d: Separation) -> int:
    """Write the kinks near n that fit together and leave it about where it is; return how many."""
    tried, kink, near, count = np.empty((_MOST_TRIED, 3), np.int64), np.empty(3, np.int64), np.empty(3), 0
    found, basis = np.empty((6, 3)), np.empty((3, 3))
    for turn in range(_MOST_TRIED):
        if not next_kink(n, NEAR_KINK, count == 0, kink, tried, turn, d):
            break
        for c in range(3):
            tried[turn, c], kinks[count, c], near[c] = kink[c], kink[c], n[c]
        m = turn_onto(near, kinks, count + 1, d, found, basis)
        if m >= 0 and dot(near, n) > _ABOUT:
            count += 1
            if m == 2:
                break
    return count


@kernel("void(Separation, i8[:,::1], i8, f8[:,:,::1], f8[::1])")
def _smooth_part(d: Separation, kinks: Array, count: int, swell: Array, pull: Array) -> None:
    """Write the half axes and the linear part of d on the active kinks, shapes (2, 3, 3) and (3,); see `climb`."""
    for who in range(2):
        flattened = count > 0 and kinks[0, 0] == DISK and kinks[0, 1] == who
        for k in range(3):
            for c in range(3):
                swell[who, k, c] = 0.0 if flattened else d.swell[who, k, c]
    for c in range(3):
        pull[c] = d.between[c] - d.first[d.base[0], c] - d.second[d.base[1], c]
    for k in range(6):
        if not has(kinks, count, SEGMENT, k, 0):
            for c in range(3):
                pull[c] -= d.sign[k] * d.edge[k, c]


@kernel("i8(Separation, i8[:,::1], b1[::1], f8[::1])")
def _onto_disk(d: Separation, kinks: Array, left: Array, n: Array) -> int:
    """Put n on the axis of a disk, where d has no gradient; return the number of active kinks, -1 without a disk."""
    who = 0 if is_disk(d.swell[0]) and not left[0] else 1
    if left[who] or not is_disk(d.swell[who]):
        return -1
    left[who] = True
    kinks[0, 0], kinks[0, 1], kinks[0, 2] = DISK, who, 0
    _turn_segments(d, n)
    return 1


@kernel("i8(f8[::1], f8[::1], f8[:,::1], i8, i8[:,::1], i8, Separation, b1[::1], f8[::1])")
def _released(
    n: Array, slope: Array, found: Array, m: int, kinks: Array, count: int, d: Separation, left: Array, t: Array
) -> int:
    """Release a kink at a maximum on the active ones, if n is no maximum of d; return how many stay active.

    -1 stands for a maximum whose nearest points are not unique. `m` is the number of vectors in `found`.
    """
    common = np.empty(3)
    flat = common_directions(n, d, common) if m > 0 else 0
    if flat == 0:
        multipliers(slope, found, m, t)
        return release(n, t, found, kinks, count, d, left)
    remain = count
    if flat == 1 and clear_common(slope, common, found, kinks, count, t):
        # n may still turn about the common direction
        remain = release(n, t, found, kinks, count, d, left)
    return remain if remain < count else -1


@kernel("Tuple((i8, f8))(f8[::1], f8, Separation, f8[::1], f8[::1])")
def _maximise(origin: Array, radius: float, d: Separation, n: Array, nearest: Array) -> tuple[int, float]:
    """Find a local maximum of d; see `refine_pair`.

    `origin`, shape (3,), and `radius` are those of the first shape and of its ball.
    """
    given, size = separation_along(n, d), abs(d.between[0]) + abs(d.between[1]) + abs(d.between[2])
    kinks, kink = np.empty((3, 3), np.int64), np.empty(3, np.int64)
    found, basis, left = np.empty((6, 3)), np.empty((3, 3)), np.empty(2, np.bool_)
    swell, pull, slope, at, t = np.empty((2, 3, 3)), np.empty(3), np.empty(3), np.empty((2, 3)), np.empty(2)
    start, count = np.empty(3), _first_set(n, kinks, d)
    for i in range(2):
        left[i], t[i] = False, 0.0
    for _ in range(_MOST_SETS):
        m = turn_onto(n, kinks, count, d, found, basis)
        if m < 0:
            break
        _smooth_part(d, kinks, count, swell, pull)
        for c in range(3):
            start[c] = n[c]
        if m < 2 and not climb(n, pull, swell, basis, m):
            count = _onto_disk(d, kinks, left, n)
            if count < 0:
                break
            continue
        if next_kink(n, -ROUNDING, False, kink, kinks, count, d):
            # beyond the kink there is another slope: back to it unless that is higher
            if separation_along(n, d) < separation_along(start, d):
                for c in range(3):
                    n[c] = start[c]
            count = add(n, slope, kink, kinks, count, d)
            if count < 0:
                break
            continue
        apart = separation_along(n, d)
        gradient(n, swell, pull, at, slope)
        along = dot(slope, n)
        for c in range(3):
            slope[c] -= along * n[c]
        remain = _released(n, slope, found, m, kinks, count, d, left, t)
        if remain < 0 or remain == count:
            if remain == count:
                _midpoint(origin, radius, n, apart, kinks, count, t, found, d, at, nearest)
            result = FLAT if remain < 0 else UNIQUE
            # written so that a NaN is refused too
            return (result if apart >= given - ROUNDING * size else FAILED), apart
        count = remain
    return FAILED, 0.0


@kernel("Tuple((i8, f8))(f8[:,:,::1], Shapes, i8, f8[::1], f8[::1])", apart=True)
def refine_pair(world: Array, shapes: Shapes, pair: int, n: Array, nearest: Array) -> tuple[int, float]:
    """Find a local maximum of d(n) of the two shapes of a pair.

    Of large hulls only some vertices about the outermost one are looked at. The search is repeated from its result,
    with the vertices about that one, until the result stays the same.

    Parameters
    ----------
    world : ndarray, shape (2, 4, 3)
        Where the two shapes are.
    shapes : Shapes
        The shapes and pairs.
    pair : int
        The pair.
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
    rounded, radius = np.empty(3), shapes.sizes[shapes.sides[pair, 0], 3]
    rounded[0] = np.nan
    for _ in range(_MOST_SEARCHES):
        d = separation_of(world, shapes, pair, n)
        found, apart = _maximise(world[0, 3], radius, d, n, nearest)
        if found == FAILED:
            break
        # rounded, so that the last digits do not depend on where the search began
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

"""A local maximum of the separation of two convex cores, by an active set of at most three points of their difference.

A core is a shape without its ball: the points of a hull, the corners of a box, the line of a capsule, a cylinder. The
separation of the cores along a unit vector n is d(n), the least w . n over the points w of D, the second core minus the
first. n is kept normal to a feature of D: a point, an edge or a face, which are one, two or three active points. Along
n none of D is below them. n turns to the maximum of d on the active points, or up to where another point becomes as
low, which becomes active; a point that the foot of the origin on the feature is beyond is released. d grows throughout.

Arguments that kernels here share are those of `core_points`.
"""

from __future__ import annotations

import numpy as np

from ...arguments import Array
from ...compiled import kernel
from ..broad.separating_axis import Shapes
from ..vectors import cross, dot, normalise
from .core_points import (
    BEYOND,
    CORNERS,
    HEIGHT,
    corners_of,
    lowest_difference,
    move_point,
    on_edge,
    on_face,
    order_corners,
)

# active sets that are tried, and turns within one
_MOST_SETS, _MOST_TURNS = 200, 40
# steps that lead near the maximum between cores that are apart, and how near it is near, as a part of the distance
_MOST_APPROACHES, _NEARLY = 20, 0.99
# searches one after the other, and directions are rounded between them to multiples of one over the second
_MOST_SEARCHES, _ROUNDED = 6, 2.0**20
# what is added to them, in the same unit: along no direction that shapes are likely to have are two points equally low
_ASIDE = np.array([0.271, 0.183, 0.119])


@kernel("b1(Shapes, i8)")
def is_curved(shapes: Shapes, pair: int) -> bool:
    """Return whether a core of a pair is a cylinder or an ellipsoid."""
    a, b, sizes = shapes.sides[pair, 0], shapes.sides[pair, 1], shapes.sizes
    return sizes[a, 4] + sizes[b, 4] + sizes[a, 5] + sizes[b, 5] > 0.0


@kernel("void(f8[::1], f8[::1], f8[::1], f8, f8[::1])")
def steepest(n: Array, foot: Array, edge: Array, along: float, to: Array) -> None:
    """Write the direction that n turns to on an edge or a point: the foot's own, or where d is 0 on the way there.

    `along` is d(n), the foot's component along n.
    """
    if along > 0.0:
        for c in range(3):
            to[c] = foot[c]
    else:
        for c in range(3):
            to[c] = foot[c] - along * n[c]
        if not dot(to, to) > 1e-28 * along * along:
            # the way to turn is arbitrary
            if dot(edge, edge) > 0.0:
                cross(n, edge, to)
            elif abs(n[0]) < 0.7:
                to[0], to[1], to[2] = 0.0, n[2], -n[1]
            else:
                to[0], to[1], to[2] = n[2], 0.0, -n[0]
    normalise(to)


@kernel("b1(f8[:,:,::1], Shapes, i8, f8[::1], f8[::1], f8[:,::1], i8)")
def turn_to(world: Array, shapes: Shapes, pair: int, n: Array, to: Array, active: Array, count: int) -> bool:
    """Turn n to a direction, or to where another point is as low as the active ones, which becomes the next of them."""
    blocked, best, size = False, 3, 0.0
    for c in range(3):
        size += abs(active[0, c])
    for _ in range(_MOST_TURNS):
        lowest_difference(world, shapes, pair, to[0], to[1], to[2], CORNERS, active, best)
        here = low = largest = 0.0
        for c in range(3):
            above = active[0, c] - active[best, c]
            here, low, largest = here + above * n[c], low + above * to[c], largest + abs(active[best, c])
        size = max(size, largest)
        known = False
        for i in range(count):
            known = known or (
                active[i, 0] == active[best, 0] and active[i, 1] == active[best, 1] and active[i, 2] == active[best, 2]
            )
        if known or not low > HEIGHT * size:
            break
        blocked = True
        move_point(active, best, count)
        if not here < 0.0:
            # by rounding it is as low already
            for c in range(3):
                to[c] = n[c]
            break
        part = here / (here - low)
        for c in range(3):
            to[c] = n[c] + part * (to[c] - n[c])
        normalise(to)
    for c in range(3):
        n[c] = to[c]
    return blocked


@kernel("void(f8[:,:,::1], Shapes, i8, f8[::1], f8[:,::1], f8, i8)")
def approach(world: Array, shapes: Shapes, pair: int, n: Array, active: Array, least: float, few: int) -> None:
    """Turn n about to the maximum if the cores are apart: between hulls of many vertices `ascend` takes short turns.

    By Gilbert's method: a point of D moves towards the origin, on the way to the lowest point along its direction.
    It ends after `few` turns where no direction so far separates the cores by more than `least` [m].
    """
    near, to = np.empty(3), np.empty(3)
    lowest_difference(world, shapes, pair, n[0], n[1], n[2], CORNERS, active, 0)
    for c in range(3):
        near[c] = active[0, c]
    best = dot(near, n)
    for turn in range(_MOST_APPROACHES):
        if turn >= few and not best > least:
            break
        for c in range(3):
            to[c] = near[c]
        far = normalise(to)
        if not far > 0.0:
            break
        lowest_difference(world, shapes, pair, to[0], to[1], to[2], CORNERS, active, 0)
        low = back = square = 0.0
        for c in range(3):
            step = active[0, c] - near[c]
            low, back, square = low + active[0, c] * to[c], back - near[c] * step, square + step * step
        if low > best:
            best = low
            for c in range(3):
                n[c] = to[c]
        if low > _NEARLY * far or not square > 0.0:
            break
        part = min(max(back / square, 0.0), 1.0)
        for c in range(3):
            near[c] += part * (active[0, c] - near[c])


@kernel("i8(f8[:,:,::1], Shapes, i8, f8[::1], f8[:,::1], f8[::1])")
def ascend(world: Array, shapes: Shapes, pair: int, n: Array, active: Array, share: Array) -> int:
    """Turn n to a local maximum of d; return the number of active points there, 0 if none was found."""
    foot, edge, to, count = np.empty(3), np.empty(3), np.empty(3), 1
    lowest_difference(world, shapes, pair, n[0], n[1], n[2], CORNERS, active, 0)
    for _ in range(_MOST_SETS):
        if count == 3:
            released = on_face(active, n, share)
            if released == -1:
                return 3
            if released >= 0:
                move_point(active, 2, released)
            count = 2
        square = on_edge(active, count, n, foot, edge)
        if not square > 0.0:
            count = 1
        along = dot(foot, n)
        steepest(n, foot, edge, along, to)
        if turn_to(world, shapes, pair, n, to, active, count):
            count += 1
        elif along > 0.0:
            share[0], share[1], share[2] = 1.0, 0.0, 0.0
            if count == 1:
                return 1
            beyond = -(active[0, 0] * edge[0] + active[0, 1] * edge[1] + active[0, 2] * edge[2]) / square
            share[0], share[1] = 1.0 - beyond, beyond
            if -BEYOND <= beyond <= 1.0 + BEYOND:
                return 2
            if beyond > 1.0:
                move_point(active, 1, 0)
            count = 1
    return 0


@kernel("void(f8[:,:,::1], Shapes, i8, f8[::1], f8[:,::1], f8[::1], i8, f8[::1])")
def write_midpoint(
    world: Array, shapes: Shapes, pair: int, n: Array, active: Array, share: Array, count: int, nearest: Array
) -> None:
    """Write the point midway between the surfaces: the first core's nearest point, moved along n."""
    a, b = shapes.sides[pair, 0], shapes.sides[pair, 1]
    # half the distance from the first surface
    ahead = 0.5 * (shapes.sizes[a, 3] - shapes.sizes[b, 3])
    for i in range(count):
        ahead += 0.5 * share[i] * (active[i, 0] * n[0] + active[i, 1] * n[1] + active[i, 2] * n[2])
    for c in range(3):
        nearest[c] = world[0, 3, c] + ahead * n[c]
        for i in range(count):
            nearest[c] += share[i] * active[i, 3 + c]


@kernel("f8(f8[:,:,::1], Shapes, i8, f8[::1], f8[:,::1], f8[::1], i8, f8[::1])")
def separation_and_midpoint(
    world: Array, shapes: Shapes, pair: int, n: Array, active: Array, share: Array, count: int, nearest: Array
) -> float:
    """Write the point midway between the surfaces, and return the separation along n, which is a maximum [m]."""
    write_midpoint(world, shapes, pair, n, active, share, count, nearest)
    # between shapes of very different sizes the normal is rounded so that another point may be lower
    lowest_difference(world, shapes, pair, n[0], n[1], n[2], CORNERS, active, 3)
    height, low = dot(active[0], n), dot(active[3], n)
    height = low if low < height - HEIGHT * np.sqrt(dot(active[0], active[0])) else height
    return height - shapes.sizes[shapes.sides[pair, 0], 3] - shapes.sizes[shapes.sides[pair, 1], 3]


@kernel("Tuple((b1, f8))(f8[:,:,::1], Shapes, i8, f8[::1], b1, f8[::1])", apart=True)
def search_cores(
    world: Array, shapes: Shapes, pair: int, n: Array, about: bool, nearest: Array
) -> tuple[bool, float]:  # fmt: skip
    """Turn n, the direction to start from, to a local maximum of the separation of two shapes.

    It is repeated from its result, which is rounded, until that stays the same: the last digits do not depend on where
    the first search began. `about` says that n is near the result. Of a core that is curved only the points as of
    `CORNERS` are looked at.

    Returns
    -------
    found : bool
        Whether n is a maximum.
    distance : float
        The separation of the shapes along n [m]. `nearest`, shape (3,), receives the point midway between them.
    """
    active, share, before, count = np.empty((4, 8)), np.empty(3), np.empty(3), 0
    before[0] = np.nan
    for turn in range(_MOST_SEARCHES):
        if turn == 0:
            # Newton's method, which comes before it for curved cores, has led as near
            if not about and not is_curved(shapes, pair):
                approach(world, shapes, pair, n, active, 0.0, 0)
        else:
            for c in range(3):
                n[c] = before[c] + _ASIDE[c]
            normalise(n)
        count = ascend(world, shapes, pair, n, active, share)
        same = True
        for c in range(3):
            x = np.round(n[c] * _ROUNDED)
            same = same and x == before[c]
            before[c] = x
        if same or count == 0:
            break
    known = count > 0 and not is_curved(shapes, pair)
    if known and not order_corners(world, shapes, pair, n, active, count, share):
        known, count = False, ascend(world, shapes, pair, n, active, share)
    if count == 0:
        lowest_difference(world, shapes, pair, n[0], n[1], n[2], CORNERS, active, 0)
        share[0] = 1.0
    for i in range(6):
        shapes.start[pair, 2 + i] = np.int64(active[i // 2, 6 + i % 2]) if known and i < 2 * count else -1
    return count > 0, separation_and_midpoint(world, shapes, pair, n, active, share, max(count, 1), nearest)


@kernel("Tuple((i8, f8))(f8[:,:,::1], Shapes, i8, f8[::1], f8[:,::1], f8[::1])")
def search_from_corners(
    world: Array, shapes: Shapes, pair: int, n: Array, active: Array, nearest: Array
) -> tuple[int, float]:
    """Do what `search_cores` does from the points of its last result; return how many there are, and the separation.

    There are none where the maximum is at others; n, which is near it, then stays as it is. `active` is room.
    """
    share, before, size = np.empty(3), n.copy(), 0.0
    count = corners_of(world, shapes, pair, n, active, share)
    if count == 0:
        return 0, 0.0
    apart = separation_and_midpoint(world, shapes, pair, n, active, share, count, nearest)
    above = 0.0
    for c in range(3):
        above += (active[0, c] - active[3, c]) * n[c]
        size = max(size, abs(active[0, c]) + abs(active[3, c]))
    if above > HEIGHT * size:
        for c in range(3):
            n[c] = before[c]
        return 0, 0.0
    return count, apart

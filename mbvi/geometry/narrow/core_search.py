"""A local maximum of the separation of two convex cores, by an active set of at most three points of their difference.

A core is a shape without its ball: the points of a hull, the corners of a box, the line of a capsule, a cylinder. The
separation of the cores along a unit vector n is d(n), the least w . n over the points w of D, the second core minus the
first. n is kept normal to a feature of D: a point, an edge or a face, which are one, two or three active points. Along
n none of D is below them. n turns to the maximum of d on the active points, or up to where another point becomes as
low, which becomes active; a point that the foot of the origin on the feature is beyond is released. d grows throughout.

Arguments that kernels here share: `world`, shape (2, 4, 3), says where the two shapes of a pair are; `active`, shape
(4, 6), holds in each row a point of D, and the point of the first core that it is from, about the origin of that shape
[m]; the fourth row is for a candidate. `share`, shape (3,), are the barycentric coordinates of the foot.
"""

from __future__ import annotations

import numpy as np

from ...arguments import Array
from ...compiled import kernel
from ..broad.separating_axis import Shapes
from ..shapes.shape_table import outermost_of_shape
from ..vectors import cross, dot, normalise

# active sets that are tried, and turns within one
_MOST_SETS, _MOST_TURNS = 200, 40
# steps that lead near the maximum between cores that are apart, and how near it is near, as a part of the distance
_MOST_APPROACHES, _NEARLY = 20, 0.99
# rounding of heights relative to the largest point of D, of barycentric coordinates, and of areas squared
_ROUNDING, _BEYOND, _ON_A_LINE = 4e-15, 1e-12, 1e-24
# corners of the polygons that stand for circles
CORNERS = 256
# searches one after the other, and directions are rounded between them to multiples of one over the second
_MOST_SEARCHES, _ROUNDED = 6, 2.0**20
# what is added to them, in the same unit: along no direction that shapes are likely to have are two points equally low
_ASIDE = np.array([0.271, 0.183, 0.119])


@kernel("b1(Shapes, i8)")
def is_curved(shapes: Shapes, pair: int) -> bool:
    """Return whether a core of a pair is a cylinder or an ellipsoid."""
    a, b, sizes = shapes.sides[pair, 0], shapes.sides[pair, 1], shapes.sizes
    return sizes[a, 4] + sizes[b, 4] + sizes[a, 5] + sizes[b, 5] > 0.0


@kernel("UniTuple(f8, 2)(f8, f8, i8)")
def on_circle(x: float, y: float, corners: int) -> tuple[float, float]:
    """Return the point of the unit circle, or of a regular polygon in it, that is farthest along a direction."""
    length = np.sqrt(x * x + y * y)
    if corners == 0:
        return (x / length, y / length) if length > 0.0 else (1.0, 0.0)
    step = 2.0 * np.pi / corners
    angle = step * np.round(np.arctan2(y, x) / step)
    return np.cos(angle), np.sin(angle)


@kernel("void(f8[:,:,::1], Shapes, i8, f8, f8, f8, i8, f8[:,::1], i8)")
def lowest_difference(
    world: Array, shapes: Shapes, pair: int, x: float, y: float, z: float, corners: int, active: Array, row: int
) -> None:
    """Write the point of D that is lowest along a direction into a row; the climbs begin at `start`; see `reach`.

    If `corners` is not 0, polygons inside the circles of a cylinder or ellipsoid stand for these.
    """
    sizes, points, start = shapes.sizes, shapes.points, shapes.start
    for c in range(3):
        active[row, c] = world[1, 3, c] - world[0, 3, c]
        active[row, 3 + c] = 0.0
    for side in range(2):
        s, sign = shapes.sides[pair, side], 1.0 - 2.0 * side
        u = sign * (world[side, 0, 0] * x + world[side, 0, 1] * y + world[side, 0, 2] * z)
        v = sign * (world[side, 1, 0] * x + world[side, 1, 1] * y + world[side, 1, 2] * z)
        w = sign * (world[side, 2, 0] * x + world[side, 2, 1] * y + world[side, 2, 2] * z)
        begin, end = shapes.first_point[s], shapes.first_point[s + 1]
        if end - begin > 1:
            k = outermost_of_shape(shapes, s, u, v, w, start[pair, side])
            start[pair, side] = k
            a, b, d = points[k, 0], points[k, 1], points[k, 2]
        else:
            a, b = sizes[s, 0] if u >= 0.0 else -sizes[s, 0], sizes[s, 1] if v >= 0.0 else -sizes[s, 1]
            d = sizes[s, 2] if w >= 0.0 else -sizes[s, 2]
            if sizes[s, 4] > 0.0:
                a, b = on_circle(u, v, corners)
                a, b = sizes[s, 4] * a, sizes[s, 4] * b
            if sizes[s, 5] > 0.0:
                # the ball that is stretched to the ellipsoid; its parallels have their radii
                u, v, w = sizes[s, 5] * u, sizes[s, 6] * v, sizes[s, 7] * w
                a, b = on_circle(u, v, corners)
                across, up = on_circle(a * u + b * v, w, corners)
                a, b, d = sizes[s, 5] * across * a, sizes[s, 6] * across * b, sizes[s, 7] * up
        for c in range(3):
            at = a * world[side, 0, c] + b * world[side, 1, c] + d * world[side, 2, c]
            active[row, c] -= sign * at
            if side == 0:
                active[row, 3 + c] = at


@kernel("void(f8[:,::1], i8, i8)")
def move_point(active: Array, here: int, there: int) -> None:
    """Copy one row of `active` to another."""
    for c in range(6):
        active[there, c] = active[here, c]


@kernel("i8(f8[:,::1], f8[::1], f8[::1])")
def on_face(active: Array, n: Array, share: Array) -> int:
    """Turn n normal to the plane of three points; return which is to be released, -1 if none, -2 if they are on a line.

    Of three points on a line the middle one is dropped.
    """
    one, two, m = np.empty(3), np.empty(3), np.empty(3)
    for c in range(3):
        one[c], two[c] = active[1, c] - active[0, c], active[2, c] - active[0, c]
    cross(one, two, m)
    area, aa, ab, bb = dot(m, m), dot(one, one), dot(one, two), dot(two, two)
    # written so that a NaN is refused too
    if not area > _ON_A_LINE * aa * bb:
        if ab < 0.0:
            move_point(active, 2, 0)
        elif bb > aa:
            move_point(active, 2, 1)
        return -2
    length = np.sqrt(area) if dot(m, n) >= 0.0 else -np.sqrt(area)
    for c in range(3):
        n[c] = m[c] / length
    # foot of the origin, from the first point
    height = active[0, 0] * n[0] + active[0, 1] * n[1] + active[0, 2] * n[2]
    for c in range(3):
        m[c] = height * n[c] - active[0, c]
    along, across = dot(m, one), dot(m, two)
    share[1], share[2] = (along * bb - across * ab) / area, (across * aa - along * ab) / area
    share[0] = 1.0 - share[1] - share[2]
    least = 0
    for j in range(1, 3):
        if share[j] < share[least]:
            least = j
    return least if share[least] < -_BEYOND else -1


@kernel("f8(f8[:,::1], i8, f8[::1], f8[::1], f8[::1])")
def on_edge(active: Array, count: int, n: Array, foot: Array, edge: Array) -> float:
    """Turn n normal to the edge of two active points; write the foot of the origin on its line, and the edge.

    Of one active point the foot is that point. Returns the edge's length squared.
    """
    square = 0.0
    for c in range(3):
        foot[c] = active[0, c]
        edge[c] = active[1, c] - active[0, c] if count == 2 else 0.0
        square += edge[c] * edge[c]
    if square > 0.0:
        # twice, since what is left may be small
        for _ in range(2):
            turn, along = dot(n, edge) / square, dot(foot, edge) / square
            for c in range(3):
                n[c] -= turn * edge[c]
                foot[c] -= along * edge[c]
        normalise(n)
    return square


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
        if known or not low > _ROUNDING * size:
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
            if -_BEYOND <= beyond <= 1.0 + _BEYOND:
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
    active, share, before, count = np.empty((4, 6)), np.empty(3), np.empty(3), 0
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
    if count == 0:
        lowest_difference(world, shapes, pair, n[0], n[1], n[2], CORNERS, active, 0)
        share[0] = 1.0
    write_midpoint(world, shapes, pair, n, active, share, max(count, 1), nearest)
    # between shapes of very different sizes the normal is rounded so that another point may be lower
    lowest_difference(world, shapes, pair, n[0], n[1], n[2], CORNERS, active, 3)
    height, low = dot(active[0], n), dot(active[3], n)
    height = low if low < height - _ROUNDING * np.sqrt(dot(active[0], active[0])) else height
    return count > 0, height - shapes.sizes[shapes.sides[pair, 0], 3] - shapes.sizes[shapes.sides[pair, 1], 3]

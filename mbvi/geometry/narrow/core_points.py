"""Points of the difference of two convex cores, and the maximum of the separation on one to three of them.

Arguments that kernels here share: `world`, shape (2, 4, 3), says where the two shapes of a pair are; `active`, shape
(4, 8), holds in each row a point of D, see `core_search`, the point of the first core that it is from, about the origin
of that shape [m], and the numbers of the corners of both cores; the fourth row is for a candidate. `share`, shape (3,),
are the barycentric coordinates of the foot of the origin. Corners of a box have the numbers 0 to 7, bit by bit.
"""

from __future__ import annotations

import numpy as np

from ...arguments import Array
from ...compiled import kernel
from ..broad.separating_axis import Shapes
from ..shapes.shape_table import outermost_of_shape
from ..vectors import cross, dot, normalise

# rounding of heights relative to the largest point of D, of barycentric coordinates, and of areas squared
HEIGHT, BEYOND, _ON_A_LINE = 4e-15, 1e-12, 1e-24
# corners of the polygons that stand for circles
CORNERS = 256


@kernel("UniTuple(f8, 2)(f8, f8, i8)")
def on_circle(x: float, y: float, corners: int) -> tuple[float, float]:
    """Return the point of the unit circle, or of a regular polygon in it, that is farthest along a direction."""
    length = np.sqrt(x * x + y * y)
    if corners == 0:
        return (x / length, y / length) if length > 0.0 else (1.0, 0.0)
    step = 2.0 * np.pi / corners
    angle = step * np.round(np.arctan2(y, x) / step)
    return np.cos(angle), np.sin(angle)


@kernel("void(f8[:,:,::1], i8, i8, f8, f8, f8, f8[:,::1], i8)")
def take_corner(world: Array, side: int, k: int, a: float, b: float, d: float, active: Array, row: int) -> None:
    """Take corner k of a core, at (a, b, d) in its frame, to a row that has the difference of the origins."""
    sign = 1.0 - 2.0 * side
    active[row, 6 + side] = k
    for c in range(3):
        at = a * world[side, 0, c] + b * world[side, 1, c] + d * world[side, 2, c]
        active[row, c] -= sign * at
        if side == 0:
            active[row, 3 + c] = at


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
            k = (a > 0.0) + 2 * (b > 0.0) + 4 * (d > 0.0)
            if sizes[s, 4] > 0.0:
                a, b = on_circle(u, v, corners)
                a, b = sizes[s, 4] * a, sizes[s, 4] * b
            if sizes[s, 5] > 0.0:
                # the ball that is stretched to the ellipsoid; its parallels have their radii
                u, v, w = sizes[s, 5] * u, sizes[s, 6] * v, sizes[s, 7] * w
                a, b = on_circle(u, v, corners)
                across, up = on_circle(a * u + b * v, w, corners)
                a, b, d = sizes[s, 5] * across * a, sizes[s, 6] * across * b, sizes[s, 7] * up
        take_corner(world, side, k, a, b, d, active, row)


@kernel("void(f8[:,::1], i8, i8)")
def move_point(active: Array, here: int, there: int) -> None:
    """Copy one row of `active` to another."""
    for c in range(8):
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
    return least if share[least] < -BEYOND else -1


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


@kernel("void(f8[:,:,::1], Shapes, i8, i8, i8, f8[:,::1], i8)")
def difference_of(world: Array, shapes: Shapes, pair: int, first: int, second: int, active: Array, row: int) -> None:
    """Write the difference of two corners, which have these numbers, into a row."""
    for c in range(3):
        active[row, c] = world[1, 3, c] - world[0, 3, c]
    for side in range(2):
        s, k = shapes.sides[pair, side], first if side == 0 else second
        if shapes.first_point[s + 1] - shapes.first_point[s] > 1:
            a, b, d = shapes.points[k, 0], shapes.points[k, 1], shapes.points[k, 2]
        else:
            a = shapes.sizes[s, 0] if k & 1 else -shapes.sizes[s, 0]
            b = shapes.sizes[s, 1] if k & 2 else -shapes.sizes[s, 1]
            d = shapes.sizes[s, 2] if k & 4 else -shapes.sizes[s, 2]
        take_corner(world, side, k, a, b, d, active, row)


@kernel("b1(f8[:,::1])")
def are_edges(active: Array) -> bool:
    """Return whether three points of D, in the order of their numbers, are from two corners of each core."""
    return active[0, 6] == active[1, 6] != active[2, 6] and active[0, 7] == active[2, 7] != active[1, 7]


@kernel("b1(f8[:,::1], i8, f8[::1], f8[::1])")
def on_foot(active: Array, count: int, n: Array, share: Array) -> bool:
    """Turn n to the foot of the origin on one or two points; return whether it is between them, and cores are apart."""
    foot, edge, across = np.empty(3), np.empty(3), n.copy()
    square = on_edge(active, count, across, foot, edge)
    if not dot(foot, n) > 0.0 or (count == 2 and not square > 0.0):
        return False
    beyond = 0.0
    if count == 2:
        beyond = -(active[0, 0] * edge[0] + active[0, 1] * edge[1] + active[0, 2] * edge[2]) / square
    share[0], share[1], share[2] = 1.0 - beyond, beyond, 0.0
    for c in range(3):
        n[c] = foot[c]
    normalise(n)
    return -BEYOND <= beyond <= 1.0 + BEYOND


@kernel("b1(f8[:,:,::1], Shapes, i8, f8[::1], f8[:,::1], i8, f8[::1])")
def order_corners(
    world: Array, shapes: Shapes, pair: int, n: Array, active: Array, count: int, share: Array
) -> bool:  # fmt: skip
    """Order the active points of a maximum by their numbers, and turn n normal to them; return False if it cannot be.

    Of two edges that cross D has four such points, of which the first three are taken: so the last digits do not depend
    on how the points were found.
    """
    for i in range(1, count):
        for j in range(i, 0, -1):
            one, other = active[j - 1], active[j]
            if one[6] > other[6] or (one[6] == other[6] and one[7] > other[7]):
                move_point(active, j, 3)
                move_point(active, j - 1, j)
                move_point(active, 3, j - 1)
    if count < 3:
        return on_foot(active, count, n, share)
    a, b, c, d = active[0, 6], active[2, 6], active[0, 7], active[0, 7]
    two = active[1, 6] == a or active[1, 6] == b
    for i in range(3):
        c, d = min(c, active[i, 7]), max(d, active[i, 7])
    for i in range(3):
        two = two and (active[i, 7] == c or active[i, 7] == d)
    if two and a < b and c < d:
        difference_of(world, shapes, pair, int(a), int(c), active, 0)
        difference_of(world, shapes, pair, int(a), int(d), active, 1)
        difference_of(world, shapes, pair, int(b), int(c), active, 2)
    return on_face(active, n, share) != -2


@kernel("i8(f8[:,:,::1], Shapes, i8, f8[::1], f8[:,::1], f8[::1])")
def corners_of(world: Array, shapes: Shapes, pair: int, n: Array, active: Array, share: Array) -> int:
    """Take the points of the last result, and turn n normal to them; return how many there are.

    There are none, and n stays as it is, where the foot is not between them.
    """
    last, before, count = shapes.start[pair], n.copy(), 0
    while count < 3 and last[2 + 2 * count] >= 0:
        difference_of(world, shapes, pair, last[2 + 2 * count], last[3 + 2 * count], active, count)
        count += 1
    inside = False
    if count == 3:
        released = on_face(active, n, share)
        inside = released == -1
        if released != -2 and are_edges(active):
            # a parallelogram
            inside = -BEYOND <= min(share[1], share[2]) and max(share[1], share[2]) <= 1.0 + BEYOND
    elif count > 0:
        inside = on_foot(active, count, n, share)
    if not inside:
        for c in range(3):
            n[c] = before[c]
        return 0
    return count

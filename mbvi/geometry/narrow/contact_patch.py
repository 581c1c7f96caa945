"""Where two convex shapes touch: the corners of the region that their nearest faces or edges share, and their gaps.

Of both shapes the points within a depth below the nearest one are gathered, and projected along the contact normal. The
corners of the common part of the two polygons become contact points. Each has its own gap, the distance of the two
surfaces along the normal.
"""

from __future__ import annotations

import numpy as np

from ...arguments import Array
from ...compiled import kernel
from ..broad.separating_axis import Shapes
from ..closed_form.convex_polygon import common_polygon, convex_hull
from ..shapes.features import least_line, leave, lines_out, near_corners, near_vertices
from ..vectors import dot, within_plane
from .spread import BESIDE, FEW_POINTS, FLAT, few_corners, one_face, spread_out

# points gathered of one shape at most; a flat face has no more corners, because Coal's hulls have no more neighbours of
# a vertex, and Qhull divides a face into triangles with one vertex in common
MOST_GATHERED = 208
# how far below the nearest point others are gathered, beyond the tolerance, relative to the radius of the smaller shape
DEPTH = 1e-3
# corners nearer to each other than this part of the radius are one
_SAME_CORNER = 1e-7


@kernel("Tuple((i8, i8))(f8[:,:,::1], Shapes, i8, i8, f8[:,::1], f8, f8, f8[:,::1], i8[::1], f8[:,::1])")
def _outline(
    world: Array, shapes: Shapes, pair: int, side: int, frame: Array, depth: float, bound: float, found: Array,
    vertices: Array, corners: Array,
) -> tuple[int, int]:  # fmt: skip
    """Write the convex polygon of the points of a shape that are nearest to another, seen along the normal.

    Parameters
    ----------
    world, shapes, pair, side
        The shape, which is one side of a pair.
    frame : ndarray, shape (3, 3)
        The outward normal, and the two directions of the polygon's plane.
    depth, bound : float
        How far below the outermost point others are gathered, and a bounding radius [m].
    found, vertices : ndarray, shapes (g, 3) and (g,)
        Receive these points, the outermost one first if it is a hull, and the numbers of its vertices.
    corners : ndarray, shape (2 g, 2)
        Receives the corners.

    Returns
    -------
    corners : int
        How many corners there are.
    vertices : int
        How many vertices; 0 if the shape is no hull.
    """
    flat, s, hull = np.empty((len(found), 2)), shapes.sides[pair, side], 0
    if shapes.first_point[s + 1] - shapes.first_point[s] > 1:
        count = hull = near_vertices(world[side], shapes, pair, side, frame[0], depth, found, vertices)
    else:
        count = near_corners(world[side], shapes.sizes[s], frame[0], depth, found)
    for i in range(count):
        flat[i, 0], flat[i, 1] = dot(found[i], frame[1]), dot(found[i], frame[2])
    return convex_hull(flat, count, bound, corners), hull


@kernel("i8(f8[:,::1], f8[::1], f8[:,::1], i8, f8, f8)")
def _few(common: Array, gap: Array, point: Array, count: int, tolerance: float, bound: float) -> int:
    """Keep few of many corners of a region: of those within the tolerance that two flat faces share `few_corners`.

    Of others those that `spread_out` chooses.
    """
    if count <= FEW_POINTS:
        return count
    chosen, near = np.empty(count + 1, np.int64), 0
    for turn in range(2):
        if turn == 0:
            for i in range(count):
                if gap[i] <= tolerance:
                    chosen[near] = i
                    near += 1
        elif near > FEW_POINTS:
            if one_face(common[:near], gap[:near], bound):
                low = max(gap[:near].min(), 0.0) + FLAT * bound
                near = few_corners(common[:near], gap[:near], low, chosen)
            else:
                near = spread_out(common[:near], gap[:near], BESIDE * bound, chosen)
        for i in range(near):
            k = chosen[i]
            gap[i], common[i, 0], common[i, 1] = gap[k], common[k, 0], common[k, 1]
            for c in range(3):
                point[i, c] = point[k, c]
        if near <= FEW_POINTS:
            break
    return near if near > 0 else count


@kernel("i8(f8[:,:,::1], Shapes, i8, f8, f8, f8, f8[::1], f8[::1], f8[:,::1])")
def shared_region(
    world: Array, shapes: Shapes, pair: int, distance: float, depth: float, bound: float, n: Array, gap: Array,
    point: Array,
) -> int:  # fmt: skip
    """Write the corners of the region that the shapes of a pair share along n, and their gaps; return how many.

    Parameters
    ----------
    world : ndarray, shape (2, 4, 3)
        Where the two shapes are.
    distance, depth, bound : float
        Signed distance along n, how far below the nearest points others are gathered, and the bounding radius of the
        smaller shape [m].
    n : ndarray, shape (3,)
        The normal from the first shape to the second.
    gap, point : ndarray, shapes (2 g,) and (2 g, 3) with g = 2 `MOST_GATHERED`
        Receive gaps, and points midway between the surfaces; `point[0]` also where the shapes share no region.
    """
    frame, middle, outward = np.empty((3, 3)), np.empty(3), -n
    within_plane(n, frame[1], frame[2])
    found, vertices = np.empty((2, MOST_GATHERED, 3)), np.empty((2, MOST_GATHERED), np.int64)
    hulls, corners, number = np.empty((2, 2 * MOST_GATHERED, 2)), np.empty(2, np.int64), np.empty(2, np.int64)
    for side in range(2):
        for c in range(3):
            frame[0, c] = n[c] if side == 0 else -n[c]
        corners[side], number[side] = _outline(
            world, shapes, pair, side, frame, depth, bound, found[side], vertices[side], hulls[side]
        )
    # midway between the surfaces
    height = dot(found[0, 0], n) + 0.5 * distance
    for c in range(3):
        point[0, c] = found[0, 0, c] + 0.5 * distance * n[c]
    common, scratch = np.empty((len(gap), 2)), np.empty((len(gap), 2))
    count = common_polygon(hulls[0], corners[0], hulls[1], corners[1], bound, common, scratch)
    kept, a, b = 0, shapes.sides[pair, 0], shapes.sides[pair, 1]
    # frame[0] is the normal outward from the second
    down_lines = lines_out(world[1], shapes, b, vertices[1], number[1], frame, -height)
    for c in range(3):
        frame[0, c] = n[c]
    up_lines = lines_out(world[0], shapes, a, vertices[0], number[0], frame, height)
    for i in range(count):
        same = False
        for j in range(kept):
            same = same or abs(common[j, 0] - common[i, 0]) + abs(common[j, 1] - common[i, 1]) < _SAME_CORNER * bound
        if same:
            continue
        common[kept, 0], common[kept, 1] = common[i, 0], common[i, 1]
        for c in range(3):
            middle[c] = common[i, 0] * frame[1, c] + common[i, 1] * frame[2, c] + height * n[c]
        x, y = common[i, 0], common[i, 1]
        up = least_line(up_lines, x, y) if number[0] else leave(world[0], shapes, a, middle, n)
        down = least_line(down_lines, x, y) if number[1] else leave(world[1], shapes, b, middle, outward)
        gap[kept] = -(up + down)
        for c in range(3):
            point[kept, c] = middle[c] + 0.5 * (up - down) * n[c]
        kept += 1
    return _few(common, gap, point, kept, distance + depth - DEPTH * bound, bound)


@kernel("void(f8[::1], f8[:,::1], i8, f8, f8[::1])")
def mean_of_shared(gap: Array, point: Array, count: int, tolerance: float, middle: Array) -> None:
    """Write the mean of the points whose gap is within a tolerance; of none the first point."""
    share = 0.0
    for j in range(max(count, 1)):
        if count == 0 or gap[j] <= tolerance:
            share += 1.0
            for c in range(3):
                before = middle[c] if share > 1.0 else 0.0
                middle[c] = before + (point[j, c] - before) / share

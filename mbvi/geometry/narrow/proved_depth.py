"""Proofs that no direction separates two overlapping cores better than a given one, which gives the penetration depth.

The difference D of two convex sets holds the origin where they overlap. The penetration depth d is the least value of
its support function h over unit vectors. Let h(n) = d be a local minimum, so that a face of D has the normal n and the
offset d, and holds a disc of a radius r about d n.

- Along n' at an angle f to n, h(n') >= d cos f + r sin f. This is at least d if r >= d tan(f / 2).
- D holds the difference of two balls, one inside each core: a ball of a radius s about c. Hence h(n') >= c n' + s, and
  h(n') <= d only at angles to -c of at most arccos((s - d) / |c|).

If the first holds at the largest angle that the second leaves, then no direction has a smaller h. Otherwise the
directions are divided into triangles (`better_direction`). D holds the points p in which it reaches farthest along the
corners n_j of a triangle, and their mixtures. Hence h >= min over j of p . n_j within the triangle if that is positive.
A triangle is done with where this bound is at least d, or where the first argument holds; others are halved.

A core is a shape without its ball (`core_search`), which adds the same to h everywhere.
"""

from __future__ import annotations

import numpy as np

from ...arguments import Array
from ...compiled import kernel
from ..broad.separating_axis import Shapes, between_centres
from ..shapes.features import near_corners, near_vertices
from ..vectors import cross, dot, normalise, within_plane
from .core_points import lowest_difference

# points of the face of each core that are looked at, and how far below the outermost they may be, relative to the
# radius of the smaller shape
MOST_POINTS, _LEVEL = 8, 1e-9
# angles are taken too large by this part, radii too small
_MARGIN = 1e-3
# sines of angles between directions that are the same
_PARALLEL = 1e-9
# triangles that wait: each halving adds one, and after some eighty halvings a triangle is as small as rounding
_MOST_WAITING = 256
# triangles that are looked at: where more are needed a depth is not proved, and may not be the least
_MOST_TRIANGLES = 20_000
# part of the points' distance from the origin that counts beside heights
_SAME_HEIGHT = 1e-3
# rounding of h relative to its largest value
_ROUNDING = 1e-14


@kernel("f8(f8[:,:,::1], Shapes, i8, f8[::1], f8)")
def widest_angle(world: Array, shapes: Shapes, pair: int, n: Array, depth: float) -> float:
    """Return the largest angle to n of directions whose separation may be above -depth [rad]; pi if all may.

    world, shapes, pair, n and depth are those of `better_direction`.
    """
    between = np.empty(3)
    radius = between_centres(world, shapes, pair, between) - depth
    far = np.sqrt(dot(between, between))
    if radius > far:
        return 0.0
    if radius <= -far or far == 0.0:
        return np.pi
    towards = min(max(dot(between, n) / far, -1.0), 1.0)
    return min((np.arccos(towards) + np.arccos(radius / far)) * (1.0 + _MARGIN), np.pi)


@kernel("f8(f8[:,::1], f8[:,::1], i8, i8)")
def disc_radius(first: Array, second: Array, k: int, m: int) -> float:
    """Return the radius of the largest disc about the origin in the differences of two plane polygons.

    0 or less where the origin is outside. `first` and `second`, shapes (k, 2) and (m, 2), are points whose hulls the
    polygons are. Only normals of edges matter, and each is normal to two points of one polygon.
    """
    least, found = np.inf, False
    for which in range(2):
        points, count = (first, k) if which == 0 else (second, m)
        for i in range(count):
            for j in range(i):
                x, y = points[j, 1] - points[i, 1], points[i, 0] - points[j, 0]
                length = np.sqrt(x * x + y * y)
                if length == 0.0:
                    continue
                found = True
                for _ in range(2):
                    x, y = -x, -y
                    high, low = -np.inf, np.inf
                    for a in range(k):
                        high = max(high, x * first[a, 0] + y * first[a, 1])
                    for b in range(m):
                        low = min(low, x * second[b, 0] + y * second[b, 1])
                    least = min(least, (high - low) / length)
    return least if found else 0.0


@kernel("void(f8[:,:,::1], Shapes, i8, f8[::1], f8, f8[:,:,::1], i8[::1])")
def level_points(world: Array, shapes: Shapes, pair: int, n: Array, bound: float, flat: Array, count: Array) -> None:
    """Write the points of both shapes that are nearest to the other along n, as seen along n, and how many of each.

    `flat` and `count` have shapes (2, `MOST_POINTS`, 2) and (2,); `bound` is the radius of the smaller shape [m].
    """
    across, outward = np.empty((2, 3)), np.empty(3)
    within_plane(n, across[0], across[1])
    found, vertices = np.empty((MOST_POINTS, 3)), np.empty(MOST_POINTS, np.int64)
    for side in range(2):
        s = shapes.sides[pair, side]
        for c in range(3):
            outward[c] = n[c] if side == 0 else -n[c]
        if shapes.first_point[s + 1] - shapes.first_point[s] > 1:
            count[side] = near_vertices(world[side], shapes, pair, side, outward, _LEVEL * bound, found, vertices)
        else:
            count[side] = near_corners(world[side], shapes.sizes[s], outward, _LEVEL * bound, found)
        for i in range(count[side]):
            for c in range(2):
                flat[side, i, c] = dot(found[i], across[c])


@kernel("b1(f8[:,:,::1], i8[::1])")
def share_a_line(flat: Array, count: Array) -> bool:
    """Return whether two sets of points of a plane, as of `level_points`, span a direction that is the same."""
    longest, wide = np.zeros((2, 2)), np.zeros(2, np.bool_)
    for side in range(2):
        square = 0.0
        for turn in range(2):
            for i in range(1, count[side]):
                x, y = flat[side, i, 0] - flat[side, 0, 0], flat[side, i, 1] - flat[side, 0, 1]
                if turn == 0 and x * x + y * y > square:
                    square, longest[side, 0], longest[side, 1] = x * x + y * y, x, y
                if turn == 1 and abs(x * longest[side, 1] - y * longest[side, 0]) > _PARALLEL * square:
                    wide[side] = True
        if square == 0.0:
            return False
        for c in range(2):
            longest[side, c] /= np.sqrt(square)
    aslant = abs(longest[0, 0] * longest[1, 1] - longest[0, 1] * longest[1, 0])
    return wide[0] or wide[1] or aslant <= _PARALLEL


@kernel("f8(f8[:,:,::1])")
def least_within(triangle: Array) -> float:
    """Return a lower bound of h within a triangle of directions: the largest min of p . n_j over mixtures p.

    That is the value of a game of two players.

    Parameters
    ----------
    triangle : ndarray, shape (2, 3, 3)
        Its corners n_j, unit vectors, and for each a point of D.
    """
    height, best = np.empty((3, 3)), -np.inf
    for i in range(3):
        for j in range(3):
            height[i, j] = dot(triangle[1, i], triangle[0, j])
    one, two, mixture = np.empty(3), np.empty(3), np.empty(3)
    for i in range(3):
        one[i], two[i] = height[i, 0] - height[i, 1], height[i, 0] - height[i, 2]
        best = max(best, min(height[i, 0], height[i, 1], height[i, 2]))
    # the mixture that is as high along all corners
    cross(one, two, mixture)
    whole = mixture[0] + mixture[1] + mixture[2]
    if min(mixture[0] * whole, mixture[1] * whole, mixture[2] * whole) > 0.0:
        for i in range(3):
            one[i] = (mixture[0] * height[0, i] + mixture[1] * height[1, i] + mixture[2] * height[2, i]) / whole
        best = max(best, min(one[0], one[1], one[2]))
    # mixtures of two points that are as high along two corners
    for a in range(3):
        for j in range(3):
            b, k = (a + 1) % 3, (j + 1) % 3
            slope = height[b, j] - height[a, j] - height[b, k] + height[a, k]
            part = (height[a, k] - height[a, j]) / slope if slope != 0.0 else -1.0
            if 0.0 < part < 1.0:
                for i in range(3):
                    one[i] = height[a, i] + part * (height[b, i] - height[a, i])
                best = max(best, min(one[0], one[1], one[2]))
    if best >= 0.0:
        return best
    # between the corners n is longer than their mixture: as much as the plane of the corners is nearer than 1
    for c in range(3):
        one[c], two[c] = triangle[0, 1, c] - triangle[0, 0, c], triangle[0, 2, c] - triangle[0, 0, c]
    cross(one, two, mixture)
    return best * np.sqrt(dot(mixture, mixture)) / abs(dot(mixture, triangle[0, 0]))


@kernel("f8(f8[::1])")
def one_norm(n: Array) -> float:
    """Return |x| + |y| + |z| of a vector."""
    return abs(n[0]) + abs(n[1]) + abs(n[2])


@kernel("i8(f8[:,:,::1])")
def longest_side(triangle: Array) -> int:
    """Return the corner of a triangle, as of `least_within`, opposite to the side along which heights differ most.

    The triangle is seen on the face of the octahedron |x| + |y| + |z| = 1, where sides are straight.
    """
    chosen, most, side = 0, -1.0, np.empty(3)
    for j in range(3):
        a, b, differ, largest = (j + 1) % 3, (j + 2) % 3, 0.0, 0.0
        for c in range(3):
            side[c] = triangle[0, a, c] / one_norm(triangle[0, a]) - triangle[0, b, c] / one_norm(triangle[0, b])
        for i in range(3):
            differ = max(differ, abs(dot(triangle[1, i], side)))
            largest = max(largest, dot(triangle[1, i], triangle[1, i]))
        # no side stays long because heights are the same along it
        differ += _SAME_HEIGHT * np.sqrt(largest * dot(side, side))
        if differ > most:
            chosen, most = j, differ
    return chosen


@kernel("f8(f8[:,:,::1], Shapes, i8, f8[:,:,::1], i8, f8[:,::1])")
def farthest_point(world: Array, shapes: Shapes, pair: int, triangle: Array, corner: int, room: Array) -> float:
    """Write the point in which D reaches farthest along a corner; return h there. `room` has shape (1, 8)."""
    n = triangle[0, corner]
    lowest_difference(world, shapes, pair, n[0], n[1], n[2], 0, room, 0)
    for c in range(3):
        triangle[1, corner, c] = -room[0, c]
    return dot(triangle[1, corner], n)


@kernel("b1(f8[:,:,::1], Shapes, i8, f8[::1], f8, f8, f8)", apart=True)
def better_direction(
    world: Array, shapes: Shapes, pair: int, n: Array, depth: float, sure: float, tolerance: float
) -> bool:
    """Look for a direction that separates two cores better; return False if there is none (proved in most cases).

    Parameters
    ----------
    world : ndarray, shape (2, 4, 3)
        Where the two shapes are.
    shapes, pair
        The shapes and the pair.
    n : ndarray, shape (3,)
        The unit normal of a local maximum of the separation of the cores, from the first to the second; receives a
        better direction.
    depth, sure, tolerance : float
        Minus that maximum, which may be below 0 [m], the angle to n up to which no direction is better [rad], and how
        much better it must be to matter [m].
    """
    waiting, room, count = np.empty((_MOST_WAITING, 2, 3, 3)), np.empty((1, 8)), 8
    nearly, size = np.cos(min(sure, 0.5 * np.pi)), 0.0
    for octant in range(8):
        for j in range(3):
            for c in range(3):
                waiting[octant, 0, j, c] = 0.0
            waiting[octant, 0, j, j] = 1.0 if octant >> j & 1 == 0 else -1.0
            size = max(size, farthest_point(world, shapes, pair, waiting[octant], j, room))
    tolerance += _ROUNDING * size
    if abs(depth) <= tolerance:
        return False
    for octant in range(8):
        for j in range(3):
            if dot(waiting[octant, 0, j], waiting[octant, 1, j]) < depth - 0.5 * tolerance:
                for c in range(3):
                    n[c] = waiting[octant, 0, j, c]
                return True
    for _ in range(_MOST_TRIANGLES):
        if count == 0:
            return False
        last = waiting[count - 1]
        known = sure > 0.0
        for j in range(3):
            known = known and dot(last[0, j], n) >= nearly
        if known or least_within(last) >= depth - tolerance:
            count -= 1
            continue
        j = longest_side(last)
        a, b = (j + 1) % 3, (j + 2) % 3
        half = waiting[count]
        for c in range(3):
            for k in range(2):
                half[k, j, c], half[k, b, c] = last[k, j, c], last[k, b, c]
            half[0, a, c] = last[0, a, c] / one_norm(last[0, a]) + last[0, b, c] / one_norm(last[0, b])
        normalise(half[0, a])
        if farthest_point(world, shapes, pair, half, a, room) < depth - 0.5 * tolerance:
            for c in range(3):
                n[c] = half[0, a, c]
            return True
        for k in range(2):
            for c in range(3):
                last[k, b, c] = half[k, a, c]
        count += 1
        if count == _MOST_WAITING:
            return False
    return False

"""Distances and contact points of many pairs of convex shapes in few calls.

`distances_from_axes` finds the distances of pairs that are apart, starting from the axis that separated them last.
Where the bodies overlap, a maximum of the separation need not be the greatest one: the caller asks Coal.
`write_contacts` writes the contact points of pairs with known distances.

Arguments that kernels share: `places` are placements of bodies, shape (b, 4, 3); `frame` to `planes` as of
`separating_axis.Shapes`; `sides`, `start` and `axis` as of `SeparatingAxes`; `pairs` are the pairs to look at, shape
(p,). `state`, shape (p,), is `UNIQUE` or `FLAT` as of `refined_distance`, `COAL` where distance and normal are Coal's
own, and `FAILED` where they are unknown.
"""

from __future__ import annotations

import numpy as np

from ..arguments import Array
from ..compiled import kernel
from .collinear import first_of_lines
from .contact_patch import MOST_GATHERED, facing, leave, near_corners, near_vertices
from .convex_polygon import common_polygon, convex_hull
from .normal_search import dot
from .refined_distance import COAL, FAILED, FLAT, refine_pair
from .separating_axis import axis_in_world, pair_separation, place_shape
from .spread import BESIDE, FEW_POINTS, spread_out
from .support_points import within_plane

# lengths below are relative to the bounding radius of the smaller shape
# how far below the nearest point others are gathered, beyond the tolerance
_DEPTH = 1e-3
# points of a face that is parallel to another are level to within this
_LEVEL = 1e-8
# points whose corners are all less deep than the penetration by more than this lack the deepest one
_CORNER = 1e-6
# a face normal replaces the normal within the angle of this cosine, if the distance differs by no more than the second
_SAME_FACE, _EQUAL = np.cos(1e-3), 1e-8
# bounds of the error of Coal's normal: the first where shapes just touch, the second where they are far apart [rad],
# and Coal's tolerance
_ERROR_TOUCHING, _ERROR_APART, _FINE = 0.3, 1e-5, 1e-9
# by how much a refined distance may be below Coal's
BELOW = 1e-5
# corners nearer to each other than this are one
_SAME_CORNER = 1e-7


@kernel(
    "i8(f8[:,:,::1], i8[::1], f8[:,:,::1], f8[:,::1], f8[:,::1], i8[::1], i8[::1], i8[::1], i8[:,::1], i8[:,::1],"
    " f8[::1], i8[::1], i8[::1], f8, f8[::1], f8[:,::1], f8[:,::1], i8[::1])"
)
def distances_from_normals(
    places: Array, frame: Array, fixed: Array, sizes: Array, points: Array, first_point: Array, first: Array,
    neighbour: Array, sides: Array, start: Array, bound: Array, pairs: Array, asked: Array, enough: float,
    distance: Array, normal: Array, middle: Array, state: Array,
) -> int:  # fmt: skip
    """Refine approximate distances and normals of some pairs.

    Parameters
    ----------
    bound : ndarray, shape (n,)
        Of each pair the bounding radius of the smaller shape [m].
    asked : ndarray of int, shape (a,)
        The places in `pairs` of those that are meant.
    enough : float
        Of a distance beyond it a lower bound is enough [m]; its midpoint is not computed.
    distance, normal : ndarray, shapes (p,), (p, 3)
        Approximate; receive the refined ones where these are found.
    middle : ndarray, shape (p, 3)
        Receives the points midway between the surfaces, which are unknown if `FLAT`.

    Returns
    -------
    int
        How many of them still have the state `FAILED`: their refined distance is too far below the approximate one.
    """
    world, n, point, failed = np.empty((2, 4, 3)), np.empty(3), np.empty(3), 0
    for j in range(len(asked)):
        i = asked[j]
        pair = pairs[i]
        error = BELOW * bound[pair]
        if distance[i] > enough + 2.0 * error:
            distance[i], state[i] = distance[i] - error, COAL
            continue
        for side in range(2):
            place_shape(places, frame, fixed, sides[pair, side], world[side])
        for c in range(3):
            n[c] = normal[i, c]
        found, exact = refine_pair(world, sizes, points, first_point, first, neighbour, sides, start, pair, n, point)
        if found != FAILED and exact >= distance[i] - error:
            distance[i], state[i] = exact, found
            for c in range(3):
                normal[i, c], middle[i, c] = n[c], point[c]
        else:
            failed += 1
    return failed


@kernel(
    "void(f8[:,:,::1], f8[:,::1], f8[:,::1], i8[::1], i8[::1], i8[::1], i8[::1], i8[::1], f8[:,::1], i8[:,::1],"
    " i8[:,::1], i8, f8, f8, f8, i8, f8[::1])"
)
def _choose_normal(
    world: Array, sizes: Array, points: Array, first_point: Array, first: Array, neighbour: Array, first_face: Array,
    face: Array, planes: Array, sides: Array, start: Array, pair: int, distance: float, bound: float, unit: float,
    state: int, n: Array,
) -> None:  # fmt: skip
    """Replace the normal of a pair by that of a face, if the separation along it is the distance.

    Where two faces touch, rounding decides which of their normals n is. The face of the first shape goes first, by a
    margin far above rounding: rows are steady, and do not depend on earlier calls. Coal's own normal is replaced by
    that of the nearest face within the error of Coal, which grows as the distance vanishes.
    """
    found, chosen, back, along = np.empty((2, 3)), -1, np.empty(3), np.empty(2)
    for side in range(2):
        for c in range(3):
            back[c] = n[c] if side == 0 else -n[c]
        # climbs to the outermost points
        pair_separation(world, sizes, points, first_point, first, neighbour, sides, start, pair, n)
        s = sides[pair, side]
        vertex = start[pair, side] if first_face[first_point[s] + 1] > first_face[first_point[s]] else -1
        along[side] = facing(world[side], sizes[s], vertex, first_face, face, planes, back, found[side])
        for c in range(3):
            found[side, c] = found[side, c] if side == 0 else -found[side, c]
    if state == COAL:
        closest = np.cos(min(_ERROR_TOUCHING, _FINE * unit / max(abs(distance), 1e-300) + _ERROR_APART))
        for side in range(2):
            if along[side] > closest:
                closest, chosen = along[side], side
    else:
        for side in range(2):
            if chosen < 0 and along[side] > _SAME_FACE:
                apart = pair_separation(
                    world, sizes, points, first_point, first, neighbour, sides, start, pair, found[side]
                )
                if apart >= distance - _EQUAL * bound:
                    chosen = side
    if chosen >= 0:
        for c in range(3):
            n[c] = found[chosen, c]


@kernel(
    "i8(f8[:,::1], f8[::1], f8[:,::1], i8, i8, i8[::1], i8[::1], i8, f8[::1], f8[::1], f8[::1], f8, f8, f8[:,::1],"
    " i8[::1], f8[:,::1])"
)
def _outline(
    place: Array, sizes: Array, points: Array, begin: int, end: int, first: Array, neighbour: Array, start: int,
    out: Array, along: Array, across: Array, depth: float, bound: float, found: Array, vertices: Array, corners: Array,
) -> int:  # fmt: skip
    """Write the convex polygon of the points of a shape that are nearest to another, seen along the normal.

    Parameters
    ----------
    out, along, across : ndarray, shape (3,)
        The outward normal, and the two directions of the polygon's plane.
    depth, bound : float
        How far below the outermost point others are gathered, and a bounding radius [m].
    found, vertices : ndarray, shapes (g, 3) and (g,)
        Receive these points, and of a hull their numbers; `vertices[0]` is -1 for another shape.
    corners : ndarray, shape (2 g, 2)
        Receives the corners.

    Returns
    -------
    int
        How many corners there are; the points of a hull are counted by those of `vertices` before the first -1.
    """
    flat = np.empty((len(found), 2))
    if end - begin > 1:
        count = near_vertices(place, points, begin, end, first, neighbour, start, out, depth, found, vertices)
        if count < len(vertices):
            vertices[count] = -1
    else:
        count = near_corners(place, sizes, out, depth, found)
        vertices[0] = -1
    for i in range(count):
        flat[i, 0], flat[i, 1] = dot(found[i], along), dot(found[i], across)
    return convex_hull(flat, count, bound, corners)


@kernel("i8(f8[:,::1], f8[::1], f8[:,::1], i8, f8, f8)")
def _few(common: Array, gap: Array, point: Array, count: int, tolerance: float, bound: float) -> int:
    """Keep few of many corners of a region: of those within the tolerance the ones that `spread_out` chooses."""
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
            near = spread_out(common[:near], gap[:near], BESIDE * bound, chosen)
        for i in range(near):
            k = chosen[i]
            gap[i], common[i, 0], common[i, 1] = gap[k], common[k, 0], common[k, 1]
            for c in range(3):
                point[i, c] = point[k, c]
        if near <= FEW_POINTS:
            break
    return near if near > 0 else count


@kernel(
    "i8(f8[:,:,::1], f8[:,::1], f8[:,::1], i8[::1], i8[::1], i8[::1], i8[::1], i8[::1], f8[:,::1], i8[:,::1],"
    " i8[:,::1], i8, f8, f8, f8, f8[::1], f8[::1], f8[:,::1])"
)
def _patch(
    world: Array, sizes: Array, points: Array, first_point: Array, first: Array, neighbour: Array, first_face: Array,
    face: Array, planes: Array, sides: Array, start: Array, pair: int, distance: float, depth: float, bound: float,
    n: Array, gap: Array, point: Array,
) -> int:  # fmt: skip
    """Write the corners of the region that two shapes share along n, and their gaps; return how many.

    Parameters
    ----------
    distance, depth, bound : float
        Signed distance along n, how far below the nearest points others are gathered, and the bounding radius of the
        smaller shape [m].
    n : ndarray, shape (3,)
        The normal from the first shape to the second.
    gap, point : ndarray, shapes (2 g,) and (2 g, 3) with g = 2 `MOST_GATHERED`
        Receive gaps, and points midway between the surfaces; `point[0]` also where the shapes share no region.
    """
    along, across, out, middle = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    within_plane(n, along, across)
    found, vertices = np.empty((2, MOST_GATHERED, 3)), np.empty((2, MOST_GATHERED), np.int64)
    hulls, corners, number = np.empty((2, 2 * MOST_GATHERED, 2)), np.empty(2, np.int64), np.empty(2, np.int64)
    for side in range(2):
        s = sides[pair, side]
        for c in range(3):
            out[c] = n[c] if side == 0 else -n[c]
        corners[side] = _outline(
            world[side], sizes[s], points, first_point[s], first_point[s + 1], first, neighbour, start[pair, side], out,
            along, across, depth, bound, found[side], vertices[side], hulls[side],
        )  # fmt: skip
        number[side] = 0
        while number[side] < MOST_GATHERED and vertices[side, number[side]] >= 0:
            number[side] += 1
    # midway between the surfaces
    height = dot(found[0, 0], n) + 0.5 * distance
    for c in range(3):
        point[0, c] = found[0, 0, c] + 0.5 * distance * n[c]
    common, scratch = np.empty((len(gap), 2)), np.empty((len(gap), 2))
    count = common_polygon(hulls[0], corners[0], hulls[1], corners[1], bound, common, scratch)
    kept, a, b = 0, sides[pair, 0], sides[pair, 1]
    for i in range(count):
        same = False
        for j in range(kept):
            same = same or abs(common[j, 0] - common[i, 0]) + abs(common[j, 1] - common[i, 1]) < _SAME_CORNER * bound
        if same:
            continue
        common[kept, 0], common[kept, 1] = common[i, 0], common[i, 1]
        for c in range(3):
            middle[c] = common[i, 0] * along[c] + common[i, 1] * across[c] + height * n[c]
            out[c] = -n[c]
        up = leave(world[0], sizes[a], vertices[0], number[0], first_face, face, planes, middle, n)
        down = leave(world[1], sizes[b], vertices[1], number[1], first_face, face, planes, middle, out)
        gap[kept] = -(up + down)
        for c in range(3):
            point[kept, c] = middle[c] + 0.5 * (up - down) * n[c]
        kept += 1
    return _few(common, gap, point, kept, distance + depth - _DEPTH * bound, bound)


@kernel(
    "i8(f8[:,:,::1], i8[::1], f8[:,:,::1], f8[:,::1], f8[:,::1], i8[::1], i8[::1], i8[::1], i8[::1], i8[::1],"
    " f8[:,::1], i8[:,::1], i8[:,::1], f8[::1], f8[:,::1], i8[::1], f8[::1], f8[:,::1], f8[:,::1], i8[::1], i8[::1])"
)
def distances_from_axes(
    places: Array, frame: Array, fixed: Array, sizes: Array, points: Array, first_point: Array, first: Array,
    neighbour: Array, first_face: Array, face: Array, planes: Array, sides: Array, start: Array, bound: Array,
    axis: Array, pairs: Array, distance: Array, normal: Array, middle: Array, state: Array, unknown: Array,
) -> int:  # fmt: skip
    """Write distance, normal and midpoint of the pairs that are apart, and the state of all.

    Where shapes are apart, the separation along n has no local maximum but the greatest one, which is the distance.
    Where the search ends on parallel faces or edges, that is a maximum only if these share a region. Pairs that their
    axes do not separate are not searched.

    Parameters
    ----------
    bound : ndarray, shape (n,)
        Of each pair the bounding radius of the smaller shape [m].
    distance, normal, middle : ndarray, shapes (p,), (p, 3), (p, 3)
        Receive distances, unit normals and the points midway between the surfaces, which are unknown if `FLAT`.
    unknown : ndarray of int, shape (p,)
        Receives in its first places those of `pairs` whose state is `FAILED`.

    Returns
    -------
    int
        How many these are.
    """
    world, n, failed = np.empty((2, 4, 3)), np.empty(3), 0
    gaps, corners = np.empty(4 * MOST_GATHERED), np.empty((4 * MOST_GATHERED, 3))
    for i in range(len(pairs)):
        pair = pairs[i]
        state[i], found, apart = FAILED, FAILED, 0.0
        if axis[pair, 0] == axis[pair, 0]:
            for side in range(2):
                place_shape(places, frame, fixed, sides[pair, side], world[side])
            axis_in_world(places, frame[sides[pair, 0]], axis, pair, n)
            apart = pair_separation(world, sizes, points, first_point, first, neighbour, sides, start, pair, n)
        if apart > 0.0:
            found, apart = refine_pair(
                world, sizes, points, first_point, first, neighbour, sides, start, pair, n, middle[i]
            )
        if found == FLAT and apart > 0.0:
            shared = _patch(
                world, sizes, points, first_point, first, neighbour, first_face, face, planes, sides, start, pair,
                apart, _LEVEL * bound[pair], bound[pair], n, gaps, corners,
            )  # fmt: skip
            if shared == 0:
                found = FAILED
        if found != FAILED and apart > 0.0:
            state[i], distance[i] = found, apart
            for c in range(3):
                normal[i, c] = n[c]
        else:
            unknown[failed] = i
            failed += 1
    return failed


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


@kernel("i8(f8[::1], f8[:,::1], i8, f8[::1])")
def _one_of_each_line(gap: Array, point: Array, count: int, line: Array) -> int:
    """Keep the first of the points on each line along a direction; return how many."""
    kept = np.empty(count, np.int64)
    number = first_of_lines(point[:count], line, kept)
    for i in range(number):
        gap[i] = gap[kept[i]]
        for c in range(3):
            point[i, c] = point[kept[i], c]
    return number


@kernel("void(f8[::1], f8[:,::1], i8, f8, f8[::1])")
def _middle_of(gap: Array, point: Array, count: int, tolerance: float, middle: Array) -> None:
    """Write the mean of the points whose gap is within a tolerance; of none the first point."""
    share = 0.0
    for j in range(max(count, 1)):
        if count == 0 or gap[j] <= tolerance:
            share += 1.0
            for c in range(3):
                before = middle[c] if share > 1.0 else 0.0
                middle[c] = before + (point[j, c] - before) / share


@kernel(
    "i8(f8[:,:,::1], i8[::1], f8[:,:,::1], f8[:,::1], f8[:,::1], i8[::1], i8[::1], i8[::1], i8[::1], i8[::1],"
    " f8[:,::1], i8[:,::1], i8[:,::1], f8[::1], f8[::1], b1[::1], f8[::1], i8[::1], f8, f8[::1], f8[:,::1],"
    " f8[:,::1], i8[::1], i8[::1], f8[::1], f8[:,::1], f8[:,::1])"
)
def write_contacts(
    places: Array, frame: Array, fixed: Array, sizes: Array, points: Array, first_point: Array, first: Array,
    neighbour: Array, first_face: Array, face: Array, planes: Array, sides: Array, start: Array, bound: Array,
    unit: Array, flat_pair: Array, line: Array, pairs: Array, tolerance: float, distance: Array,
    normal: Array, middle: Array, state: Array, owner: Array, gap: Array, point: Array, normals: Array,
) -> int:  # fmt: skip
    """Write the contact points of some pairs, pair after pair.

    Parameters
    ----------
    bound, unit : ndarray, shape (n,)
        Of each pair the bounding radius of the smaller shape, and the unit in which Coal measures it [m].
    flat_pair : ndarray of bool, shape (n,)
        Whether the two shapes of a pair can share more than one point.
    line : ndarray, shape (3,)
        Of contact points on one line along this direction the first is kept; zero if all are.
    tolerance : float
        The distance up to which all points of contact are wanted [m]; beyond it, the nearest one.
    distance, normal, middle, state : ndarray, shapes (p,), (p, 3), (p, 3), (p,)
        Of these pairs. `normal` receives the normals of faces, and `middle`, where it is `FLAT`, the middle of the
        region that the shapes share.
    owner, gap, point, normals : ndarray, shapes (r,), (r,), (r, 3), (r, 3)
        Receive the pair, the gap, the point midway between the surfaces, and the normal of each contact point.

    Returns
    -------
    int
        How many contact points there are; -1 if there is no room for them.
    """
    world, total = np.empty((2, 4, 3)), 0
    gaps, corners = np.empty(4 * MOST_GATHERED), np.empty((4 * MOST_GATHERED, 3))
    for i in range(len(pairs)):
        pair, number = pairs[i], 0
        near, flat, known = distance[i] <= tolerance, flat_pair[pair], state[i] != FLAT
        if near or (flat and not known):
            for side in range(2):
                place_shape(places, frame, fixed, sides[pair, side], world[side])
            if near:
                _choose_normal(
                    world, sizes, points, first_point, first, neighbour, first_face, face, planes, sides, start, pair,
                    distance[i], bound[pair], unit[pair], state[i], normal[i],
                )  # fmt: skip
        if (near or not known) and flat:
            depth = max(tolerance - distance[i], 0.0) if near else 0.0
            number = _patch(
                world, sizes, points, first_point, first, neighbour, first_face, face, planes, sides, start, pair,
                distance[i], depth + _DEPTH * bound[pair], bound[pair], normal[i], gaps, corners,
            )  # fmt: skip
        deepest = np.inf
        for j in range(number):
            # no point is deeper than the penetration depth: what exceeds it is rounding
            gaps[j] = max(gaps[j], distance[i])
            deepest = min(deepest, gaps[j])
        if flat and not known:
            # any point of the shared region is as near; its middle moves steadily
            _middle_of(gaps, corners, number, deepest + _CORNER * bound[pair], middle[i])
        if not near:
            number, deepest = 0, np.inf
        if number and dot(line, line) > 0.0:
            number = _one_of_each_line(gaps, corners, number, line)
        if total + number + 1 > len(gap):
            return -1
        first_row = total
        # where edges cross, the deepest point may be none of the corners: it is a row of its own
        if number == 0 or deepest > distance[i] + _CORNER * bound[pair]:
            gap[total] = distance[i]
            for c in range(3):
                point[total, c] = middle[i, c]
            total += 1
        for j in range(number):
            gap[total] = gaps[j]
            for c in range(3):
                point[total, c] = corners[j, c]
            total += 1
        for row in range(first_row, total):
            owner[row] = pair
            for c in range(3):
                normals[row, c] = normal[i, c]
    return total

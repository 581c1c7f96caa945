"""The triangles of a mesh near a point: a search in the tree of boxes about them, in closed form."""

from __future__ import annotations

import numpy as np

from ...arguments import Array
from ...compiled import kernel
from ..meshes.triangles import FEW

# the most boxes that wait in a search: one for each time that the number of triangles is halved, and one more
_DEEPEST = 64
# part of the reach by which listed triangles may be farther, and what it loses to rounding
_AHEAD, _ROUNDED = 0.25, 1e-9


@kernel("f8(f8[:,::1], i8, f8[:,::1], i8)")
def _box_square(boxes: Array, k: int, centres: Array, i: int) -> float:
    """Return the square of the distance of a centre from a box [m^2]."""
    square = 0.0
    for c in range(3):
        beyond = max(boxes[k, c] - centres[i, c], centres[i, c] - boxes[k, 3 + c], 0.0)
        square += beyond * beyond
    return square


@kernel("Tuple((i8, f8))(f8[:,::1], i8[:,::1], i8, f8[:,::1], i8, f8[::1])")
def nearest_on_triangle(
    vertices: Array, triangles: Array, t: int, centres: Array, i: int, foot: Array
) -> tuple[int, float]:
    """Write the point of triangle t nearest to centre i.

    Returns
    -------
    feature : int
        The column of `Surface.features` that it lies on.
    distance : float
        Its distance [m].

    Notes
    -----
    C. Ericson, Real-Time Collision Detection (2005), section 5.1.5.
    """
    d1 = d2 = d3 = d4 = d5 = d6 = 0.0
    for k in range(3):
        A, B, C = vertices[triangles[t, 0], k], vertices[triangles[t, 1], k], vertices[triangles[t, 2], k]
        ab, ac, X = B - A, C - A, centres[i, k]
        d1 += ab * (X - A)
        d2 += ac * (X - A)
        d3 += ab * (X - B)
        d4 += ac * (X - B)
        d5 += ab * (X - C)
        d6 += ac * (X - C)
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    if d1 <= 0.0 and d2 <= 0.0:
        feature, v, w = 0, 0.0, 0.0
    elif d3 >= 0.0 and d4 <= d3:
        feature, v, w = 1, 1.0, 0.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        feature, v, w = 3, d1 / (d1 - d3), 0.0
    elif d6 >= 0.0 and d5 <= d6:
        feature, v, w = 2, 0.0, 1.0
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        feature, v, w = 5, 0.0, d2 / (d2 - d6)
    elif va <= 0.0 and d4 >= d3 and d5 >= d6:
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        feature, v = 4, 1.0 - w
    else:
        inside = 1.0 / (va + vb + vc)
        feature, v, w = 6, vb * inside, vc * inside
    square = 0.0
    for k in range(3):
        A, B, C = vertices[triangles[t, 0], k], vertices[triangles[t, 1], k], vertices[triangles[t, 2], k]
        foot[k] = A + v * (B - A) + w * (C - A)
        square += (centres[i, k] - foot[k]) ** 2
    return feature, np.sqrt(square)


@kernel("void(f8[:,::1], i8[:,::1], i8[::1], f8[:,::1], f8[:,::1], f8[::1])")
def mesh_distances(
    vertices: Array, triangles: Array, order: Array, boxes: Array, centres: Array, distance: Array
) -> None:
    """Write the distances of some points from a mesh, shape (n,) [m].

    Parameters
    ----------
    vertices, triangles, order, boxes
        Of `Surface` and its `Tree`.
    centres : ndarray, shape (n, 3)
        The points [m].
    """
    leaves, stack, foot = len(boxes) // 2, np.empty(_DEEPEST, np.int64), np.empty(3)
    for i in range(len(centres)):
        nearest, stack[0], waiting = np.inf, 1, 1
        while waiting > 0:
            waiting -= 1
            k = stack[waiting]
            # written so that an empty box, at an infinite distance, is left out
            if not _box_square(boxes, k, centres, i) < nearest * nearest:
                continue
            if k < leaves:
                # the nearer half is searched first
                far = 2 * k
                if _box_square(boxes, far, centres, i) < _box_square(boxes, far + 1, centres, i):
                    far += 1
                stack[waiting], stack[waiting + 1] = far, far ^ 1
                waiting += 2
                continue
            begin = (k - leaves) * FEW
            for j in range(begin, min(begin + FEW, len(order))):
                _, apart = nearest_on_triangle(vertices, triangles, order[j], centres, i, foot)
                nearest = min(nearest, apart)
        distance[i] = nearest


@kernel(
    "i8(f8[:,::1], i8[:,::1], i8, i8[:,::1], f8[:,::1], i8, f8, i8, i8[::1], i8[::1], f8[::1], f8[:,::1], i8[::1],"
    " f8[::1])"
)
def add_near(
    vertices: Array, triangles: Array, t: int, features: Array, centres: Array, i: int, reach: float, count: int,
    triangle: Array, number: Array, distance: Array, foot: Array, rank: Array, x: Array,
) -> int:  # fmt: skip
    """Add triangle t to the `count` near ones, if it is within reach; return how many these are then.

    Parameters
    ----------
    vertices to rank
        See `near_triangles`.
    x : ndarray, shape (3,)
        Scratch.
    """
    # most are ruled out by their boxes
    for c in range(3):
        A, B, C = vertices[triangles[t, 0], c], vertices[triangles[t, 1], c], vertices[triangles[t, 2], c]
        if min(A, B, C) - centres[i, c] > reach or centres[i, c] - max(A, B, C) > reach:
            return count
    feature, apart = nearest_on_triangle(vertices, triangles, t, centres, i, x)
    if not apart <= reach:
        return count
    if count < len(triangle):
        triangle[count], number[count], distance[count], rank[count] = t, features[t, feature], apart, count
        for c in range(3):
            foot[count, c] = x[c]
    return count + 1


@kernel(
    "i8(f8[:,::1], i8[:,::1], i8[::1], f8[:,::1], i8[:,::1], f8[:,::1], i8, f8, i8[::1], i8[::1], f8[::1], f8[:,::1],"
    " i8[::1])"
)
def near_triangles(
    vertices: Array, triangles: Array, order: Array, boxes: Array, features: Array, centres: Array, i: int,
    reach: float, triangle: Array, number: Array, distance: Array, foot: Array, rank: Array,
) -> int:  # fmt: skip
    """Write the triangles within reach of one point.

    If they are more than the arrays have room for, the rest is counted only.

    Parameters
    ----------
    vertices, triangles, order, boxes, features
        Of `Surface` and its `Tree`.
    centres, i
        Points [m], and the number of this one.
    reach : float
        The largest distance [m].
    triangle, number, distance, foot, rank : ndarray, shapes (k,), (k,), (k,), (k, 3), (k,)
        Receive the triangles, the features on which their nearest points lie, the distances, these points, and 0, 1,
        2, ...

    Returns
    -------
    int
        How many there are.
    """
    leaves, stack, x, count = len(boxes) // 2, np.empty(_DEEPEST, np.int64), np.empty(3), 0
    stack[0], waiting = 1, 1
    while waiting > 0:
        waiting -= 1
        k = stack[waiting]
        if boxes[k, 0] > boxes[k, 3] or _box_square(boxes, k, centres, i) > reach * reach:
            continue
        if k < leaves:
            stack[waiting], stack[waiting + 1] = 2 * k, 2 * k + 1
            waiting += 2
            continue
        begin = (k - leaves) * FEW
        for j in range(begin, min(begin + FEW, len(order))):
            count = add_near(
                vertices, triangles, order[j], features, centres, i, reach, count, triangle, number, distance, foot,
                rank, x,
            )  # fmt: skip
    return count


@kernel(
    "i8(f8[:,::1], i8[:,::1], i8[::1], f8[:,::1], i8[:,::1], f8[:,::1], i8, f8, i8[:,::1], f8[:,::1], i8[::1],"
    " i8[::1], f8[::1], f8[:,::1], i8[::1])"
)
def still_near(
    vertices: Array, triangles: Array, order: Array, boxes: Array, features: Array, centres: Array, i: int,
    reach: float, listed: Array, about: Array, triangle: Array, number: Array, distance: Array, foot: Array,
    rank: Array,
) -> int:  # fmt: skip
    """Write the triangles within reach of one point as `near_triangles` does, without the tree where it moved little.

    Parameters
    ----------
    vertices to reach, triangle to rank
        See `near_triangles`.
    listed : ndarray of int, shape (n, k)
        How many triangles are near each point, and which; without columns the tree is searched each time.
    about : ndarray, shape (n, 4)
        The point about which they are listed, and up to which distance [m]; zeros at the start. If that is zero, it
        is where the point was last, and nothing is listed.

    Returns
    -------
    int
        How many there are.
    """
    square, room = 0.0, min(listed.shape[1] - 1, len(triangle))
    for c in range(3 if room > 0 else 0):
        square += (centres[i, c] - about[i, c]) ** 2
    moved = np.sqrt(square)
    known = room > 0 and moved + reach <= about[i, 3]
    if known and listed[i, 0] <= room:
        count, x = 0, np.empty(3)
        for j in range(1, listed[i, 0] + 1):
            count = add_near(
                vertices, triangles, listed[i, j], features, centres, i, reach, count, triangle, number, distance,
                foot, rank, x,
            )  # fmt: skip
        return count
    lists = room > 0 and not known and moved <= _AHEAD * reach
    wide = (1.0 + _AHEAD) * reach if lists else reach
    count = near_triangles(
        vertices, triangles, order, boxes, features, centres, i, wide, triangle, number, distance, foot, rank
    )
    if room > 0 and not known:
        about[i, 3], listed[i, 0] = (1.0 - _ROUNDED) * wide if lists else 0.0, count
        for c in range(3):
            about[i, c] = centres[i, c]
    if not lists:
        return count
    if count > room:
        return near_triangles(
            vertices, triangles, order, boxes, features, centres, i, reach, triangle, number, distance, foot, rank
        )
    kept = 0
    for j in range(count):
        listed[i, j + 1] = triangle[j]
        if distance[j] <= reach:
            triangle[kept], number[kept], distance[kept], rank[kept] = triangle[j], number[j], distance[j], kept
            for c in range(3):
                foot[kept, c] = foot[j, c]
            kept += 1
    return kept

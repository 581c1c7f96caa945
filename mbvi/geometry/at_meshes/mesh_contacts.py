"""Contacts of spheres with a triangle mesh: a search in the tree of boxes about its triangles, in closed form."""

from __future__ import annotations

import numpy as np

from ...arguments import Array
from ...compiled import kernel
from ..meshes.triangles import FEW
from .mesh_sides import feature_normal, side_of

# the most boxes that wait in a search: one for each time that the number of triangles is halved, and one more
_DEEPEST = 64
# part of a radius within which the direction from the nearest point to a centre is rounding
_ON_IT = 1e-9


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
            t = order[j]
            feature, apart = nearest_on_triangle(vertices, triangles, t, centres, i, x)
            if not apart <= reach:
                continue
            if count < len(triangle):
                triangle[count], number[count], distance[count], rank[count] = t, features[t, feature], apart, count
                for c in range(3):
                    foot[count, c] = x[c]
            count += 1
    return count


@kernel("void(i8[::1], i8[::1], f8[::1], i8, i8[::1])")
def sort_by_feature(triangle: Array, number: Array, distance: Array, count: int, rank: Array) -> None:
    """Sort some triangles by feature, then by distance, then by their own numbers.

    Parameters
    ----------
    triangle, number, distance
        See `near_triangles`, in any order.
    count : int
        How many there are.
    rank : ndarray of int, shape (k,)
        The places 0, 1, ... of the triangles; they are sorted.

    Notes
    -----
    D. L. Shell, A high-speed sorting procedure (1959).
    """
    step = 1
    while 3 * step < count:
        step = 3 * step + 1
    while step > 0:
        for i in range(step, count):
            one, at = rank[i], i
            while at >= step:
                other = rank[at - step]
                before = number[one] < number[other]
                if number[one] == number[other]:
                    before = distance[one] < distance[other]
                    if distance[one] == distance[other]:
                        before = triangle[one] < triangle[other]
                if not before:
                    break
                rank[at] = other
                at -= step
            rank[at] = one
        step //= 3


@kernel(
    "Tuple((i8, i8))(f8[:,::1], i8[:,::1], i8[::1], f8[:,::1], i8[:,::1], i8[::1], b1[::1], f8[:,::1], f8[::1],"
    " f8[::1], f8, f8, i8[::1], i8[::1], f8[::1], f8[:,::1], i8[::1], i8[::1], f8[::1], f8[:,::1], f8[:,::1])"
)
def mesh_contacts(
    vertices: Array, triangles: Array, order: Array, boxes: Array, features: Array, sharers: Array, sheet: Array,
    centres: Array, radii: Array, reach: Array, tolerance: float, deepest: float, triangle: Array, number: Array,
    distance: Array, foot: Array, rank: Array, sphere: Array, gap: Array, point: Array, normal: Array,
) -> tuple[int, int]:  # fmt: skip
    """Write the contacts of spheres with a mesh: the points of it whose distance is a local minimum.

    A point on an edge or at a corner counts if it is the nearest one of all triangles that share it. The nearest point
    of a sphere counts in any case: rounding may hide a triangle that shares it. A sphere whose centre is behind a
    feature with a side has one contact, at its nearest point, that pushes it out to the front.

    Parameters
    ----------
    vertices, triangles, order, boxes, features, sharers
        Of `Surface` and its `Tree`.
    sheet : ndarray of bool, shape (f,)
        The features that are solid from both sides.
    centres, radii : ndarray, shapes (n, 3) and (n,)
        The spheres [m].
    reach : ndarray, shape (n,)
        Up to which distance from each centre triangles are looked at [m].
    tolerance : float
        The greatest gap of a contact [m].
    deepest : float
        How many radii a centre may be behind a feature; deeper ones meet it as a sheet, from behind.
    triangle, number, distance, foot, rank
        Scratch; see `near_triangles`.
    sphere, gap, point, normal : ndarray, shapes (k,), (k,), (k, 3), (k, 3)
        Receive the spheres, ascending; gaps, points midway between the surfaces, and normals towards the spheres.

    Returns
    -------
    count : int
        How many contacts there are; all are written if there is room.
    most : int
        The most triangles about one sphere; if there is no room for them, the count is wrong.
    """
    count, most, outward = 0, 0, np.empty(3)
    for i in range(len(radii)):
        found = near_triangles(
            vertices, triangles, order, boxes, features, centres, i, reach[i], triangle, number, distance, foot, rank
        )
        most, closest = max(most, found), np.inf
        found = min(found, len(triangle))
        sort_by_feature(triangle, number, distance, found, rank)
        for j in range(found):
            closest = min(closest, distance[j])
        # the nearest feature says whether the centre is behind it
        k = 0
        while k < found and distance[rank[k]] != closest:
            k += 1
        behind = (
            found > 0
            and not sheet[number[rank[k]]]
            and side_of(vertices, triangles, triangle, number, rank, k, found, centres, i, foot, outward) < 0.0
        )
        deep = behind and closest > deepest * radii[i]
        behind = behind and not deep
        k = 0
        while k < found:
            # the nearest of all triangles that share a feature, and how many of them have their nearest point there
            first, near, shared = k, rank[k], 1
            while k + shared < found and number[rank[k + shared]] == number[near]:
                shared += 1
            k += shared
            length, solid = distance[near], not sheet[number[near]]
            if length != closest and (behind or shared < sharers[number[near]]):
                continue
            if behind:
                # one contact pushes it out
                k = found
            elif solid and not deep:
                if side_of(vertices, triangles, triangle, number, rank, first, k, centres, i, foot, outward) < 0.0:
                    # the back of what is thin
                    continue
            sign = -1.0 if behind else 1.0
            apart = sign * length - radii[i]
            if not apart <= tolerance:
                continue
            if count < len(sphere):
                sphere[count], gap[count] = i, apart
                if length == 0.0 and not solid:
                    # a centre on the mesh leaves along the normal of the triangle
                    feature_normal(vertices, triangles, triangle, rank, first, 1, number[near], outward)
                known = length == 0.0 or (solid and not deep and length < _ON_IT * radii[i])
                for x in range(3):
                    normal[count, x] = outward[x] if known else sign * (centres[i, x] - foot[near, x]) / length
                    point[count, x] = centres[i, x] - (radii[i] + 0.5 * apart) * normal[count, x]
            count += 1
    return count, most

"""Contacts of spheres with a triangle mesh, in closed form."""

from __future__ import annotations

import numpy as np

from ...arguments import Array
from ...compiled import kernel
from .mesh_sides import feature_normal, side_of
from .near_triangles import still_near

# part of a radius within which the direction from the nearest point to a centre is rounding
_ON_IT = 1e-9


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
    " f8[::1], f8, f8, i8[:,::1], f8[:,::1], i8[::1], i8[::1], f8[::1], f8[:,::1], i8[::1], i8[::1], f8[::1],"
    " f8[:,::1], f8[:,::1])"
)
def mesh_contacts(
    vertices: Array, triangles: Array, order: Array, boxes: Array, features: Array, sharers: Array, sheet: Array,
    centres: Array, radii: Array, reach: Array, tolerance: float, deepest: float, listed: Array, about: Array,
    triangle: Array, number: Array, distance: Array, foot: Array, rank: Array, sphere: Array, gap: Array, point: Array,
    normal: Array,
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
    listed, about
        What is known of triangles near the spheres; see `still_near`.
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
        found = still_near(
            vertices, triangles, order, boxes, features, centres, i, reach[i], listed, about, triangle, number,
            distance, foot, rank,
        )  # fmt: skip
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

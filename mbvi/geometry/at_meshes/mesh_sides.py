"""On which side of a triangle mesh a point is: the normals of faces, edges and corners."""

from __future__ import annotations

import numpy as np

from ...arguments import Array
from ...compiled import kernel


@kernel("void(f8[:,::1], i8[:,::1], i8[::1], i8[::1], i8, i8, i8, f8[::1])")
def feature_normal(
    vertices: Array, triangles: Array, triangle: Array, rank: Array, first: int, shared: int, number: int, normal: Array
) -> None:
    """Write the unit normal of a feature: that of the face, or the mean of those about an edge or a corner.

    Parameters
    ----------
    vertices, triangles
        Of `Surface`.
    triangle, rank : ndarray of int
        See `near_triangles`; `shared` places of `rank` from `first` on are the triangles that share the feature.
    first, shared, number : int
        These places, and the feature's number.
    normal : ndarray, shape (3,)
        Receives the normal.

    Notes
    -----
    At a corner faces count by their angles: J. A. Baerentzen, H. Aanaes, Signed distance computation using the angle
    weighted pseudonormal (2005).
    """
    for x in range(3):
        normal[x] = 0.0
    for k in range(first, first + shared):
        t = triangle[rank[k]]
        corner = 0
        for j in range(3):
            if triangles[t, j] == number:
                corner = j
        a, b, c = triangles[t, corner], triangles[t, (corner + 1) % 3], triangles[t, (corner + 2) % 3]
        square, along, weight = 0.0, 0.0, 1.0
        for x in range(3):
            y, z = (x + 1) % 3, (x + 2) % 3
            area = (vertices[b, y] - vertices[a, y]) * (vertices[c, z] - vertices[a, z])
            area -= (vertices[b, z] - vertices[a, z]) * (vertices[c, y] - vertices[a, y])
            square += area * area
            along += (vertices[b, x] - vertices[a, x]) * (vertices[c, x] - vertices[a, x])
        length = np.sqrt(square)
        if number < len(vertices):
            weight = np.arctan2(length, along)
        for x in range(3):
            y, z = (x + 1) % 3, (x + 2) % 3
            area = (vertices[b, y] - vertices[a, y]) * (vertices[c, z] - vertices[a, z])
            area -= (vertices[b, z] - vertices[a, z]) * (vertices[c, y] - vertices[a, y])
            normal[x] += weight * area / length
    length = np.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
    for x in range(3):
        normal[x] /= max(length, 1e-300)


@kernel("f8(f8[:,::1], i8[:,::1], i8[::1], i8[::1], i8[::1], i8, i8, f8[:,::1], i8, f8[:,::1], f8[::1])")
def side_of(
    vertices: Array, triangles: Array, triangle: Array, number: Array, rank: Array, first: int, end: int,
    centres: Array, i: int, foot: Array, normal: Array,
) -> float:  # fmt: skip
    """Write the unit normal of a feature; return how high centre i is along it over its nearest point, below 0 behind.

    `first` is the first place in `rank` of the triangles that share the feature, and `end` one behind the last or more.
    """
    near, shared = rank[first], 1
    while first + shared < end and number[rank[first + shared]] == number[near]:
        shared += 1
    feature_normal(vertices, triangles, triangle, rank, first, shared, number[near], normal)
    height = 0.0
    for x in range(3):
        height += (centres[i, x] - foot[near, x]) * normal[x]
    return height

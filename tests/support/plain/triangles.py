"""Plain numpy forms of the kernels in mbvi/geometry/closed_form/mesh_contacts.py, which look at every triangle."""

from __future__ import annotations

import numpy as np

from mbvi.arguments import Array


def nearest_on_triangles(a: Array, b: Array, c: Array, x: Array) -> tuple[Array, Array]:
    """Return the point of each triangle abc nearest to x, shapes (k, 3), and on which of its features it lies.

    Features are numbered as the columns of `Surface.features`.

    Notes
    -----
    C. Ericson, Real-Time Collision Detection (2005), section 5.1.5.
    """
    ab, ac = b - a, c - a
    (d1, d2), (d3, d4), (d5, d6) = ((np.vecdot(ab, x - p), np.vecdot(ac, x - p)) for p in (a, b, c))
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    cases = [
        (d1 <= 0.0) & (d2 <= 0.0),
        (d3 >= 0.0) & (d4 <= d3),
        (vc <= 0.0) & (d1 >= 0.0) & (d3 <= 0.0),
        (d6 >= 0.0) & (d5 <= d6),
        (vb <= 0.0) & (d2 >= 0.0) & (d6 <= 0.0),
        (va <= 0.0) & (d4 >= d3) & (d5 >= d6),
    ]
    feature = np.select(cases, [0, 1, 3, 2, 5, 4], 6)
    with np.errstate(divide="ignore", invalid="ignore"):
        along_ab, along_ac, along_bc = d1 / (d1 - d3), d2 / (d2 - d6), (d4 - d3) / ((d4 - d3) + (d5 - d6))
        inside = 1.0 / (va + vb + vc)
        zero = np.zeros(len(x))
        v = np.select(cases, [zero, zero + 1.0, along_ab, zero, zero, 1.0 - along_bc], vb * inside)
        w = np.select(cases, [zero, zero, zero, zero + 1.0, along_ac, along_bc], vc * inside)
    return a + v[:, None] * ab + w[:, None] * ac, feature


def nearest_on_triangle_plain(
    vertices: Array, triangles: Array, t: int, centres: Array, i: int, foot: Array
) -> tuple[int, float]:
    """Write the nearest point of one triangle; return its feature, and its distance [m]."""
    feet, feature = nearest_on_triangles(*vertices[triangles[t]][:, None], centres[i : i + 1])
    foot[:] = feet[0]
    return int(feature[0]), float(np.linalg.norm(centres[i] - feet[0]))


def all_distances(vertices: Array, triangles: Array, centres: Array) -> tuple[Array, Array, Array]:
    """Return distance, feature and nearest point of each triangle from each centre, shapes (n, t) and (n, t, 3)."""
    t, n = len(triangles), len(centres)
    a, b, c = np.tile(vertices[triangles], (n, 1, 1)).transpose(1, 0, 2)
    feet, feature = nearest_on_triangles(a, b, c, centres.repeat(t, 0))
    away = np.linalg.norm(centres.repeat(t, 0) - feet, axis=1)
    return away.reshape(n, t), feature.reshape(n, t), feet.reshape(n, t, 3)


def mesh_distances_plain(
    vertices: Array, triangles: Array, order: Array, boxes: Array, centres: Array, distance: Array
) -> None:
    """Write the distances of some points from a mesh [m]."""
    distance[:] = all_distances(vertices, triangles, centres)[0].min(axis=1)


def mesh_contacts_plain(
    vertices: Array, triangles: Array, order: Array, boxes: Array, features: Array, sharers: Array, centres: Array,
    radii: Array, reach: Array, tolerance: float, triangle: Array, number: Array, distance: Array, foot: Array,
    rank: Array, sphere: Array, gap: Array, point: Array, normal: Array,
) -> tuple[int, int]:  # fmt: skip
    """Write the contacts of spheres with a mesh; return how many there are, and the most triangles about a sphere."""
    away, feature, feet = all_distances(vertices, triangles, centres)
    count, most = 0, 0
    for i, r in enumerate(radii):
        near = np.flatnonzero(away[i] <= reach[i])
        most = max(most, len(near))
        numbers = features[near, feature[i, near]]
        for f in np.unique(numbers):
            sharing = near[numbers == f]
            k = sharing[away[i, sharing].argmin()]
            whole = len(sharing) >= sharers[f] or away[i, k] == away[i, near].min()
            if not whole or away[i, k] - r > tolerance:
                continue
            n = centres[i] - feet[i, k]
            if away[i, k] == 0.0:
                a, b, c = vertices[triangles[k]]
                n = np.cross(b - a, c - a)
            sphere[count], gap[count] = i, away[i, k] - r
            normal[count] = n / np.linalg.norm(n)
            point[count] = centres[i] - (r + 0.5 * gap[count]) * normal[count]
            count += 1
    return count, most

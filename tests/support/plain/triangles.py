"""Plain numpy forms of kernels of near triangles and contacts of spheres, which look at every triangle."""

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


def feature_normal_plain(
    vertices: Array, triangles: Array, triangle: Array, rank: Array, first: int, shared: int, number: int, normal: Array
) -> None:
    """Write the normal of a feature; see `outward_at`."""
    normal[:] = outward_at(vertices, triangles[triangle[rank[first : first + shared]]], number)


def outward_at(vertices: Array, triangles: Array, number: int) -> Array:
    """Return the mean of the normals of some triangles, at a corner weighted by their angles there, shape (3,)."""
    total = np.zeros(3)
    for t in triangles.tolist():
        corner = t.index(number) if number in t else 0
        a, b, c = vertices[[t[corner], t[corner - 2], t[corner - 1]]]
        n, angle = np.cross(b - a, c - a), 1.0
        if number < len(vertices):
            angle = np.arccos(np.clip((b - a) @ (c - a) / np.linalg.norm(b - a) / np.linalg.norm(c - a), -1.0, 1.0))
        total += angle * n / np.linalg.norm(n)
    return total / np.linalg.norm(total)


def mesh_contacts_plain(
    vertices: Array, triangles: Array, order: Array, boxes: Array, features: Array, sharers: Array, sheet: Array,
    centres: Array, radii: Array, reach: Array, tolerance: float, deepest: float, listed: Array, about: Array,
    triangle: Array, number: Array, distance: Array, foot: Array, rank: Array, sphere: Array, gap: Array, point: Array,
    normal: Array,
) -> tuple[int, int]:  # fmt: skip
    """Write the contacts of spheres with a mesh; return how many there are, and the most triangles about a sphere."""
    away, feature, feet = all_distances(vertices, triangles, centres)
    count, most = 0, 0
    for i, r in enumerate(radii):
        near = np.flatnonzero(away[i] <= reach[i])
        most = max(most, len(near))
        if not near.size:
            continue
        numbers, closest = features[near, feature[i, near]], away[i, near].min()
        found = []
        for f in np.unique(numbers):
            sharing = near[numbers == f]
            k = sharing[away[i, sharing].argmin()]
            out = None if sheet[f] else outward_at(vertices, triangles[sharing], f)
            side = 0.0 if out is None else (centres[i] - feet[i, k]) @ out
            if len(sharing) >= sharers[f] or away[i, k] == closest:
                found.append((k, out, side))
        first = next(one for one in found if away[i, one[0]] == closest)
        deep = closest > deepest * r
        behind = first[2] < 0.0
        if behind and not deep:
            found = [first]
        elif not behind:
            found = [one for one in found if one[2] >= 0.0]
        for k, out, _ in found:
            sign = -1.0 if behind and not deep else 1.0
            apart = sign * away[i, k] - r
            if apart > tolerance:
                continue
            n = sign * (centres[i] - feet[i, k])
            if away[i, k] == 0.0:
                a, b, c = vertices[triangles[k]]
                n = np.cross(b - a, c - a) if out is None else out
            elif out is not None and not (behind and deep) and away[i, k] < 1e-9 * r:
                n = out
            sphere[count], gap[count] = i, apart
            normal[count] = n / np.linalg.norm(n)
            point[count] = centres[i] - (r + 0.5 * apart) * normal[count]
            count += 1
    return count, most

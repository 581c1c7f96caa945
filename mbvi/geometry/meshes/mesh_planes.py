"""Planes of the triangles of a mesh, and the angles by which it is bent at their edges."""

from __future__ import annotations

import numpy as np

from ...arguments import Array
from ...compiled import kernel


@kernel("void(f8[:,::1], i8[:,::1], f8[:,:,::1])")
def write_planes(vertices: Array, triangles: Array, planes: Array) -> None:
    """Write the planes of triangles and of their edges, shape (t, 4, 4); see `planes` of `Creases`."""
    edge, normal = np.zeros((3, 3)), np.zeros(3)
    for t in range(len(triangles)):
        for k in range(3):
            for x in range(3):
                edge[k, x] = vertices[triangles[t, (k + 1) % 3], x] - vertices[triangles[t, k], x]
        squared, offset = 0.0, 0.0
        for x in range(3):
            y, z = (x + 1) % 3, (x + 2) % 3
            # the last edge leads back to the first corner
            normal[x] = edge[0, z] * edge[2, y] - edge[0, y] * edge[2, z]
            squared += normal[x] * normal[x]
        for x in range(3):
            normal[x] /= np.sqrt(squared)
            planes[t, 0, x] = normal[x]
            offset += normal[x] * (
                (vertices[triangles[t, 0], x] + vertices[triangles[t, 1], x] + vertices[triangles[t, 2], x]) / 3.0
            )
        planes[t, 0, 3] = offset
        for k in range(3):
            squared, offset = 0.0, 0.0
            for x in range(3):
                y, z = (x + 1) % 3, (x + 2) % 3
                planes[t, 1 + k, x] = normal[y] * edge[k, z] - normal[z] * edge[k, y]
                squared += planes[t, 1 + k, x] * planes[t, 1 + k, x]
            for x in range(3):
                planes[t, 1 + k, x] /= np.sqrt(squared)
                offset += planes[t, 1 + k, x] * vertices[triangles[t, k], x]
            planes[t, 1 + k, 3] = offset


@kernel("void(f8[:,::1], i8[:,::1], f8[:,:,::1], i8[:,::1], i8[::1], i8[:,::1], f8[::1])")
def write_angles(
    vertices: Array, triangles: Array, planes: Array, number: Array, first: Array, beyond: Array, angle: Array
) -> None:
    """Write what each edge joins, and by how much the mesh is bent there.

    Parameters
    ----------
    vertices, triangles
        Of `Surface`.
    planes : ndarray, shape (t, 4, 4)
        By `write_planes`.
    number : ndarray of int, shape (t, 3)
        The number of the edge, of m, at each side of each triangle.
    first : ndarray of int, shape (m,)
        Receives the first side, 3 t + k, of each edge.
    beyond : ndarray of int, shape (t, 3)
        Receives the triangle beyond each side: -1 where not two triangles agree on the edge.
    angle : ndarray, shape (m,)
        Receives the angle from the first triangle to the other, positive away from the free side [rad]; NaN of others.
    """
    count, last = np.zeros(len(first), np.int64), np.zeros(len(first), np.int64)
    for t in range(len(triangles)):
        for k in range(3):
            e = number[t, k]
            if count[e] == 0:
                first[e] = 3 * t + k
            last[e] = 3 * t + k
            count[e] += 1
            beyond[t, k] = -1
    along = np.zeros(3)
    for e in range(len(first)):
        angle[e] = np.nan
        t, k, u, j = first[e] // 3, first[e] % 3, last[e] // 3, last[e] % 3
        tail, head = triangles[t, k], triangles[t, (k + 1) % 3]
        if count[e] != 2 or (tail < head) == (triangles[u, j] < triangles[u, (j + 1) % 3]):
            continue
        beyond[t, k], beyond[u, j] = u, t
        squared = 0.0
        for x in range(3):
            along[x] = vertices[head, x] - vertices[tail, x]
            squared += along[x] * along[x]
        sine, cosine = 0.0, 0.0
        for x in range(3):
            y, z = (x + 1) % 3, (x + 2) % 3
            across = planes[t, 0, y] * planes[u, 0, z] - planes[t, 0, z] * planes[u, 0, y]
            sine += across * (along[x] / np.sqrt(squared))
            cosine += planes[t, 0, x] * planes[u, 0, x]
        angle[e] = np.arctan2(sine, cosine)


@kernel("i8(i8[:,::1], i8[:,::1], i8[::1], i8[::1], i8[:,::1], i8[::1])")
def count_peaks(triangles: Array, ends: Array, first: Array, peak: Array, owned: Array, edges: Array) -> int:
    """Return the number of vertices at which three ridges or the rim meet, and number these.

    Parameters
    ----------
    triangles : ndarray of int, shape (t, 3)
        Of `Surface`.
    ends : ndarray of int, shape (r, 4)
        See `Creases`.
    first : ndarray of int, shape (m,)
        By `write_angles`.
    peak : ndarray of int, shape (v,)
        Receives the number of the peak at each vertex, or -1.
    owned : ndarray of int, shape (t, 3)
        Receives the number of the peak at the first corner that is there, or -1.
    edges : ndarray of int, shape (v,)
        Receives the number of edges at each peak, imagined ones too.
    """
    peak[:] = 0
    for r in range(len(ends)):
        for k in range(2):
            peak[ends[r, k]] += 4 if ends[r, 3] < 0 else 1
    count = 0
    for p in range(len(peak)):
        edges[p] = 0
        if peak[p] >= 3:
            peak[p], count = count, count + 1
        else:
            peak[p] = -1
    for t in range(len(triangles)):
        for k in range(3):
            p = peak[triangles[t, k]]
            owned[t, k] = -1
            if p >= 0 and edges[p] == 0:
                owned[t, k], edges[p] = p, 1
    edges[:] = 0
    for e in range(len(first)):
        t, k = first[e] // 3, first[e] % 3
        for x in (triangles[t, k], triangles[t, (k + 1) % 3]):
            if peak[x] >= 0:
                edges[peak[x]] += 1
    for r in range(len(ends)):
        for k in range(2):
            if ends[r, 3] < 0:
                edges[peak[ends[r, k]]] += 1
    return count


@kernel("void(f8[:,::1], i8[:,::1], f8[:,:,::1], i8[:,::1], i8[::1], i8[::1], i8[::1], f8[:,::1])")
def write_peak_edges(
    vertices: Array, triangles: Array, planes: Array, ends: Array, first: Array, peak: Array, place: Array, edges: Array
) -> None:
    """Write the unit vectors from each peak along its edges, and down imagined walls.

    Parameters
    ----------
    vertices, triangles, planes, ends, first, peak
        See `count_peaks` and `write_angles`.
    place : ndarray of int, shape (p,)
        Where the edges of each peak begin; moved to where they end.
    edges : ndarray, shape (e, 3)
        Receives the vectors.
    """
    for end in range(2):
        for e in range(len(first)):
            t, k = first[e] // 3, first[e] % 3
            x, to = triangles[t, (k + end) % 3], triangles[t, (k + 1 - end) % 3]
            if peak[x] < 0:
                continue
            at, squared = place[peak[x]], 0.0
            for i in range(3):
                edges[at, i] = vertices[to, i] - vertices[x, i]
                squared += edges[at, i] * edges[at, i]
            for i in range(3):
                edges[at, i] /= np.sqrt(squared)
            place[peak[x]] += 1
    for end in range(2):
        for r in range(len(ends)):
            if ends[r, 3] < 0:
                at = place[peak[ends[r, end]]]
                for i in range(3):
                    edges[at, i] = -planes[ends[r, 2], 0, i]
                place[peak[ends[r, end]]] += 1

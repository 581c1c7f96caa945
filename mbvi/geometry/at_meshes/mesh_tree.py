"""The tree of boxes about the triangles of a mesh: which are near a box and may touch a core, how far the tree is."""

from __future__ import annotations

import numpy as np

from ...arguments import Array
from ...compiled import kernel
from ..meshes.creases import RIM, Creases
from ..meshes.triangles import FEW
from .cores_at_mesh import CoresAtMesh
from .surface_features import above

# cosine of half the angle of a cone in which no two normals are at right angles
ACUTE = 0.71
# part of a rim's radius by which it reaches beyond the vertices that stand for it
RIMS = 0.01
# the most boxes that wait in a search: one for each time that the number of triangles is halved, and one more
_DEEPEST = 64


@kernel("i8(Creases, f8[::1], f8[::1], i8[::1])")
def triangles_in_box(mesh: Creases, low: Array, high: Array, found: Array) -> int:
    """List the triangles whose boxes meet a box, ascending by their places in the tree; count all if room is short.

    Parameters
    ----------
    mesh : Creases
    low, high : ndarray, shape (3,)
        Least and largest coordinates of the box [m].
    found : ndarray of int, shape (k,)
        Receives the triangles.
    """
    boxes, leaves, stack, count = mesh.boxes, len(mesh.boxes) // 2, np.empty(_DEEPEST, np.int64), 0
    stack[0], waiting = 1, 1
    while waiting > 0:
        waiting -= 1
        k, apart = stack[waiting], False
        for c in range(3):
            # an empty box is apart from all
            apart = apart or boxes[k, c] > high[c] or boxes[k, 3 + c] < low[c]
        if apart:
            continue
        if k < leaves:
            stack[waiting], stack[waiting + 1] = 2 * k + 1, 2 * k
            waiting += 2
            continue
        begin = (k - leaves) * FEW
        for j in range(begin, min(begin + FEW, len(mesh.order))):
            t, apart = mesh.order[j], False
            a, b, d = mesh.triangles[t, 0], mesh.triangles[t, 1], mesh.triangles[t, 2]
            for c in range(3):
                x, y, z = mesh.vertices[a, c], mesh.vertices[b, c], mesh.vertices[d, c]
                apart = apart or min(x, y, z) > high[c] or max(x, y, z) < low[c]
            if not apart:
                if count < len(found):
                    found[count] = t
                count += 1
    return count


@kernel("b1(Creases, f8[::1], f8[::1], b1, f8, i8[::1])")
def is_crossed(mesh: Creases, start: Array, end: Array, frontal: bool, eps: float, found: Array) -> bool:
    """Return whether a segment crosses a triangle; the opposite of `frontal` if room for those near it is short.

    Parameters
    ----------
    mesh : Creases
    start, end : ndarray, shape (3,)
        Ends of the segment [m].
    frontal : bool
        Whether only triangles count on whose free side it starts.
    eps : float
        Rounding [m].
    found : ndarray of int, shape (k,)
        Scratch for the triangles whose boxes meet that of the segment.
    """
    low, high = np.empty(3), np.empty(3)
    for c in range(3):
        low[c], high[c] = min(start[c], end[c]) - eps, max(start[c], end[c]) + eps
    count = triangles_in_box(mesh, low, high, found)
    if count > len(found):
        return not frontal
    for j in range(count):
        t = found[j]
        first = above(mesh.planes, t, 0, start[0], start[1], start[2])
        last = above(mesh.planes, t, 0, end[0], end[1], end[2])
        if not ((first > eps and last < -eps) or (not frontal and first < -eps and last > eps)):
            continue
        share, k = first / (first - last), 0
        x, y = start[0] + share * (end[0] - start[0]), start[1] + share * (end[1] - start[1])
        z = start[2] + share * (end[2] - start[2])
        while k < 3 and above(mesh.planes, t, 1 + k, x, y, z) >= -eps:
            k += 1
        if k == 3:
            return True
    return False


@kernel("f8(f8[:,::1], i8, f8[::1], f8[::1])")
def box_apart(boxes: Array, k: int, low: Array, high: Array) -> float:
    """Return the distance of box k of a tree from another box [m]."""
    square = 0.0
    for c in range(3):
        apart = max(boxes[k, c] - high[c], low[c] - boxes[k, 3 + c], 0.0)
        square += apart * apart
    return np.sqrt(square)


@kernel("f8(f8[:,::1], f8[::1], f8[::1])")
def tree_apart(boxes: Array, low: Array, high: Array) -> float:
    """Return the least distance of the last boxes of a tree from another box [m]."""
    leaves, stack, best = len(boxes) // 2, np.empty(_DEEPEST, np.int64), np.inf
    stack[0], waiting = 1, 1
    while waiting > 0:
        waiting -= 1
        k = stack[waiting]
        apart = box_apart(boxes, k, low, high)
        # written so that an empty box, at an infinite distance, is left out
        if not apart < best:
            continue
        if k >= leaves:
            best = apart
            continue
        far = 2 * k
        if box_apart(boxes, far, low, high) < box_apart(boxes, far + 1, low, high):
            far += 1
        stack[waiting], stack[waiting + 1] = far, far ^ 1
        waiting += 2
    return best


@kernel("f8(CoresAtMesh, i8, f8[::1])")
def narrow_cone(at: CoresAtMesh, count: int, axis: Array) -> float:
    """Write the axis of a cone of all normals of ridges and peaks of the first `near` triangles.

    Return the least cosine of the angle of a normal and the axis; -2 if it is not known.
    """
    mesh, length, least = at.mesh, 0.0, 1.0
    for c in range(3):
        axis[c] = 0.0
        for j in range(count):
            axis[c] += mesh.planes[at.near[j], 0, c]
        length += axis[c] * axis[c]
    length = np.sqrt(length)
    for c in range(3):
        axis[c] /= max(length, 1e-300)
    for j in range(count):
        t, along = at.near[j], 0.0
        for c in range(3):
            along += mesh.planes[t, 0, c] * axis[c]
        least = min(least, along)
        for k in range(3):
            # those of what surrounds a peak, too; at the rim there are imagined walls
            if mesh.bend[t, k] == RIM:
                return -2.0
    return least if least > 0.0 else -2.0


@kernel("i8(CoresAtMesh, i8, i8)")
def drop_below(at: CoresAtMesh, s: int, count: int) -> int:
    """Drop of the first `near` triangles those below core s that it cannot reach with its skin; return the new count.

    All vertices of the core, which are placed, are above the plane of such a triangle by more than that. The normals of
    its ridges and peaks must have positive cosines with its own: then gaps along them are no less than these heights.
    """
    cores, points, kept, i = at.cores, at.points, 0, 0
    number = cores.first_point[s + 1] - cores.first_point[s]
    most = cores.sizes[s, 3] + at.reach[s] + at.skin[s] + 2.0 * at.eps + RIMS * cores.rims[s, 3]
    for j in range(count):
        t, looked = at.near[j], 0
        # the vertex that is low over one triangle is often low over the next
        while looked < number and above(at.mesh.planes, t, 0, points[i, 0], points[i, 1], points[i, 2]) > most:
            looked, i = looked + 1, i + 1 if i + 1 < number else 0
        if looked < number:
            at.near[kept] = t
            kept += 1
    return kept


@kernel("void(CoresAtMesh, i8, i8, f8, f8[::1], f8, f8[::1])")
def write_excess(at: CoresAtMesh, s: int, count: int, margin: float, axis: Array, least: float, excess: Array) -> None:
    """Write how much higher along an axis the vertices of core s are than what can touch the first `near` triangles.

    Parameters
    ----------
    s, count, margin, axis, least
        See `list_vertices`, of `count` triangles.
    excess : ndarray, shape (n,)
        Receives the heights of the vertices, which are placed [m]; what has no vertex at or below 0 touches nothing.
    """
    mesh, cores, points, top = at.mesh, at.cores, at.points, -np.inf
    for j in range(count):
        for k in range(3):
            v = mesh.triangles[at.near[j], k]
            top = max(
                top, mesh.vertices[v, 0] * axis[0] + mesh.vertices[v, 1] * axis[1] + mesh.vertices[v, 2] * axis[2]
            )
    # what sinks in behind a valley may be beside its triangle by so much, and higher by the slope
    beside = max(cores.sizes[s, 4], margin) * (np.sqrt(1.0 - least * least) if least > 0.0 else 1.0)
    top += cores.sizes[s, 3] + at.reach[s] + 2.0 * (at.skin[s] + at.eps) + RIMS * cores.rims[s, 3] + beside
    for i in range(len(excess)):
        excess[i] = points[i, 0] * axis[0] + points[i, 1] * axis[1] + points[i, 2] * axis[2] - top

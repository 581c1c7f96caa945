"""The tree of boxes about the triangles of a mesh: which triangles are near a box, and how far the tree is from it."""

from __future__ import annotations

import numpy as np

from ...arguments import Array
from ...compiled import kernel
from ..meshes.creases import Creases
from ..meshes.triangles import FEW

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

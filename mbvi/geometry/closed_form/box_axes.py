"""Separating axes of two cores, the largest separation, and the nearest points of edges and corners."""

from __future__ import annotations

import numpy as np

from ...arguments import Array
from ...compiled import kernel
from ..shapes.shape_cores import HALF, NEAREST, NORMAL, SHIFT, complete_normal, face_normal

# the square of the sine of the angle between edges whose cross product is rounding
_NO_PLANE = 1e-30
# codes of axes: the normal of the face of side s along axis k is 3 s + k, the cross product of edges i and j is
# EDGES + 3 i + j
NO_AXIS, EDGES = -1, 6


@kernel("f8(f8[:,:,::1], i8, i8, f8)")
def face_separation(cores: Array, side: int, k: int, sign: float) -> float:
    """Return the separation along the normal of a face, that of axis k and a sign, of one core [m]."""
    apart = sign * cores[side, SHIFT, k] - cores[side, HALF, k]
    for j in range(3):
        apart -= cores[1 - side, HALF, j] * abs(cores[side, k, j])
    return apart


@kernel("f8(f8[:,:,::1], f8, f8)")
def separation_across(cores: Array, margin: float, known: float) -> float:
    """Return the separation of two segments along the direction to the second that is normal to the first [m].

    It is the largest where they are nearly parallel. If it is larger than what is known, the normal is written. On one
    line they have none: -inf is returned.
    """
    length = np.sqrt(cores[0, SHIFT, 0] ** 2 + cores[0, SHIFT, 1] ** 2)
    if length <= margin:
        return -np.inf
    x, y = cores[0, SHIFT, 0] / length, cores[0, SHIFT, 1] / length
    apart = length - cores[1, HALF, 2] * abs(x * cores[0, 0, 2] + y * cores[0, 1, 2])
    if apart > known:
        cores[0, NORMAL, 0], cores[0, NORMAL, 1], cores[0, NORMAL, 2] = x, y, 0.0
    return apart


@kernel("Tuple((f8, i8))(f8[:,:,::1], f8)")
def largest_separation(cores: Array, margin: float) -> tuple[float, int]:
    """Find the axis of the largest separation: of the normals of faces and the cross products of edges.

    For cores that overlap it is the signed distance; for others it may be less. An axis replaces one before it if its
    separation is larger by a margin: the faces of the first core go first, the edges last.

    Returns
    -------
    separation : float
        The largest; -inf if there is no axis, as for segments on one line [m].
    code : int
        The axis, whose normal is written; `NO_AXIS` if there is none.
    """
    best, code = -np.inf, NO_AXIS
    for side in range(2):
        # a segment has no faces
        for k in range(3 if cores[side, HALF, 0] > 0.0 else 0):
            sign = 1.0 if cores[side, SHIFT, k] >= 0.0 else -1.0
            apart = face_separation(cores, side, k, sign)
            if apart > best + (margin if code >= 0 else 0.0):
                best, code = apart, 3 * side + k
    if code >= 0:
        side, k = code // 3, code % 3
        face_normal(cores, side, k, 1.0 if cores[side, SHIFT, k] >= 0.0 else -1.0)
    for i in range(3):
        i1, i2 = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            # the cross product of edges is (x, y) across the first one
            x, y = -cores[0, i2, j], cores[0, i1, j]
            square = x * x + y * y
            if cores[0, HALF, i] == 0.0 or cores[1, HALF, j] == 0.0 or square < _NO_PLANE:
                continue
            j1, j2 = (j + 1) % 3, (j + 2) % 3
            along = x * cores[0, SHIFT, i1] + y * cores[0, SHIFT, i2]
            apart = abs(along) - cores[0, HALF, i1] * abs(x) - cores[0, HALF, i2] * abs(y)
            apart -= cores[1, HALF, j1] * abs(x * cores[0, i1, j1] + y * cores[0, i2, j1])
            apart -= cores[1, HALF, j2] * abs(x * cores[0, i1, j2] + y * cores[0, i2, j2])
            # this is the separation times the length of (x, y), compared without roots
            least = best + margin if code >= 0 else best
            if apart * abs(apart) > least * abs(least) * square:
                length = np.sqrt(square)
                x, y, apart = x / length, y / length, apart / length
                best, code = apart, EDGES + 3 * i + j
                sign = 1.0 if along >= 0.0 else -1.0
                cores[0, NORMAL, i], cores[0, NORMAL, i1], cores[0, NORMAL, i2] = 0.0, sign * x, sign * y
    if cores[0, HALF, 0] == 0.0 and cores[1, HALF, 0] == 0.0:
        apart = separation_across(cores, margin, best)
        if apart > best:
            best, code = apart, EDGES + 8
    if code >= EDGES:
        complete_normal(cores, 0)
    return best, code


@kernel("f8(f8[:,:,::1], i8, i8)")
def nearest_on_edges(cores: Array, i: int, j: int) -> float:
    """Write the nearest points of two edges, of the first core along its axis i and of the second along its j.

    Of the four edges along an axis it is the one that is farthest along the normal. Returns the distance [m].
    """
    for c in range(3):
        along = cores[0, HALF, c] if cores[0, NORMAL, c] >= 0.0 else -cores[0, HALF, c]
        cores[0, NEAREST, c] = 0.0 if c == i else along
        cores[1, NEAREST, c] = cores[0, SHIFT, c]
    for k in range(3):
        if k != j:
            along = cores[1, HALF, k] if cores[1, NORMAL, k] >= 0.0 else -cores[1, HALF, k]
            for c in range(3):
                cores[1, NEAREST, c] += along * cores[0, c, k]
    # the lines through these points first, then each within its edge
    cosine, square, one, other, across = cores[0, i, j], 0.0, cores[1, NEAREST, i] - cores[0, NEAREST, i], 0.0, 0.0
    for c in range(3):
        other -= (cores[1, NEAREST, c] - cores[0, NEAREST, c]) * cores[0, c, j]
        if c != i:
            square += cores[0, c, j] ** 2
            across += (cores[1, NEAREST, c] - cores[0, NEAREST, c]) * cores[0, c, j]
    # square is 1 - cosine^2 and this one + cosine other, without their cancellation where edges are nearly parallel
    first = one - cosine * across / square if square > 0.0 else 0.0
    first = min(max(first, -cores[0, HALF, i]), cores[0, HALF, i])
    second = min(max(other + cosine * first, -cores[1, HALF, j]), cores[1, HALF, j])
    first = min(max(one + cosine * second, -cores[0, HALF, i]), cores[0, HALF, i])
    cores[0, NEAREST, i] += first
    distance = 0.0
    for c in range(3):
        cores[1, NEAREST, c] += second * cores[0, c, j]
        distance += (cores[1, NEAREST, c] - cores[0, NEAREST, c]) ** 2
    return np.sqrt(distance)


@kernel("f8(f8[:,:,::1], f8)")
def nearest_to_corners(cores: Array, known: float) -> float:
    """Write the nearest points of which one is a corner of its core, if they are nearer than a known distance [m].

    Returns the lesser distance.
    """
    least, nearest_side, nearest_x, nearest_y, nearest_z = known * known, -1, 0.0, 0.0, 0.0
    for side in range(2):
        other = 1 - side
        for number in range(8):
            x, y, z = cores[other, HALF, 0], cores[other, HALF, 1], cores[other, HALF, 2]
            one, two, three = number & 1, number & 2, number & 4
            # each corner once where edges vanish
            if (one and x == 0.0) or (two and y == 0.0) or (three and z == 0.0):
                continue
            x, y, z, square = -x if one else x, -y if two else y, -z if three else z, 0.0
            for k in range(3):
                at = cores[side, SHIFT, k] + cores[side, k, 0] * x + cores[side, k, 1] * y + cores[side, k, 2] * z
                beyond = abs(at) - cores[side, HALF, k]
                square += 0.0 if beyond <= 0.0 else beyond * beyond
            # also if it is NaN
            if not square >= least:
                least, nearest_side, nearest_x, nearest_y, nearest_z = square, side, x, y, z
    if nearest_side < 0:
        return known
    side, x, y, z = nearest_side, nearest_x, nearest_y, nearest_z
    for k in range(3):
        at = cores[side, SHIFT, k] + cores[side, k, 0] * x + cores[side, k, 1] * y + cores[side, k, 2] * z
        cores[side, NEAREST, k] = min(max(at, -cores[side, HALF, k]), cores[side, HALF, k])
        if side == 0:
            cores[1, NEAREST, k] = at
    if side == 1:
        a, b, c = cores[1, NEAREST, 0], cores[1, NEAREST, 1], cores[1, NEAREST, 2]
        cores[0, NEAREST, 0], cores[0, NEAREST, 1], cores[0, NEAREST, 2] = x, y, z
        for k in range(3):
            cores[1, NEAREST, k] = cores[0, SHIFT, k] + cores[0, k, 0] * a + cores[0, k, 1] * b + cores[0, k, 2] * c
    return np.sqrt(least)

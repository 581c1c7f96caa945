"""Few of many rows of a convex core with a triangle mesh.

Rows with nearly the same normal are those of one patch of the mesh. Of more than `FEW_POINTS` rows of a patch few are
kept, as of the points of a face: where the body turns or slides so that another row of the patch sinks deeper, that
row is kept in the next search.
"""

from __future__ import annotations

import numpy as np

from ...arguments import Array
from ...compiled import kernel
from ..narrow.spread import BESIDE, FEW_POINTS, FLAT, few_corners, make_ascending, one_face
from ..vectors import within_plane

# rows nearer to each other than this are one, relative to the radius of the shape
_EQUAL = 1e-9
# one less the cosine of the angle of two normals that are the same
_SAME = 1e-12
# one less the cosine of the greatest angle between normals of one patch, 0.1 rad
_PATCH = 0.005


@kernel("i8(f8[:,::1], i8, f8)")
def without_equals(rows: Array, count: int, bound: float) -> int:
    """Keep of equal rows the first, in the first places; return how many are kept."""
    kept = 0
    for j in range(count):
        known = False
        for i in range(kept):
            alike = rows[i, 4] * rows[j, 4] + rows[i, 5] * rows[j, 5] + rows[i, 6] * rows[j, 6]
            apart = abs(rows[i, 0] - rows[j, 0])
            for c in range(1, 4):
                apart = max(apart, abs(rows[i, c] - rows[j, c]))
            known = known or (alike >= 1.0 - _SAME and apart < _EQUAL * bound)
        if not known:
            for c in range(7):
                rows[kept, c] = rows[j, c]
            kept += 1
    return kept


@kernel("i8(f8[:,::1], f8[::1], i8[::1])")
def first_to_touch(place: Array, gap: Array, chosen: Array) -> int:
    """Choose the deepest of some points, then one by one that which can sink deepest beside the chosen ones.

    Parameters
    ----------
    place, gap : ndarray, shapes (k, 2) and (k,)
        Places within the plane, and gaps [m]; more than `FEW_POINTS`.
    chosen : ndarray of int, shape (FEW_POINTS,)
        Receives the indices of the chosen points, ascending.

    Returns
    -------
    int
        How many are chosen.
    """
    # distances from the nearest chosen point; a turn by `BESIDE` about it takes this part of them from the gap
    far, last = np.full(len(gap), np.inf), 0
    for i in range(1, len(gap)):
        if gap[i] < gap[last]:
            last = i
    for count in range(len(chosen)):
        chosen[count], far[last], best = last, -1.0, -1
        for i in range(len(gap)):
            if far[i] >= 0.0:
                u, v = place[i, 0] - place[last, 0], place[i, 1] - place[last, 1]
                far[i] = min(far[i], np.sqrt(u * u + v * v))
                if best < 0 or gap[i] - BESIDE * far[i] < gap[best] - BESIDE * far[best]:
                    best = i
        last = best
    make_ascending(chosen, len(chosen))
    return len(chosen)


@kernel("i8(f8[:,::1], i8, f8, i8[::1])")
def few_of_each_patch(rows: Array, count: int, bound: float, group: Array) -> int:
    """Keep of equal rows one, and of those of one patch at most `FEW_POINTS`; return how many are kept.

    Parameters
    ----------
    rows, count
        See `all_rows`; the kept ones are moved to the front.
    bound : float
        Radius of the shape [m].
    group : ndarray of int, shape (count,)
        Scratch.
    """
    count = without_equals(rows, count, bound)
    if count <= FEW_POINTS:
        return count
    along, across, place, gap = np.empty(3), np.empty(3), np.empty((count, 2)), np.empty(count)
    index, chosen = np.empty(count, np.int64), np.empty(FEW_POINTS, np.int64)
    for i in range(count):
        group[i] = -1
    while True:
        # the deepest row that belongs to no patch yet has the next one about it
        first = -1
        for i in range(count):
            if group[i] == -1 and (first < 0 or rows[i, 0] < rows[first, 0]):
                first = i
        if first < 0:
            break
        within_plane(rows[first, 4:7], along, across)
        number = 0
        for j in range(count):
            alike = rows[first, 4] * rows[j, 4] + rows[first, 5] * rows[j, 5] + rows[first, 6] * rows[j, 6]
            if group[j] != -1 or alike < 1.0 - _PATCH:
                continue
            place[number, 0] = along[0] * rows[j, 1] + along[1] * rows[j, 2] + along[2] * rows[j, 3]
            place[number, 1] = across[0] * rows[j, 1] + across[1] * rows[j, 2] + across[2] * rows[j, 3]
            group[j], gap[number], index[number] = first, rows[j, 0], j
            number += 1
        if number <= FEW_POINTS:
            continue
        for k in range(number):
            group[index[k]] = -2
        if one_face(place[:number], gap[:number], bound):
            kept = few_corners(place[:number], gap[:number], max(rows[first, 0], 0.0) + FLAT * bound, chosen)
        else:
            kept = first_to_touch(place[:number], gap[:number], chosen)
        for k in range(kept):
            group[index[chosen[k]]] = first
    kept = 0
    for i in range(count):
        if group[i] != -2:
            for c in range(7):
                rows[kept, c] = rows[i, c]
            kept += 1
    return kept

"""Contact points of many pairs of convex shapes with known distances, in one call."""

from __future__ import annotations

import numpy as np

from ...arguments import Array
from ...compiled import kernel
from ..broad.separating_axis import Shapes, pair_separation, place_pair
from ..shapes.features import facing
from .contact_patch import DEPTH, MOST_GATHERED, mean_of_shared, shared_region
from .refined_distance import FLAT

# lengths are relative to the bounding radius of the smaller shape
# points whose corners are all less deep than the penetration by more than this lack the deepest one
_CORNER = 1e-6
# a face normal replaces the normal within the angle of this cosine, if the distance differs by no more than the second
_SAME_FACE, _EQUAL = np.cos(1e-3), 1e-8


@kernel("void(f8[:,:,::1], Shapes, i8, f8, f8, f8[::1])")
def _choose_normal(world: Array, shapes: Shapes, pair: int, distance: float, bound: float, n: Array) -> None:
    """Replace the normal of a pair by that of a face, if the separation along it is the distance.

    Where two faces touch, rounding decides which of their normals n is. The face of the first shape goes first, by a
    margin far above rounding: rows are steady, and do not depend on earlier calls.
    """
    found, chosen, along = np.empty((2, 3)), -1, np.empty(2)
    # climbs to the outermost points of both
    pair_separation(world, shapes, pair, n)
    for side in range(2):
        sign = 1.0 - 2.0 * side
        for c in range(3):
            n[c] *= sign
        along[side] = facing(world[side], shapes, pair, side, n, found[side])
        for c in range(3):
            n[c] *= sign
            found[side, c] *= sign
    for side in range(2):
        if chosen < 0 and along[side] > _SAME_FACE:
            if pair_separation(world, shapes, pair, found[side]) >= distance - _EQUAL * bound:
                chosen = side
    if chosen >= 0:
        for c in range(3):
            n[c] = found[chosen, c]


@kernel(
    "i8(f8[:,:,::1], Tuple(Shapes), f8[::1], b1[::1], i8[::1], f8, f8[::1], f8[:,::1], f8[:,::1], i8[::1],"
    " i8[::1], f8[::1], f8[:,::1], f8[:,::1])",
    apart=True,
)
def write_contacts(
    places: Array, tables: tuple[Array, ...], bound: Array, flat_pair: Array, pairs: Array,
    tolerance: float, distance: Array, normal: Array, middle: Array, state: Array, owner: Array, gap: Array,
    point: Array, normals: Array,
) -> int:  # fmt: skip
    """Write the contact points of some pairs, pair after pair.

    Parameters
    ----------
    places, tables, pairs
        See `pair_distances`.
    bound : ndarray, shape (n,)
        Of each pair the bounding radius of the smaller shape [m].
    flat_pair : ndarray of bool, shape (n,)
        Whether the two shapes of a pair can share more than one point.
    tolerance : float
        The distance up to which all points of contact are wanted [m]; beyond it, the nearest one.
    distance, normal, middle, state : ndarray, shapes (p,), (p, 3), (p, 3), (p,)
        Of these pairs. `normal` receives the normals of faces, and `middle`, where it is `FLAT`, the middle of the
        region that the shapes share.
    owner, gap, point, normals : ndarray, shapes (r,), (r,), (r, 3), (r, 3)
        Receive the pair, the gap, the point midway between the surfaces, and the normal of each contact point.

    Returns
    -------
    int
        How many contact points there are; -1 if there is no room for them.
    """
    shapes, world, total = Shapes(*tables), np.empty((2, 4, 3)), 0
    gaps, corners = np.empty(4 * MOST_GATHERED), np.empty((4 * MOST_GATHERED, 3))
    for i in range(len(pairs)):
        pair, number, deepest = pairs[i], 0, np.inf
        near, level = distance[i] <= tolerance, flat_pair[pair] and state[i] == FLAT
        if near or level:
            place_pair(places, shapes, pair, world)
        if near:
            _choose_normal(world, shapes, pair, distance[i], bound[pair], normal[i])
        if level or (near and flat_pair[pair]):
            depth = max(tolerance - distance[i], 0.0) + DEPTH * bound[pair]
            number = shared_region(world, shapes, pair, distance[i], depth, bound[pair], normal[i], gaps, corners)
            for j in range(number):
                # no point is deeper than the penetration depth: what exceeds it is rounding
                gaps[j] = max(gaps[j], distance[i])
                deepest = min(deepest, gaps[j])
        if level and number > 0:
            # any point of the shared region is as near; its middle moves steadily
            mean_of_shared(gaps, corners, number, deepest + _CORNER * bound[pair], middle[i])
        # where edges cross, the deepest point may be none of the corners: it is a row of its own
        alone = 1 if not near or deepest > distance[i] + _CORNER * bound[pair] else 0
        number = alone + (number if near else 0)
        if total + number > len(gap):
            return -1
        for j in range(number):
            row, k = total + j, j - alone
            owner[row], gap[row] = pair, distance[i] if k < 0 else gaps[k]
            for c in range(3):
                point[row, c], normals[row, c] = middle[i, c] if k < 0 else corners[k, c], normal[i, c]
        total += number
    return total

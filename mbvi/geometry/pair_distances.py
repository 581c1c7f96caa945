"""Distances of many pairs of convex shapes in few calls.

`distances_from_axes` finds the distances of pairs that are apart, and of hulls that overlap a little. It starts from
the axis that separated them last, or from the direction between their centres. Where bodies overlap, a maximum of the
separation need not be the greatest one: unless that is proved the caller asks Coal, and `distances_from_normals`
refines its answers.

Arguments that both share: `places` are placements of bodies, shape (b, 4, 3); `tables` the fields of `Shapes`; `bound`
is of each pair the bounding radius of the smaller shape, shape (n,) [m]; `pairs` are the pairs to look at, shape (p,).
`state`, shape (p,), is `UNIQUE` or `FLAT` as of `refined_distance`, `COAL` where distance and normal are Coal's own,
and `FAILED` where they are unknown.
"""

from __future__ import annotations

import numpy as np

from ..arguments import Array
from ..compiled import kernel
from .contact_patch import MOST_GATHERED, shared_region
from .proved_depth import between_centres, is_greatest, widest_angle
from .refined_distance import COAL, FAILED, FLAT, refine_pair
from .separating_axis import Shapes, axis_in_world, pair_separation, place_pair
from .vectors import dot, normalise

# lengths relative to the bounding radius of the smaller shape: points of a face that is parallel to another are level
# to within the first; a refined distance may be below Coal's by the second
_LEVEL, BELOW = 1e-8, 1e-5
# hulls that overlap by more than this are not searched from their axes, nor those of which too many directions would
# have to be ruled out [rad]
_SHALLOW, _WIDE = 0.05, 3.0


@kernel(
    "i8(f8[:,:,::1], Tuple(Shapes), f8[::1], i8[::1], f8[:,::1], f8[::1], f8[:,::1], f8[:,::1], i8[::1], i8[::1])",
    apart=True,
)
def distances_from_axes(
    places: Array, tables: tuple[Array, ...], bound: Array, pairs: Array, axis: Array, distance: Array, normal: Array,
    middle: Array, state: Array, unknown: Array,
) -> int:  # fmt: skip
    """Write distance, normal and midpoint of the pairs that are apart or overlap a little, and the state of all.

    Where shapes are apart, the separation along n has no local maximum but the greatest one, which is the distance.
    Where hulls overlap, the search counts if its maximum is proved to be the greatest one (`proved_depth`). Where it
    ends on parallel faces or edges, that is a maximum only if these share a region.

    Parameters
    ----------
    axis : ndarray, shape (n, 3)
        As of `SeparatingAxes`.
    distance, normal, middle : ndarray, shapes (p,), (p, 3), (p, 3)
        Receive distances, unit normals and the points midway between the surfaces, which are unknown if `FLAT`.
    unknown : ndarray of int, shape (p,)
        Receives in its first places those of `pairs` whose state is `FAILED`.

    Returns
    -------
    int
        How many these are.
    """
    shapes, world, n, failed = Shapes(*tables), np.empty((2, 4, 3)), np.empty(3), 0
    gaps, corners = np.empty(4 * MOST_GATHERED), np.empty((4 * MOST_GATHERED, 3))
    for i in range(len(pairs)):
        pair = pairs[i]
        place_pair(places, shapes, pair, world)
        found, apart = FAILED, -np.inf
        if axis[pair, 0] == axis[pair, 0]:
            axis_in_world(places, shapes.frame[shapes.sides[pair, 0]], axis, pair, n)
            apart = pair_separation(world, shapes, pair, n)
        else:
            between_centres(world, shapes, pair, n)
            if dot(n, n) > 0.0:
                normalise(n)
                apart = pair_separation(world, shapes, pair, n)
        # the search from here is of use only if its result can be proved
        if apart > 0.0 or (apart > -_SHALLOW * bound[pair] and widest_angle(world, shapes, pair, n, -apart) < _WIDE):
            found, apart = refine_pair(world, shapes, pair, n, middle[i])
            if found != FAILED and apart <= 0.0 and not is_greatest(world, shapes, pair, n, -apart, bound[pair]):
                found = FAILED
        if found == FLAT:
            depth = _LEVEL * bound[pair]
            if shared_region(world, shapes, pair, apart, depth, bound[pair], n, gaps, corners) == 0:
                found = FAILED
        if found == FAILED:
            state[i], unknown[failed] = FAILED, i
            failed += 1
            continue
        state[i], distance[i] = found, apart
        for c in range(3):
            normal[i, c] = n[c]
    return failed


@kernel("i8(f8[:,:,::1], Tuple(Shapes), f8[::1], i8[::1], i8[::1], f8, f8[::1], f8[:,::1], f8[:,::1], i8[::1])")
def distances_from_normals(
    places: Array, tables: tuple[Array, ...], bound: Array, pairs: Array, asked: Array, enough: float, distance: Array,
    normal: Array, middle: Array, state: Array,
) -> int:  # fmt: skip
    """Refine approximate distances and normals of some pairs.

    Parameters
    ----------
    asked : ndarray of int, shape (a,)
        The places in `pairs` of those that are meant.
    enough : float
        Of a distance beyond it a lower bound is enough [m]; its midpoint is not computed.
    distance, normal : ndarray, shapes (p,), (p, 3)
        Approximate; receive the refined ones where these are found.
    middle : ndarray, shape (p, 3)
        Receives the points midway between the surfaces, which are unknown if `FLAT`.

    Returns
    -------
    int
        How many of them still have the state `FAILED`: their refined distance is too far below the approximate one.
    """
    shapes, world, n, point, failed = Shapes(*tables), np.empty((2, 4, 3)), np.empty(3), np.empty(3), 0
    for j in range(len(asked)):
        i = asked[j]
        pair = pairs[i]
        error = BELOW * bound[pair]
        if distance[i] > enough + 2.0 * error:
            distance[i], state[i] = distance[i] - error, COAL
            continue
        place_pair(places, shapes, pair, world)
        for c in range(3):
            n[c] = normal[i, c]
        found, exact = refine_pair(world, shapes, pair, n, point)
        if found != FAILED and exact >= distance[i] - error:
            distance[i], state[i] = exact, found
            for c in range(3):
                normal[i, c], middle[i, c] = n[c], point[c]
        else:
            failed += 1
    return failed

"""Distances of many pairs of convex shapes in one call.

Where shapes are apart, the separation along n has no local maximum but the greatest one, which is the distance. Where
they overlap, a maximum counts if it is proved to be the greatest one (`proved_depth`): the depth. The search starts
from the axis that separated the pair last. If its result is not proved, it starts from directions that do not depend on
earlier calls, and goes on from each better direction that the proof finds. So each pair gets its distance, and the same
one whatever was known of it before.
"""

from __future__ import annotations

import numpy as np

from ...arguments import Array
from ...compiled import kernel
from ..broad.separating_axis import Shapes, axis_in_world, first_axis, pair_separation, place_pair
from .contact_patch import MOST_GATHERED, mean_of_shared, shared_region
from .core_search import approach, is_curved, search_cores, search_from_corners
from .proved_depth import MOST_POINTS, better_direction, disc_radius, level_points, share_a_line, widest_angle
from .refined_distance import FAILED, FLAT, UNIQUE, refine_pair

# lengths relative to the bounding radius of the smaller shape: points of a face that is parallel to another are level
# to within this
_LEVEL = 1e-8
# depths that are as good as each other: those of points, and those of curved shapes, of which infinitely many
# directions can be as good
_EQUAL, _EQUAL_CURVED = 1e-12, 1e-6
# radii of discs are taken too small by this part
_MARGIN = 1e-3
# turns after which a pair counts as near if none of them has separated it
_FEW = 4
# better directions that are followed one after the other
_MOST_BETTER = 50


@kernel("Tuple((i8, f8))(f8[:,:,::1], Shapes, i8, f8[::1], f8, f8[::1], f8[::1], f8[:,::1])")
def _curved_maximum(
    world: Array, shapes: Shapes, pair: int, n: Array, bound: float, nearest: Array, gaps: Array, corners: Array
) -> tuple[int, float]:
    """Do what `_maximum` does for cores that are curved: Newton's method, or else the search by points.

    Newton's result counts if it separates no less than the direction to start from does. Where it ends on parallel
    faces or edges, that is a maximum only if these share a region. The state is `FAILED` where n is no maximum.
    """
    start, other, apart = n.copy(), np.empty(3), pair_separation(world, shapes, pair, n)
    for turn in range(2):
        if turn == 1:
            for c in range(3):
                other[c] = start[c]
            search_cores(world, shapes, pair, other, False, nearest)
            along = pair_separation(world, shapes, pair, other)
            if along > apart:
                apart = along
                for c in range(3):
                    start[c] = other[c]
            for c in range(3):
                n[c] = start[c]
        found, _ = refine_pair(world, shapes, pair, n, other)
        refined = pair_separation(world, shapes, pair, n) if found != FAILED else -np.inf
        if not refined >= apart - _EQUAL * bound:
            continue
        if found == UNIQUE:
            for c in range(3):
                nearest[c] = other[c]
            return found, refined
        shared = shared_region(world, shapes, pair, refined, _LEVEL * bound, bound, n, gaps, corners)
        if shared > 0:
            mean_of_shared(gaps, corners, shared, np.inf, nearest)
            return found, refined
    for c in range(3):
        n[c] = start[c]
    return FAILED, apart


@kernel("Tuple((i8, f8))(f8[:,:,::1], Shapes, i8, f8[::1], f8, i8, b1, f8, f8[:,:,::1], i8[::1])")
def _known_maximum(
    world: Array, shapes: Shapes, pair: int, n: Array, apart: float, found: int, known: bool, bound: float, flat: Array,
    count: Array,
) -> tuple[int, float]:  # fmt: skip
    """Return state and sure angle, as of `_maximum`, of a maximum n with a separation.

    `known` says whether it is one of the cores themselves.
    """
    a, b, curved = shapes.sides[pair, 0], shapes.sides[pair, 1], is_curved(shapes, pair)
    level_points(world, shapes, pair, n, bound, flat, count)
    if not curved and share_a_line(flat, count):
        found = FLAT
    depth = -apart - shapes.sizes[a, 3] - shapes.sizes[b, 3]
    if depth < 0.0:
        return found, np.pi if known else 0.0
    radius = (1.0 - _MARGIN) * disc_radius(flat[0], flat[1], count[0], count[1])
    return found, 2.0 * np.arctan2(max(radius, 0.0), depth)


@kernel(
    "Tuple((i8, f8, f8))(f8[:,:,::1], Shapes, i8, f8[::1], b1, f8, f8[::1], f8[::1], f8[:,::1], f8[:,:,::1], i8[::1])"
)
def _maximum(
    world: Array, shapes: Shapes, pair: int, n: Array, about: bool, bound: float, nearest: Array, gaps: Array,
    corners: Array, flat: Array, count: Array,
) -> tuple[int, float, float]:  # fmt: skip
    """Turn n to a local maximum of the separation; write the point midway between the surfaces.

    `about` says that n is near it. `gaps`, `corners`, `flat` and `count` are room, as of `shared_region` and
    `level_points`.

    Returns
    -------
    state : int
        `UNIQUE`, or `FLAT` where the nearest points are not.
    distance : float
        The separation [m].
    sure : float
        The angle to n up to which nothing separates more [rad]; pi where the cores are apart and n is a maximum.
    """
    found, curved, known = UNIQUE, is_curved(shapes, pair), True
    if curved:
        found, apart = _curved_maximum(world, shapes, pair, n, bound, nearest, gaps, corners)
        known = found != FAILED
        found = found if known else UNIQUE
    else:
        apart = search_cores(world, shapes, pair, n, about, nearest)[1]
    found, sure = _known_maximum(world, shapes, pair, n, apart, found, known, bound, flat, count)
    return found, apart, sure


@kernel("f8(f8[:,:,::1], Shapes, i8, f8[::1], b1, f8, f8[:,::1])")
def _nearly_apart(
    world: Array, shapes: Shapes, pair: int, n: Array, known: bool, near: float, active: Array
) -> float:  # fmt: skip
    """Return a separation of a pair and turn n, its axis if that is known, to that direction.

    Most pairs that are measured are far apart and have turned away from their axes.
    """
    if not known:
        for c in range(3):
            n[c] = world[0, 2, c]
        first_axis(world, shapes, pair, n)
    balls = shapes.sizes[shapes.sides[pair, 0], 3] + shapes.sizes[shapes.sides[pair, 1], 3]
    approach(world, shapes, pair, n, active, near + balls, _FEW)
    return pair_separation(world, shapes, pair, n)


@kernel(
    "void(f8[:,:,::1], Tuple(Shapes), f8[::1], i8[::1], f8[:,::1], f8, f8[::1], f8[:,::1], f8[:,::1], i8[::1])",
    apart=True,
)
def distances_from_axes(
    places: Array, tables: tuple[Array, ...], bound: Array, pairs: Array, axis: Array, near: float, distance: Array,
    normal: Array, middle: Array, state: Array,
) -> None:  # fmt: skip
    """Write distance, normal, midpoint and state of some pairs.

    Parameters
    ----------
    places : ndarray, shape (b, 4, 3)
        Placements of the bodies: columns of the rotation, then the origin.
    tables : tuple
        The fields of `Shapes`.
    bound : ndarray, shape (n,)
        Of each pair the bounding radius of the smaller shape [m].
    pairs : ndarray of int, shape (p,)
        The pairs to look at.
    axis : ndarray, shape (n, 3)
        See `SeparatingAxes`.
    near : float
        Of pairs that are farther apart than this a lower bound of the distance is enough [m].
    distance, normal, middle : ndarray, shapes (p,), (p, 3), (p, 3)
        Receive distances, unit normals and the points midway between the surfaces; any of these if `FLAT`. Of pairs
        that are not near only the first two.
    state : ndarray of int, shape (p,)
        Receives `UNIQUE`, or `FLAT` where the nearest points are not unique.
    """
    shapes, world, n, nearest = Shapes(*tables), np.empty((2, 4, 3)), np.empty(3), np.empty(3)
    gaps, corners = np.empty(4 * MOST_GATHERED), np.empty((4 * MOST_GATHERED, 3))
    flat, count, active = np.empty((2, MOST_POINTS, 2)), np.empty(2, np.int64), np.empty((4, 8))
    for i in range(len(pairs)):
        pair = pairs[i]
        place_pair(places, shapes, pair, world)
        known, exact = axis[pair, 0] == axis[pair, 0], near == np.inf
        if known:
            axis_in_world(places, shapes.frame[shapes.sides[pair, 0]], axis, pair, n)
        balls = shapes.sizes[shapes.sides[pair, 0], 3] + shapes.sizes[shapes.sides[pair, 1], 3]
        equal = (_EQUAL_CURVED if is_curved(shapes, pair) else _EQUAL) * bound[pair]
        found, sure, proved, again, apart = UNIQUE, 0.0, False, 0, -np.inf
        if known:
            again, apart = search_from_corners(world, shapes, pair, n, active, nearest)
        if again > 0:
            found, sure = _known_maximum(world, shapes, pair, n, apart, UNIQUE, True, bound[pair], flat, count)
            if found != UNIQUE or count[0] + count[1] != again + 1:
                # of more level points it depends on the search which are taken
                again = 0
                axis_in_world(places, shapes.frame[shapes.sides[pair, 0]], axis, pair, n)
        if again == 0 and not exact:
            apart = _nearly_apart(world, shapes, pair, n, known, near, active)
            if apart > near:
                state[i], distance[i] = UNIQUE, apart
                for c in range(3):
                    normal[i, c], middle[i, c] = n[c], world[0, 3, c]
                continue
        if known:
            if again == 0:
                # the last axis of a pair that is near, or what it was turned to, is near the result
                found, apart, sure = _maximum(
                    world, shapes, pair, n, not exact, bound[pair], nearest, gaps, corners, flat, count
                )
            # where curved cores overlap, the last digits may depend on where the search began
            if apart + balls > 0.0 or not is_curved(shapes, pair):
                proved = widest_angle(world, shapes, pair, n, -apart - balls) <= sure
        if not proved:
            for side in range(2):
                shapes.start[pair, side] = shapes.first_point[shapes.sides[pair, side]]
            for c in range(3):
                n[c] = world[0, 2, c]
            first_axis(world, shapes, pair, n)
            found, apart, sure = _maximum(
                world, shapes, pair, n, False, bound[pair], nearest, gaps, corners, flat, count
            )
            proved = widest_angle(world, shapes, pair, n, -apart - balls) <= sure
        for _ in range(_MOST_BETTER):
            state[i], distance[i] = found, apart
            for c in range(3):
                normal[i, c], middle[i, c] = n[c], nearest[c]
            if proved or not better_direction(world, shapes, pair, n, -apart - balls, sure, equal):
                break
            found, apart, sure = _maximum(
                world, shapes, pair, n, False, bound[pair], nearest, gaps, corners, flat, count
            )
            if not apart > distance[i]:
                break
            proved = widest_angle(world, shapes, pair, n, -apart - balls) <= sure

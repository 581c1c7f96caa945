"""A proof that a local maximum of the separation of two overlapping hulls is the greatest one: their penetration depth.

The difference D of two convex sets holds the origin where they overlap. The penetration depth d is the least value of
its support function h over unit vectors. Let h(n) = d be a local minimum, so that a face of D has the normal n and the
offset d, and holds a disc of a radius r about d n.

- Along n' at an angle f to n, h(n') >= d cos f + r sin f. This is at least d if r >= d tan(f / 2).
- D holds the difference of two balls, one inside each hull: a ball of a radius s about c. Hence h(n') >= c n' + s, and
  h(n') <= d only at angles to -c of at most arccos((s - d) / |c|).

If the first holds at the largest angle that the second leaves, then no direction has a smaller h.
"""

from __future__ import annotations

import numpy as np

from ..arguments import Array
from ..compiled import kernel
from .features import near_vertices
from .separating_axis import Shapes, between_centres
from .vectors import dot, within_plane

# vertices of the face of each hull that are looked at, and how far below the outermost they may be, relative to the
# radius of the smaller shape
_MOST_VERTICES, _LEVEL = 8, 1e-9
# angles are taken too large by this part, radii too small
_MARGIN = 1e-3


@kernel("f8(f8[:,:,::1], Shapes, i8, f8[::1], f8)")
def widest_angle(world: Array, shapes: Shapes, pair: int, n: Array, depth: float) -> float:
    """Return the largest angle to n of directions whose separation may be above -depth [rad]; pi if all may.

    world, shapes, pair, n and depth are as of `is_greatest`.
    """
    # shapes other than hulls have no ball
    if not (shapes.inside[shapes.sides[pair, 0], 3] > 0.0 and shapes.inside[shapes.sides[pair, 1], 3] > 0.0):
        return np.pi
    between = np.empty(3)
    radius = between_centres(world, shapes, pair, between) - depth
    far = np.sqrt(dot(between, between))
    if radius >= far:
        return 0.0
    if radius <= -far:
        return np.pi
    towards = min(max(dot(between, n) / far, -1.0), 1.0)
    return min((np.arccos(towards) + np.arccos(radius / far)) * (1.0 + _MARGIN), np.pi)


@kernel("f8(f8[:,::1], f8[:,::1], i8, i8)")
def disc_radius(first: Array, second: Array, k: int, m: int) -> float:
    """Return the radius of the largest disc about the origin in the differences of two plane polygons.

    0 or less where the origin is outside. `first` and `second`, shapes (k, 2) and (m, 2), are points whose hulls the
    polygons are. Only normals of edges matter, and each is normal to two points of one polygon.
    """
    least, found = np.inf, False
    for which in range(2):
        points, count = (first, k) if which == 0 else (second, m)
        for i in range(count):
            for j in range(i):
                x, y = points[j, 1] - points[i, 1], points[i, 0] - points[j, 0]
                length = np.sqrt(x * x + y * y)
                if length == 0.0:
                    continue
                found = True
                for _ in range(2):
                    x, y = -x, -y
                    high, low = -np.inf, np.inf
                    for a in range(k):
                        high = max(high, x * first[a, 0] + y * first[a, 1])
                    for b in range(m):
                        low = min(low, x * second[b, 0] + y * second[b, 1])
                    least = min(least, (high - low) / length)
    return least if found else 0.0


@kernel("b1(f8[:,:,::1], Shapes, i8, f8[::1], f8, f8)")
def is_greatest(world: Array, shapes: Shapes, pair: int, n: Array, depth: float, bound: float) -> bool:
    """Return whether it is proved that no direction separates two overlapping hulls better than n.

    Parameters
    ----------
    world : ndarray, shape (2, 4, 3)
        Where the two shapes are.
    shapes, pair
        The shapes and the pair.
    n : ndarray, shape (3,)
        The unit normal of a local maximum of the separation, from the first shape to the second.
    depth, bound : float
        Minus that maximum, and the bounding radius of the smaller shape [m].
    """
    angle = widest_angle(world, shapes, pair, n, depth)
    if angle >= np.pi:
        return False
    needed = depth * np.tan(0.5 * angle) * (1.0 + _MARGIN)
    across, outward = np.empty((2, 3)), np.empty(3)
    within_plane(n, across[0], across[1])
    found, vertices = np.empty((_MOST_VERTICES, 3)), np.empty(_MOST_VERTICES, np.int64)
    flat, count = np.empty((2, _MOST_VERTICES, 2)), np.empty(2, np.int64)
    for side in range(2):
        for c in range(3):
            outward[c] = n[c] if side == 0 else -n[c]
        count[side] = near_vertices(world[side], shapes, pair, side, outward, _LEVEL * bound, found, vertices)
        for i in range(count[side]):
            for c in range(2):
                flat[side, i, c] = dot(found[i], across[c])
    return disc_radius(flat[0], flat[1], count[0], count[1]) >= needed

"""Lower bounds on the distance of convex shapes by the last separating axis of each pair.

The distance of two shapes is at least the distance of their projections onto any unit vector n. The normal of the last
measured distance is kept in the frame of the first body. It separates the shapes for many steps, so that most pairs are
seldom measured again.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..arguments import Array
from ..compiled import kernel
from .shapes import Box, Capsule, Convex, Cylinder, Ellipsoid, PlacedShape, Sphere


class _Support(NamedTuple):
    """A shape as a Minkowski sum of simple sets, whose support functions add up.

    Attributes
    ----------
    box : tuple of float
        Half edges of a box.
    ball, disk : float
        Radii of a ball, and of a disk normal to z.
    ellipsoid : tuple of float
        Half axes of an ellipsoid.
    points : ndarray, shape (k, 3)
        Vertices of a convex hull.
    """

    box: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ball: float = 0.0
    disk: float = 0.0
    ellipsoid: tuple[float, float, float] = (0.0, 0.0, 0.0)
    points: Array = np.zeros((1, 3))


def _support(shape: Convex) -> _Support:
    """Return a shape as a Minkowski sum about the origin of its frame."""
    match shape:
        case Sphere():
            return _Support(ball=shape.radius)
        case Ellipsoid():
            return _Support(ellipsoid=shape.radii)
        case Box():
            a, b, c = shape.size
            return _Support(box=(0.5 * a, 0.5 * b, 0.5 * c))
        case Capsule():
            return _Support(box=(0.0, 0.0, 0.5 * shape.length), ball=shape.radius)
        case Cylinder():
            return _Support(box=(0.0, 0.0, 0.5 * shape.length), disk=shape.radius)
    return _Support(points=shape.vertices)


@kernel("f8(f8[:,::1], f8[::1], f8[::1], f8[:,::1], i8, i8)")
def _reach(place: Array, u: Array, sizes: Array, points: Array, begin: int, end: int) -> float:
    """Return how far a shape reaches from the world's origin along a unit vector [m].

    Parameters
    ----------
    place : ndarray, shape (4, 3)
        Placement of the shape: columns of its rotation, then its origin.
    u : ndarray, shape (3,)
        The unit vector.
    sizes : ndarray, shape (8,)
        Box, ball, disk, ellipsoid of its `_Support`.
    points, begin, end : ndarray, shape (k, 3), and int
        The points of all supports, and which of them are this one's.
    """
    x = place[0, 0] * u[0] + place[0, 1] * u[1] + place[0, 2] * u[2]
    y = place[1, 0] * u[0] + place[1, 1] * u[1] + place[1, 2] * u[2]
    z = place[2, 0] * u[0] + place[2, 1] * u[1] + place[2, 2] * u[2]
    far = points[begin, 0] * x + points[begin, 1] * y + points[begin, 2] * z
    for k in range(begin + 1, end):
        far = max(far, points[k, 0] * x + points[k, 1] * y + points[k, 2] * z)
    far += place[3, 0] * u[0] + place[3, 1] * u[1] + place[3, 2] * u[2]
    far += abs(x) * sizes[0] + abs(y) * sizes[1] + abs(z) * sizes[2] + sizes[3]
    if sizes[4] > 0.0:
        far += sizes[4] * np.sqrt(x * x + y * y)
    if sizes[5] > 0.0:
        far += np.sqrt((sizes[5] * x) ** 2 + (sizes[6] * y) ** 2 + (sizes[7] * z) ** 2)
    return far


@kernel(
    "i8(f8[:,:,::1], i8[::1], f8[:,:,::1], f8[:,::1], f8[:,::1], i8[::1], i8[:,::1], f8[:,::1], i8[::1], f8, f8[::1],"
    " i8[::1])"
)
def _clear(
    places: Array, frame: Array, fixed: Array, sizes: Array, points: Array, first_point: Array,
    sides: Array, axis: Array, candidates: Array, tolerance: float, bound: Array, unresolved: Array,
) -> int:  # fmt: skip
    """Write lower bounds of the distances of pairs whose axes separate them; list the other pairs.

    Parameters
    ----------
    places : ndarray, shape (b, 4, 3)
        Placements of the bodies: columns of the rotation, then the origin.
    frame : ndarray of int, shape (s,)
        The place of each shape's body in `places`; -1 for the world.
    fixed : ndarray, shape (s, 4, 3)
        Placements of the shapes in their bodies.
    sizes, points, first_point : ndarray, shapes (s, 8), (k, 3), (s + 1,)
        The shapes' supports; the points of all shapes, and the first point of each shape.
    sides : ndarray of int, shape (n, 2)
        The shapes of each pair.
    axis : ndarray, shape (n, 3)
        Unit vectors from the first shape to the second, in the first's body; NaN where none is known.
    candidates : ndarray of int, shape (d,)
        The pairs.
    tolerance : float
        Gap at and below which a pair is active [m].
    bound : ndarray, shape (n,)
        Receives the bounds of the pairs that are separated by more than the tolerance [m].
    unresolved : ndarray of int, shape (d,)
        Receives the other pairs, in its first places.

    Returns
    -------
    int
        How many other pairs there are.
    """
    count = 0
    n, back, world = np.empty(3), np.empty(3), np.empty((2, 4, 3))
    for i in range(len(candidates)):
        pair = candidates[i]
        for side in range(2):
            s = sides[pair, side]
            if frame[s] < 0:
                for c in range(3):
                    for k in range(4):
                        world[side, k, c] = fixed[s, k, c]
                    if side == 0:
                        n[c] = axis[pair, c]
                continue
            P = places[frame[s]]
            for c in range(3):
                for k in range(4):
                    world[side, k, c] = fixed[s, k, 0] * P[0, c] + fixed[s, k, 1] * P[1, c] + fixed[s, k, 2] * P[2, c]
                world[side, 3, c] += P[3, c]
                if side == 0:
                    n[c] = axis[pair, 0] * P[0, c] + axis[pair, 1] * P[1, c] + axis[pair, 2] * P[2, c]
        a, b = sides[pair, 0], sides[pair, 1]
        back[0], back[1], back[2] = -n[0], -n[1], -n[2]
        gap = -_reach(world[1], back, sizes[b], points, first_point[b], first_point[b + 1])
        gap -= _reach(world[0], n, sizes[a], points, first_point[a], first_point[a + 1])
        if gap > tolerance:
            bound[pair] = gap
        else:
            # also where the axis is NaN
            unresolved[count] = pair
            count += 1
    return count


@kernel("void(f8[:,:,::1], i8[::1], i8[:,::1], f8[:,::1], i8[::1], f8[:,::1])")
def _keep(places: Array, frame: Array, sides: Array, axis: Array, pairs: Array, normals: Array) -> None:
    """Write normals, shape (k, 3), as the axes of some pairs; the other arguments as of `_clear`."""
    for i in range(len(pairs)):
        body = frame[sides[pairs[i], 0]]
        for c in range(3):
            x = normals[i, c]
            if body >= 0:
                x = 0.0
                for k in range(3):
                    x += places[body, c, k] * normals[i, k]
            axis[pairs[i], c] = x


class SeparatingAxes:
    """One axis for each pair: the normal of its last measured distance.

    Parameters
    ----------
    shapes : sequence of PlacedShape
        The shapes.
    sides : ndarray of int, shape (n, 2)
        The two shapes of each pair.

    Attributes
    ----------
    bodies : ndarray of int
        The bodies other than the world, ascending: methods expect their placements in this order.
    frame : ndarray of int
        The place of each shape's body in `bodies`; -1 for the world.
    supports : tuple of ndarray
        `frame`, then `fixed`, `sizes`, `points` and `first_point` of `_clear`.
    """

    def __init__(self, shapes: Sequence[PlacedShape], sides: Array) -> None:
        moving = sorted({s.body for s in shapes if s.body})
        self.bodies = np.array(moving, dtype=np.int64)
        self.frame = np.array([moving.index(s.body) if s.body else -1 for s in shapes], dtype=np.int64)
        self._sides = sides
        self._fixed = np.array([np.vstack([s.rotation.T, s.position]) for s in shapes]).reshape(-1, 4, 3)
        supports = [_support(s.shape) for s in shapes]
        self._sizes = np.array([[*s.box, s.ball, s.disk, *s.ellipsoid] for s in supports]).reshape(-1, 8)
        self._points = np.concatenate([np.zeros((0, 3)), *(s.points for s in supports)])
        self._first_point = np.cumsum([0, *(len(s.points) for s in supports)])
        # the arguments that kernels share
        self.supports = self.frame, self._fixed, self._sizes, self._points, self._first_point
        self._axis = np.full((len(sides), 3), np.nan)

    def clear(self, places: Array, candidates: Array, tolerance: float, bound: Array) -> Array:
        """Return the candidates that their axes do not separate; write lower bounds of the distances of the others.

        `places`, shape (b, 4, 3), are the placements of `bodies`.
        """
        unresolved = np.empty(len(candidates), np.int64)
        count = _clear(
            places, self.frame, self._fixed, self._sizes, self._points, self._first_point,
            self._sides, self._axis, candidates, tolerance, bound, unresolved,
        )  # fmt: skip
        return unresolved[:count]

    def keep(self, places: Array, pairs: Array, normals: Array) -> None:
        """Keep measured normals, shape (k, 3), as the axes of some pairs."""
        _keep(places, self.frame, self._sides, self._axis, pairs, normals)

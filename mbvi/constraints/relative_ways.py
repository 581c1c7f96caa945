"""How far the bodies of a pair move relative to each other along a displacement: bounds that no uniform motion changes.

The reach of a pair adds the ways of both bodies. What both have in common does not change their distance: it depends on
the velocities of one of them as the other one sees them.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ..compiled import kernel
from ..geometry.shapes.shape_table import ShapeTable
from ..system import System
from ..system.parts import first_components
from .features.feature_motion import places_of
from .rows import Array

# angle below which velocities at the start of a displacement say how fast bodies move along it [rad]
MOST_TURNED = 0.5
# angle that both bodies together turn in the part of a displacement for which an `Approach` holds [rad]
_PART_TURNED = 0.25
# relative to the sum of the ways of both bodies, more than the rounding of their difference
_ROUNDING = 1e-9
# points beside the middle of a ball, and directions, along which its relative velocity and rotation are measured
_ASIDE = np.array([[0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 1, 0], [1, 0, 0], [1, 0, 0]], dtype=float)
_ALONG = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 1], [0, 0, 1], [0, 1, 0]], dtype=float)


class PairBalls(NamedTuple):
    """Balls fixed to the bodies of pairs: the points of the second body that count are in its ball.

    Attributes
    ----------
    bodies : ndarray of int, shape (2, k)
        The first and the second body of each pair.
    centres : ndarray, shape (2, k, 3)
        Their middles in the frames of the bodies [m].
    radius : ndarray, shape (k,)
        Radii of those of the second bodies [m].
    """

    bodies: Array
    centres: Array
    radius: Array


def balls_of_sides(table: ShapeTable, sides: Array) -> PairBalls:
    """Return the balls of pairs of shapes, shape (k, 2): the second is the smaller one, the world is no second."""
    size = np.where(table.body > 0, table.bound, np.inf)[sides]
    first, second = np.where((size[:, 0] < size[:, 1])[:, None], sides[:, ::-1], sides).T
    bodies, centres = (np.stack([part[first], part[second]]) for part in (table.body, table.arrays[1][:, 3]))
    return PairBalls(bodies, centres, table.bound[second])


@kernel("f8(f8, f8, f8, f8, f8, f8, f8)")
def bounded_way(
    slip: float, spin: float, radius: float, apart: float, way: float, turned: float, turning: float
) -> float:  # fmt: skip
    """Return a bound of |df/dx| of the distance f of two bodies at each part x of a displacement [m].

    Parameters
    ----------
    slip : float
        How far the displacement carries the middle of the second body's ball past the first body, at x = 0 [m].
    spin : float
        By how much it turns the second body relative to the first one, at x = 0 [rad].
    radius, apart : float
        Radius of that ball, and the distance of the middles of both balls at x = 0 [m].
    way : float
        Sum of the ways of both bodies along velocities that move only one of them [m]; a bound as well.
    turned : float
        The same of velocities whose directions in the world may turn.
    turning : float
        By how much both bodies turn together along them [rad].

    Notes
    -----
    The distance changes by the velocity of a point of the second body in the frame of the first one. Let r be that of
    its middle, W = `turning`, L = `turned`, and D the distance of the middles. Along constant velocities
    |dr/dx| <= 2 W (L + W D) + W |r|, because points accelerate by at most 2 W L; where free bodies move as nothing acts
    on them (`coast`) it is at most twice that, if W is below `MOST_TURNED`. So |r| <= (|r(0)| + 4 W (L + W D)) e^(2 W),
    and e^x <= 1 / (1 - x).
    """
    if not turning < MOST_TURNED:
        return way
    bend = 4.0 * turning * (turned + turning * (apart + way + radius))
    return min(way, (slip + radius * spin + bend) / (1.0 - 2.0 * turning) + _ROUNDING * way)


@kernel("void(f8[:,::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1])")
def lessen_ways(
    rates: Array, radius: Array, apart: Array, turned: Array, turning: Array, way: Array, found: Array
) -> None:
    """Write the bounds of `bounded_way` of k pairs; `rates`, shape (k, 6), are along `_ALONG` at `_ASIDE`."""
    for i in range(len(way)):
        x, y, z = rates[i, 0], rates[i, 1], rates[i, 2]
        a, b, c = rates[i, 3] - z, rates[i, 4] - z, rates[i, 5] - y
        slip, spin = np.sqrt(x * x + y * y + z * z), np.sqrt(a * a + b * b + c * c)
        found[i] = bounded_way(slip, spin, radius[i], apart[i], way[i], turned[i], turning[i])


def shared_lengths(system: System, v: Array) -> Array:
    """Return |v|, shape (nv,), where components of a vector share its length equally: sums depend on no frame."""
    first, n = first_components(system), system.nv
    return (np.sqrt(np.bincount(first, v * v, n)) / np.maximum(np.bincount(first, minlength=n), 1))[first]


def ways_of(system: System, displacement: Array, reach: Any) -> tuple[Array, Array, Array]:
    """Return `way`, `turned` and `turning` of `bounded_way` of pairs of that reach, shape (nv, k), each (k,)."""
    far, turns = shared_lengths(system, displacement), ~system.are_lengths()
    return far @ reach, np.where(system.go_straight(), 0.0, far) @ reach, (far * turns) @ (reach != 0.0)


def relative_ways(
    system: System, q: Array, displacement: Array, ways: tuple[Array, Array, Array], balls: PairBalls
) -> Array:  # fmt: skip
    """Return bounds of how far the bodies of pairs move relative to each other, shape (k,) [m].

    No gap changes by more than a share of it along the same share of the displacement.

    Parameters
    ----------
    system : System
        What moves the bodies.
    q, displacement : ndarray, shapes (nq,) and (nv,)
        Configuration, and the tangent vector along which it moves.
    ways : tuple of ndarray
        What `ways_of` returns.
    balls : PairBalls
        What of the bodies counts.
    """
    k, (way, turned, turning) = len(balls.radius), ways
    if not k:
        return way
    places = places_of(system, q, balls.bodies.ravel())
    first, second = (np.vecmat(balls.centres.reshape(-1, 3), places[:, :3]) + places[:, 3]).reshape(2, k, 3)
    # what stands still does not turn
    apart = np.where(balls.bodies[0] > 0, np.linalg.norm(second - first, axis=1), 0.0)
    points, along = (second[:, None] + _ASIDE).reshape(-1, 3), np.tile(_ALONG, (k, 1))
    bodies = balls.bodies.repeat(6, axis=1)
    rows = system.separation_rows(q, bodies[0], bodies[1], points, along)
    rates, found = np.ascontiguousarray((rows @ displacement).reshape(k, 6)), np.empty(k)
    lessen_ways(rates, balls.radius, apart, turned, turning, way, found)
    return found


class Approach(NamedTuple):
    """The gap of a pair at one place of a displacement, and how far it falls at most from there.

    After each further part x <= `share` of the displacement it is at least gap + slope x - bend x^2 / 2, and at least
    gap - most x.
    """

    gap: float
    slope: float
    bend: float
    most: float
    share: float

    def free(self, fall: float) -> float:
        """Return a part of the displacement, at most `share`, in which the gap falls by no more than `fall` >= 0."""
        if fall >= self.most * self.share:
            return self.share
        root = (self.slope * self.slope + 2.0 * self.bend * fall) ** 0.5
        # the root of the parabola, without differences of nearly equal numbers where it falls from the start
        ahead = 2.0 * fall / (root - self.slope) if root > self.slope else np.inf
        return min(self.share, max(ahead, fall / self.most))


def steady_approach(gap: float, travel: float) -> Approach:
    """Return what is known of a gap that changes by no more than `travel` along a displacement."""
    return Approach(gap, -travel, 0.0, travel, 1.0)


def pair_approach(
    system: System, balls: PairBalls, reach: Array, q: Array, displacement: Array, gap: float, normal: Array
) -> Approach:
    """Return how far the gap of a pair of convex bodies may fall along a displacement.

    Parameters
    ----------
    system : System
        What moves the bodies.
    balls : PairBalls
        What of the bodies counts, of one pair.
    reach : ndarray, shape (nv,)
        The reach of the pair.
    q, displacement : ndarray, shapes (nq,) and (nv,)
        Configuration, and the tangent vector along which it moves.
    gap : float
        The distance at q [m].
    normal : ndarray, shape (3,)
        The direction from the first to the second ball along which the bodies are as far apart.

    Notes
    -----
    Seen from the first body, the second one is at least as far away as along any direction fixed to the first, such as
    the normal at q. Along it each point of the second ball moves at least at the rate n . r - rho |n x w|, with
    the velocity r of its middle and the relative angular velocity w at q. Velocities as the first body sees them change
    at most at the rate A + 2 V U: A = 2 W L + 2 V W D bounds accelerations (see `bounded_way`), U velocities, and V is
    by how much the first body turns. Where free bodies move as nothing acts on them, A is at most twice that, and V
    grows by no more than a third.
    """
    body, radius, far = int(balls.bodies[0, 0]), float(balls.radius[0]), shared_lengths(system, displacement)
    way, turned, turning = (float(one) for one in ways_of(system, displacement, reach))
    of_first = 0.0
    if body > 0:
        of_first = float(far @ (~system.are_lengths() & (reach * system.reach(body, np.zeros(3), 1.0) != 0.0)))
    share = min(1.0, _PART_TURNED / turning) if turning > 0.0 else 1.0
    places = places_of(system, q, balls.bodies.ravel())
    first, second = np.vecmat(balls.centres[:, 0], places[:, :3]) + places[:, 3]
    bodies = balls.bodies.repeat(6, axis=1)
    rows = system.separation_rows(q, bodies[0], bodies[1], second + _ASIDE, _ALONG)
    x, y, z, a, b, c = (rows @ displacement).tolist()
    a, b, c = a - z, z - b, c - y
    u, v, w = normal.tolist()
    bend, turn = turning * turned + of_first * turning * (math.dist(first, second) + radius), 2.0 * share * turning
    most = math.hypot(x, y, z) + radius * math.hypot(a, b, c) + 4.0 * share * bend
    # the middles part by no more than share * most
    most = min(way, most / (1.0 - turn - turn * turn) + _ROUNDING * way)
    bend += of_first * turning * share * most
    across = math.hypot(v * c - w * b, w * a - u * c, u * b - v * a)
    slope = u * x + v * y + w * z - radius * across - _ROUNDING * way
    return Approach(gap, slope, 4.0 * bend + 3.0 * of_first * most, most, share)

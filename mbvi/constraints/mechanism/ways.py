"""How far the bodies of a pair of one mechanism move relative to each other, as `relative_ways` has it, in a kernel."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...compiled import kernel, record
from ...system import System
from ...system.mechanisms.mechanism import Mechanism
from ...system.parts import first_components
from ..family import ConstraintFamily
from ..relative_ways import PairBalls, bounded_way
from ..rows import Array
from .tables import PairFamily


@record("i8[:,::1], f8[:,:,::1], f8[::1], b1[::1], b1[::1], i8[::1]")
class PairWays(NamedTuple):
    """What the kernel needs of n pairs beside `PairFamily`.

    Attributes
    ----------
    bodies, centres, radius
        See `PairBalls`.
    straight, turns : ndarray of bool, shape (nv,)
        Velocities whose directions stay, and those of turns.
    vectors : ndarray of int, shape (nv,)
        See `first_components`.
    """

    bodies: Array
    centres: Array
    radius: Array
    straight: Array
    turns: Array
    vectors: Array


def pair_ways(system: System, families: Sequence[ConstraintFamily], numbers: Sequence[Array]) -> PairWays:
    """Return what the kernel needs of some pairs of some families, one after the other; of none without balls."""
    found = [PairBalls(np.zeros((2, 0), np.int64), np.zeros((2, 0, 3)), np.zeros(0))]
    for family, some in zip(families, numbers, strict=True):
        k = len(some)
        nothing = PairBalls(np.zeros((2, k), np.int64), np.zeros((2, k, 3)), np.zeros(k))
        found.append(family.balls_of(some) or nothing)
    bodies, centres, radius = zip(*found, strict=True)
    return PairWays(
        np.concatenate(bodies, axis=1), np.concatenate(centres, axis=1), np.concatenate(radius),
        system.go_straight(), ~system.are_lengths(), first_components(system),
    )  # fmt: skip


@kernel("Tuple((f8, f8, f8))(Mechanism, i8, f8[:,:,::1], i8, i8)")
def placed_centre(
    mechanism: Mechanism, body: int, centres: Array, side: int, pair: int
) -> tuple[float, float, float]:  # fmt: skip
    """Return where a body has its centre of a pair in the world."""
    poses, x, y, z = mechanism.poses, centres[side, pair, 0], centres[side, pair, 1], centres[side, pair, 2]
    return (
        x * poses[body, 0, 0] + y * poses[body, 1, 0] + z * poses[body, 2, 0] + poses[body, 3, 0],
        x * poses[body, 0, 1] + y * poses[body, 1, 1] + z * poses[body, 2, 1] + poses[body, 3, 1],
        x * poses[body, 0, 2] + y * poses[body, 1, 2] + z * poses[body, 2, 2] + poses[body, 3, 2],
    )


@kernel("f8(i8[::1], i8, f8[::1])")
def shared_length(vectors: Array, k: int, v: Array) -> float:
    """Return |v[k]|, or the share in the length of the vector that it is a component of; see `shared_lengths`."""
    first, square = vectors[k], 0.0
    end = first
    while end < len(v) and vectors[end] == first:
        square += v[end] * v[end]
        end += 1
    return np.sqrt(square) / (end - first)


@kernel("f8(Mechanism, PairFamily, i8, PairWays, i8, f8[::1], f8)")
def relative_way(
    mechanism: Mechanism, family: PairFamily, pair: int, ways: PairWays, column: int, displacement: Array, scale: float
) -> float:  # fmt: skip
    """Return a bound of how far the bodies of a pair move relative to each other [m]; see `relative_ways`.

    Parameters
    ----------
    mechanism : Mechanism
        Placed where the displacement begins.
    family, pair : PairFamily and int
        The pair.
    ways, column : PairWays and int
        Its place there.
    displacement : ndarray, shape (nv,)
        Tangent vector.
    scale : float
        By which it is multiplied.
    """
    first, second = ways.bodies[0, column], ways.bodies[1, column]
    support, columns = mechanism.support, mechanism.columns
    way = turned = turning = x = y = z = a = b = c = 0.0
    for i in range(family.begin[pair], family.begin[pair + 1]):
        k = family.velocity[i]
        moved = scale * displacement[k]
        length = scale * shared_length(ways.vectors, k, displacement)
        far = length * family.lever[i]
        way += far
        if not ways.straight[k]:
            turned += far
        if ways.turns[k]:
            turning += length
        moved *= support[second, k] - support[first, k]
        x, y, z = x + moved * columns[k, 0], y + moved * columns[k, 1], z + moved * columns[k, 2]
        a, b, c = a + moved * columns[k, 3], b + moved * columns[k, 4], c + moved * columns[k, 5]
    u, v, w = placed_centre(mechanism, second, ways.centres, 1, column)
    # the velocity of what is at the middle of the second ball
    x, y, z = x + b * w - c * v, y + c * u - a * w, z + a * v - b * u
    slip, spin, apart = np.sqrt(x * x + y * y + z * z), np.sqrt(a * a + b * b + c * c), 0.0
    if first > 0:
        x, y, z = placed_centre(mechanism, first, ways.centres, 0, column)
        apart = np.sqrt((u - x) ** 2 + (v - y) ** 2 + (w - z) ** 2)
    return bounded_way(slip, spin, ways.radius[column], apart, way, turned, turning)

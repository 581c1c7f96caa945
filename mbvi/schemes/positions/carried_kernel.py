"""A kernel of contact points that bodies carry from one configuration to another; see `carried_along`."""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ...constraints.carried import carry_points
from ...constraints.mechanism.rows import MechanismConstraints
from ...constraints.mechanism.tables import BALLS, HALF_SPACES, PAIRS, RowBuffer
from ...system.mechanisms.mechanism import place
from ...system.system import Array
from ..kernels.records import MechanismStep


@kernel("i8(MechanismConstraints, i8)")
def carrier_of(constraints: MechanismConstraints, number: int) -> int:
    """Return the first body of a constraint; 0 where one of its bodies is the world, and where it has none."""
    for k in range(len(constraints.cache.kind)):
        kind = constraints.cache.kind[k]
        if kind == PAIRS or kind == BALLS or kind == HALF_SPACES:
            family = constraints.pairs if kind == PAIRS else constraints.touching
            if kind == HALF_SPACES:
                family = constraints.walls
            pair = number - family.number[0] if len(family.number) > 0 else -1
            if 0 <= pair < len(family.number):
                return family.bodies[0, pair] if family.bodies[1, pair] > 0 else 0
    return 0


@kernel("void(MechanismStep, RowBuffer, b1[::1], f8[::1], f8[::1])")
def carry_along(s: MechanismStep, rows: RowBuffer, some: Array, before: Array, after: Array) -> None:
    """Move the points of some rows to where their bodies carry them; they stay where one body is the world.

    Parameters
    ----------
    s : MechanismStep
        Is placed at `after` then if any row is carried.
    rows : RowBuffer
        The rows.
    some : ndarray of bool, shape (m,)
        Which of them are meant.
    before, after : ndarray, shape (nq,)
        Where the points are, and where they are wanted.
    """
    m, poses, carried = rows.size[0], s.mechanism.poses, False
    body = np.zeros(m, np.int64)
    for a in range(m):
        body[a] = carrier_of(s.constraints, rows.number[a]) if some[a] else 0
        carried = carried or body[a] > 0
    if not carried:
        return
    place(s.mechanism, before)
    old = np.empty((m, 4, 3))
    for a in range(m):
        for r in range(4):
            for c in range(3):
                old[a, r, c] = poses[body[a], r, c]
    place(s.mechanism, after)
    for a in range(m):
        if body[a] > 0:
            point = rows.point[a : a + 1]
            carry_points(point, old[a : a + 1], poses[body[a] : body[a] + 1], point)

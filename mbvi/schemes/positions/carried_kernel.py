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


@kernel("i8(MechanismConstraints, i8, i8)")
def body_of(constraints: MechanismConstraints, number: int, side: int) -> int:
    """Return the first or the second body of a constraint; 0 where one is the world, and where it has none."""
    for k in range(len(constraints.cache.kind)):
        kind = constraints.cache.kind[k]
        if kind == PAIRS or kind == BALLS or kind == HALF_SPACES:
            family = constraints.pairs if kind == PAIRS else constraints.touching
            if kind == HALF_SPACES:
                family = constraints.walls
            pair = number - family.number[0] if len(family.number) > 0 else -1
            if 0 <= pair < len(family.number):
                other = family.bodies[1 - side, pair]
                return family.bodies[side, pair] if other > 0 else 0
    return 0


@kernel("void(MechanismStep, RowBuffer, b1[::1], f8[::1], f8[::1])")
def carry_along(s: MechanismStep, rows: RowBuffer, some: Array, before: Array, after: Array) -> None:
    """Move the points of some rows midway between where their bodies carry them, or with a wall that moves.

    They stay where one body is the world.

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
    # bodies beyond these are walls
    walls = len(s.scales.part_of_body)
    body = np.zeros((2, m), np.int64)
    for a in range(m):
        for side in range(2):
            body[side, a] = body_of(s.constraints, rows.number[a], side) if some[a] else 0
        if body[0, a] > walls:
            body[1, a] = body[0, a]
        carried = carried or body[0, a] > 0
    if not carried:
        return
    place(s.mechanism, before)
    old, found = np.empty((2, m, 4, 3)), np.empty((2, 3))
    for side in range(2):
        for a in range(m):
            for r in range(4):
                for c in range(3):
                    old[side, a, r, c] = poses[body[side, a], r, c]
    place(s.mechanism, after)
    for a in range(m):
        if body[0, a] > 0:
            for side in range(2):
                b = body[side, a]
                carry_points(rows.point[a : a + 1], old[side, a : a + 1], poses[b : b + 1], found[side : side + 1])
            for c in range(3):
                rows.point[a, c] = 0.5 * (found[0, c] + found[1, c])

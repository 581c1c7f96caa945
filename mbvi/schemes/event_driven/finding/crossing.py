"""Where the gap of a row of one mechanism falls through zero within a step, by Newton's method in one kernel."""

from __future__ import annotations

import numpy as np

from ....compiled import kernel
from ....constraints.mechanism.held_rows import RowParts, RowRoom, evaluate_row
from ....constraints.mechanism.pairs import PairShapes, place_bodies
from ....geometry.shapes.shape_table import Shapes  # noqa: F401  (a signature names it)
from ....system.mechanisms.mechanism import place
from ....system.mechanisms.separation import row as separation_row
from ....system.system import Array
from ..rows.known_pairs import nearest_contact
from ..stages import SmoothMotion, state_at


@kernel("f8(SmoothMotion, RowParts, RowRoom, Tuple(Shapes), PairShapes, i8[:,::1], i8, i8, f8[::1], f8[::1])")
def write_gradient_at(
    s: SmoothMotion, parts: RowParts, room: RowRoom, tables: tuple[Array, ...], shapes: PairShapes, bodies: Array,
    row: int, pair: int, q: Array, J: Array,
) -> float:  # fmt: skip
    """Write the gradient of a row, or of the distance of a pair unless that is negative, at q; return its gap.

    Parameters
    ----------
    s, parts, tables, shapes
        See `gaps_at_share`.
    room : RowRoom
        Room.
    bodies : ndarray of int, shape (2, n)
        The bodies of all pairs.
    row, pair : int
        The row, and its pair.
    q : ndarray, shape (nq,)
        The configuration.
    J : ndarray, shape (nv,)
        Receives the gradient.
    """
    m = s.mechanism
    place(m, q)
    if pair < 0:
        return evaluate_row(m, parts.kind[row], parts.sides[row], parts.parts[row], parts.radius[row], q, room, J)
    place_bodies(m, shapes)
    gap = nearest_contact(tables, shapes, pair, np.inf, room.point, room.normal)
    separation_row(m.columns, m.support[bodies[0, pair]], m.support[bodies[1, pair]], room.point, room.normal, J)
    return gap


@kernel(
    "f8(SmoothMotion, RowParts, RowRoom, Tuple(Shapes), PairShapes, i8[:,::1], i8, i8, f8[:,:,::1], f8, f8,"
    " Array(f8, 1, 'C', True), Array(f8, 1, 'C', True), f8, f8, i8)"
)
def crossing_share(
    s: SmoothMotion, parts: RowParts, room: RowRoom, tables: tuple[Array, ...], shapes: PairShapes, bodies: Array,
    row: int, pair: int, dense: Array, h: float, share: float, q: Array, v: Array, least: float, most: float,
    turns: int,
) -> float:  # fmt: skip
    """Return the share of a step at which a gap falls through zero, by Newton's method from the given share.

    Parameters
    ----------
    s, parts, room, tables, shapes, bodies, row, pair
        See `write_gradient_at`.
    dense, h, q, v
        The dense output, the length and the first state of the step.
    share : float
        Where to begin.
    least : float
        Size of a gap that is small enough [m or rad].
    most : float
        The largest share.
    turns : int
        Most steps of Newton's method.
    """
    J = np.empty(len(v))
    for _ in range(turns):
        state_at(s, dense, h, share, q, v)
        gap, rate = write_gradient_at(s, parts, room, tables, shapes, bodies, row, pair, s.q, J), 0.0
        for k in range(len(v)):
            rate += J[k] * s.v[k]
        if abs(gap) < least or rate >= 0.0:
            break
        late = -gap / rate
        if not 0.0 < share * h + late <= most * h:
            break
        share += late / h
    return share

"""Kernels that keep rows found at one configuration, and search them again where gaps are not linear; see `NearbyRows`.

Rows are known in `ahead` of a step: found at `room.end` within the tolerance and `room.margin`. `room.gap` has their
gaps at the last configuration in question, and `room.near` those that count there.
"""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ...constraints.mechanism.rows import active_rows
from ...constraints.mechanism.tables import FOUND, RowBuffer, copy_row, rows_for
from ...constraints.rows import mutual_nearest
from ...projection.positions.travel import largest_travel
from ...system.mechanisms.pinocchio_address import tangent
from ...system.system import Array
from ..kernels.records import MechanismStep


@kernel("void(RowBuffer, RowBuffer)")
def copy_rows(rows: RowBuffer, others: RowBuffer) -> None:
    """Copy rows in the place of others."""
    others.size[0] = 0
    for a in range(rows.size[0]):
        copy_row(rows, a, others)


@kernel("RowBuffer(RowBuffer)")
def copy_of(rows: RowBuffer) -> RowBuffer:
    """Return a copy of rows."""
    others = rows_for(rows.size[0], rows)
    copy_rows(rows, others)
    return others


@kernel("void(RowBuffer, RowBuffer, i8[::1])")
def match_rows(rows: RowBuffer, others: RowBuffer, owner: Array) -> None:
    """Find for each row the same contact among others, shape (k,), -1 where there is none; see `match_contacts`."""
    m = others.size[0]
    order, number = np.empty(m, np.int64), others.number
    for i in range(m):
        # most often they ascend already
        j = i
        while j > 0 and number[order[j - 1]] > number[i]:
            order[j] = order[j - 1]
            j -= 1
        order[j] = i
    k = rows.size[0]
    mutual_nearest(rows.number[:k], rows.point[:k], number[:m], others.point[:m], order, owner)


@kernel("f8(MechanismStep, f8[::1])")
def known_gaps(s: MechanismStep, place: Array) -> float:
    """Write the gaps of the known rows at a place to first order (`room.gap`); return the travel to it [m]."""
    known, gap, displacement = s.ahead, s.room.gap, s.room.displacement
    tangent(s.mechanism.calls, s.room.end, place, displacement)
    for a in range(known.size[0]):
        change = 0.0
        for k in range(len(displacement)):
            change += known.J[a, k] * displacement[k]
        gap[a] = known.gap[a] + change
    return largest_travel(s.scales.squares, displacement)


@kernel("b1(MechanismStep, f8[::1], f8)")
def are_known(s: MechanismStep, place: Array, margin: float) -> bool:
    """Write the gaps at a place to first order; return whether these are all rows within a margin there [m]."""
    reach = s.scales.reach
    if not reach > 0.0:
        return False
    travel = known_gaps(s, place)
    return travel <= reach and margin + travel <= s.room.margin[0]


@kernel("i8(MechanismStep, f8[::1], f8)")
def find_nearby(s: MechanismStep, place: Array, margin: float) -> int:
    """Find the rows at a place within the tolerance and a margin [m]; return a code."""
    known, room, scales = s.ahead, s.room, s.scales
    if not are_known(s, place, margin):
        room.margin[0] = margin + 2.0 * scales.reach
        within = scales.tolerance + room.margin[0]
        code = active_rows(s.mechanism, s.constraints, s.q[:0], room.displacement, place, within, known)
        if code != FOUND:
            return code
        for j in range(len(place)):
            room.end[j] = place[j]
        for a in range(known.size[0]):
            room.gap[a] = known.gap[a]
    for a in range(known.size[0]):
        room.near[a] = known.lever[a] * room.gap[a] <= scales.tolerance + margin
    return FOUND


@kernel("RowBuffer(MechanismStep)")
def nearby_rows(s: MechanismStep) -> RowBuffer:
    """Return the rows that `find_nearby` found, with their gaps."""
    known, count = s.ahead, 0
    for a in range(known.size[0]):
        count += s.room.near[a]
    rows = rows_for(count, known)
    for a in range(known.size[0]):
        if s.room.near[a]:
            copy_row(known, a, rows)
            rows.gap[rows.size[0] - 1] = s.room.gap[a]
    return rows


@kernel("b1(MechanismStep)")
def may_sink(s: MechanismStep) -> bool:
    """Return whether a gap at the end of the step may be below zero by more than the tolerance."""
    if not are_known(s, s.q, 0.0):
        return True
    for a in range(s.ahead.size[0]):
        if s.ahead.lever[a] * s.room.gap[a] < -s.scales.tolerance:
            return True
    return False

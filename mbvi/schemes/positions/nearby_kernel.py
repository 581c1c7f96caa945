"""Kernels that keep rows found at one configuration, and search them again where gaps are not linear; see `NearbyRows`.

Rows are known in `ahead` of a step: found at `room.end` within the tolerance and `room.margins`. `room.gap` has their
gaps at the last configuration in question, and `room.near` those that count there.
"""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ...constraints.mechanism.rows import active_rows
from ...constraints.mechanism.tables import FOUND, RowBuffer, copy_row, rows_for
from ...constraints.rows import mutual_nearest
from ...projection.positions.travel import write_largest_of_parts, write_travels_of_parts
from ...system.mechanisms.by_address.pinocchio_address import tangent
from ...system.mechanisms.mechanism import carry
from ...system.system import Array
from ..kernels.records import MechanismStep
from .nearby_rows import mark_unknown


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


@kernel("void(MechanismStep, f8[::1])")
def known_gaps(s: MechanismStep, place: Array) -> None:
    """Write the gaps of the known rows at a place to first order (`room.gap`), and the displacement to it."""
    known, gap, displacement = s.ahead, s.room.gap, s.room.displacement
    tangent(s.mechanism.calls, s.room.end, place, displacement)
    for a in range(known.size[0]):
        change = 0.0
        for k in range(len(displacement)):
            change += known.J[a, k] * displacement[k]
        gap[a] = known.gap[a] + change


@kernel("b1(MechanismStep, f8[::1], f8[::1], b1[::1])")
def are_known(s: MechanismStep, place: Array, margins: Array, unknown: Array) -> bool:
    """Write the gaps at a place to first order; return whether these are all rows within the margins there.

    `margins` [m] and `unknown`, shape (parts,), are as of `mark_unknown`.
    """
    known_gaps(s, place)
    travels = np.empty(len(margins))
    write_travels_of_parts(s.scales.squares, s.room.displacement, s.scales.part, travels)
    return not mark_unknown(travels, s.scales.reach, margins, s.room.margins, unknown)


@kernel("void(MechanismStep, f8[::1], f8[::1], b1[::1])")
def move_parts(s: MechanismStep, place: Array, margins: Array, some: Array) -> None:
    """Move some parts to a place, in `room.end`, and take their margins."""
    room, part, moved, every = s.room, s.scales.part, place.copy(), True
    for p in range(len(some)):
        every = every and some[p]
        if some[p]:
            room.margins[p] = margins[p]
    if not every:
        for k in range(len(part)):
            if not some[part[k]]:
                room.displacement[k] = 0.0
        carry(s.mechanism, room.end, room.displacement, moved)
    for j in range(len(place)):
        room.end[j] = moved[j]


@kernel("i8(MechanismStep)")
def search_nearby(s: MechanismStep) -> int:
    """Find the rows at `room.end` within the tolerance, twice the reach and their margins; return a code."""
    rows, room, scales, most = s.ahead, s.room, s.scales, 0.0
    margins = room.margins + (2.0 if scales.projects else 0.0) * scales.reach
    for p in range(len(margins)):
        most = max(most, margins[p])
    within = scales.tolerance + most
    code = active_rows(s.mechanism, s.constraints, s.q[:0], room.displacement, room.end, within, rows)
    if code != FOUND or len(margins) == 1:
        return code
    count, own = rows.size[0], np.empty(rows.size[0])
    write_largest_of_parts(rows.J, scales.part, margins, own)
    rows.size[0] = 0
    for a in range(count):
        if rows.lever[a] * rows.gap[a] <= scales.tolerance + own[a]:
            copy_row(rows, a, rows)
    return code


@kernel("i8(MechanismStep, f8[::1], f8[::1])")
def find_nearby(s: MechanismStep, place: Array, margins: Array) -> int:
    """Find the rows at a place within the tolerance and their margins, shape (parts,) [m]; return a code."""
    known, room, unknown = s.ahead, s.room, np.empty(len(margins), np.bool_)
    if not are_known(s, place, margins, unknown):
        move_parts(s, place, margins, unknown)
        code = search_nearby(s)
        if code != FOUND:
            return code
        known_gaps(s, place)
    own = np.empty(known.size[0])
    write_largest_of_parts(known.J, s.scales.part, margins, own)
    for a in range(known.size[0]):
        room.near[a] = known.lever[a] * room.gap[a] <= s.scales.tolerance + own[a]
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
    parts = len(s.room.margins)
    if not are_known(s, s.q, np.zeros(parts), np.empty(parts, np.bool_)):
        return True
    for a in range(s.ahead.size[0]):
        if s.ahead.lever[a] * s.room.gap[a] < -s.scales.tolerance:
            return True
    return False

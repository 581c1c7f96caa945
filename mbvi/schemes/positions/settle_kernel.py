"""Projects closed contacts out of penetration in one kernel: what `project_positions` does, which is its reference."""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ...constraints.mechanism.rows import write_gradients
from ...constraints.mechanism.tables import FOUND, MOST_ROWS, TOO_MANY, RowBuffer, copy_row, rows_for
from ...constraints.tangents import write_along_axes
from ...projection.dense.orthonormal_rows import inner
from ...projection.positions.closed_contacts import stays_sunk
from ...projection.positions.travel import MOST_LINEARISATIONS, NEARBY, write_largest_of_rows
from ...projection.tree_factor import keep_equalities
from ...system.free.free_momentum import keep_momentum_of_rows
from ...system.mechanisms.mechanism import glide, place
from ...system.system import Array
from ..kernels.phases import add_across, keep_those_at, write_rates_at
from ..kernels.records import DONE, MechanismStep
from .bounds_kernel import apply_bounds
from .carried_kernel import carry_along
from .closed_kernel import bears_or_sinks, closed_contacts, sticking_contacts
from .corrections import correct_displaced, correct_turn
from .displacement_kernel import IMPOSSIBLE, Sunk, raise_sunk
from .free_impulses import acts_on_free_bodies, start_of_tangent_law
from .moved_groups import keep_the_rest_of_law
from .nearby_kernel import copy_rows, find_nearby, known_gaps, match_rows, may_sink, nearby_rows


@kernel("void(MechanismStep, f8)")
def advance_gaps(s: MechanismStep, time: float) -> None:
    """Advance the gaps of the law's rows by a time at the rates after the law."""
    k = s.rows.size[0]
    for a in range(k):
        s.rows.gap[a] += time * s.rates[2 * k + a]


@kernel("void(MechanismStep, f8)")
def glide_to_end(s: MechanismStep, half: float) -> None:
    """Move from the middle of a step to its end, `s.q`, at the velocity after the law; that there is `room.after`."""
    glide(s.mechanism, s.room.middle, s.v, half, s.room.drift, s.q, s.room.after)


@kernel("void(MechanismStep)")
def take_velocity_of_end(s: MechanismStep) -> None:
    """Write the velocity at the end of a step in the place of that after the law."""
    for k in range(len(s.v)):
        s.v[k] = s.room.after[k]


@kernel("b1(MechanismStep, f8[::1], f8, RowBuffer, f8[::1], f8[::1])")
def write_floor(s: MechanismStep, v: Array, h: float, active: RowBuffer, floor: Array, depths: Array) -> bool:
    """Write the lower bounds of gaps at the end of the step; return whether a closed contact must move out.

    Parameters
    ----------
    s : MechanismStep
        With the closed rows of the law, and what these are at the end (`middle`).
    v : ndarray, shape (nv,)
        The velocity before the law.
    h : float
        Length of the step [s].
    active : RowBuffer
        The active rows at the end.
    floor, depths : ndarray, shape (m,)
        Receive the bounds, and how far each row must move out [m].
    """
    m, tolerance, some = active.size[0], s.scales.tolerance, False
    owner = np.empty(m, np.int64)
    match_rows(active, s.middle, owner)
    for a in range(m):
        length = active.lever[a] * active.gap[a]
        rise, fall = h * active.lever[a] * inner(active.J[a], s.v), h * active.lever[a] * inner(active.J[a], v)
        # bounds below zero by no more than the tolerance stay: they would contradict each other by their rounding
        sunk = owner[a] >= 0 and s.room.closed[owner[a]] and length < -tolerance
        sunk = sunk or stays_sunk(-length, rise, fall, active.e[a], tolerance)
        floor[a] = 0.0 if sunk else min(active.gap[a], 0.0)
        depths[a] = -length if sunk else 0.0
        some = some or depths[a] > tolerance
    return some


@kernel("b1(MechanismStep, RowBuffer, i8)")
def may_bounce(s: MechanismStep, rows: RowBuffer, a: int) -> bool:
    """Return whether row a acts on a part with a contact that may bounce (`room.bouncing`)."""
    for k in range(len(s.scales.part)):
        if rows.J[a, k] != 0.0 and s.room.bouncing[s.scales.part[k]] > 0.0:
            return True
    return False


@kernel("void(MechanismStep, f8)")
def mark_rows(s: MechanismStep, half: float) -> None:
    """Write what the rows of the law are at the end of the step (`middle`), where they are known.

    `half` is the time from the law to there [s].
    """
    rows, marks, known, k, m = s.rows, s.middle, s.ahead, s.rows.size[0], s.ahead.size[0]
    owner, bounces = np.empty(m, np.int64), np.empty(k, np.bool_)
    for i in range(k):
        bounces[i] = may_bounce(s, rows, i)
        if bounces[i]:
            marks.size[0] = i
            copy_row(rows, i, marks)
        # what is not found there has the gap that the law leads to
        marks.gap[i] = rows.gap[i] + half * s.rates[2 * k + i]
    marks.size[0] = k
    carry_along(s, marks, bounces, s.room.middle, s.q)
    if bounces.all():
        return
    known_gaps(s, s.q)
    match_rows(known, marks, owner)
    for a in range(m):
        if owner[a] >= 0 and not may_bounce(s, known, a):
            marks.size[0] = owner[a]
            copy_row(known, a, marks)
            marks.gap[owner[a]] = s.room.gap[a]
    marks.size[0] = k


@kernel("i8(MechanismStep, f8[::1], f8, RowBuffer, i8[::1], f8[::1], i8)")
def join_law(
    s: MechanismStep, v: Array, half: float, near: RowBuffer, owner: Array, moved: Array, count: int
) -> int:  # fmt: skip
    """Add rows that are active only after the projection to those of the law, and apply it again; return a code.

    Parameters
    ----------
    s, v
        See `project_positions`.
    half : float
        The time from the law to the end of the step [s].
    near : RowBuffer
        The rows after the projection.
    owner : ndarray of int, shape (m,)
        For each of them the row of the law, -1 where there is none.
    moved : ndarray, shape (nv,)
        The displacement.
    count : int
        How many rows the law had first.
    """
    rows, marks, slack, k = s.rows, s.middle, s.room.opened, s.rows.size[0]
    for a in range(near.size[0]):
        if owner[a] < 0:
            if rows.size[0] == MOST_ROWS:
                return TOO_MANY
            i = rows.size[0]
            copy_row(near, a, marks)
            copy_row(near, a, rows)
            # open where the law acts, it may close by the end of the step: otherwise it would bear load there
            gap = near.gap[a] - half * inner(near.J[a], s.v) - inner(near.J[a], moved)
            slack[i] = max(gap, 0.0) / half
            rows.gap[i] = half * slack[i]
    carry_along(s, rows, np.arange(rows.size[0]) >= k, s.room.end, s.room.middle)
    if len(s.bodies.mass) > 0:
        place(s.mechanism, s.room.middle)
        for i in range(k, rows.size[0]):
            if acts_on_free_bodies(s, rows, i):
                write_gradients(s.mechanism, s.constraints, rows, i)
    lower = np.empty(rows.size[0])
    for i in range(len(lower)):
        before = inner(rows.J[i], v)
        lower[i] = -rows.e[i] * before
        # rows of the law keep their bounds; those that join it do not bounce
        if i >= count or (slack[i] > 0.0 and before > -slack[i]):
            lower[i] = min(lower[i], -slack[i])
    code = apply_bounds(s, rows, v, s.room.free, lower, 2.0 * half)
    if code == DONE:
        if len(s.mechanism.equalities.gap) > 0:
            add_across(s)
        glide_to_end(s, half)
    else:
        # the law is solved for the rows before
        rows.size[0] = k
    return code


@kernel("i8(MechanismStep, f8[::1], f8, Sunk, RowBuffer, i8[::1])")
def follow(s: MechanismStep, v: Array, half: float, sunk: Sunk, near: RowBuffer, owner: Array) -> int:
    """Take the projected configuration, with a velocity tangent to its closed contacts; return a code.

    Parameters
    ----------
    s : MechanismStep
        With the state at the end of the step; `middle` has the rows of the law with what they are after the projection.
    v : ndarray, shape (nv,)
        The velocity before the law.
    half : float
        Time from the end of the step to the next law [s].
    sunk : Sunk
        The projected configuration.
    near : RowBuffer
        The rows there.
    owner : ndarray of int, shape (m,)
        The row of the law of each.
    """
    marks, room, k, m, i = s.middle, s.room, s.rows.size[0], near.size[0], near.size[0]
    there, order, left = rows_for(k, marks), np.empty(k, np.int64), np.ones(k, np.bool_)
    lower, start, e = np.empty(k), np.empty(len(v)), s.rows.e
    copy_rows(near, there)
    for j in range(m):
        order[j], left[owner[j]] = owner[j], False
        # the projection changed the gradients of closed contacts: that must not make them bounce.
        # The law may have lowered the restitution of others
        there.e[j] = 0.0 if room.closed[owner[j]] else e[owner[j]]
    for a in range(k):
        if left[a]:
            order[i] = a
            copy_row(marks, a, there)
            there.e[i] = e[a]
            i += 1
    if m < k and len(s.bodies.mass) > 0:
        # all gradients are those at one place
        place(s.mechanism, room.end)
        for i in range(m, k):
            if acts_on_free_bodies(s, there, i):
                write_gradients(s.mechanism, s.constraints, there, i)
    held = len(s.mechanism.equalities.gap) > 0
    if held:
        # gradients of contacts and of equalities are those at one place: where both hold a body against each other, the
        # percussions depend on what rounding leaves of their differences
        keep_those_at(s, room.end, v)
    for i in range(k):
        a, lower[i] = order[i], -there.e[i] * inner(there.J[i], v)
        # a gap that the projection left open may close until the next law: otherwise its body would fall freely; a
        # contact that bounces leaves by Newton's law
        if there.lever[i] * there.gap[i] > s.scales.tolerance and (room.closed[a] or s.rates[a] == 0.0):
            lower[i] = -there.gap[i] / half if i < m else min(lower[i], -there.gap[i] / half)
    # those of the law, along the axes of these rows
    several = s.scales.part.any()
    rates = s.rates[: 4 * k if several else 0].copy()
    slip, turn = np.empty(min(8 * k, len(s.slip))), np.empty(min(12 * k, len(s.turn)))
    write_along_axes(s.slip, s.rows.axes, there.axes, order, slip)
    write_along_axes(s.turn, s.rows.axes, there.axes, order, turn)
    start_of_tangent_law(s, there, order, slip, turn, start)
    own = np.empty((k if len(s.bodies.mass) > 0 else 0, 6))
    if len(own) > 0:
        correct_turn(s, there, order, slip, turn, own)
    if held:
        keep_equalities(room.L, s.mechanism.parent, start)
    code = apply_bounds(s, there, v, start, lower, 2.0 * half)
    if code != DONE:
        return code
    if held:
        add_across(s)
    s.residual[0] = max(s.residual[0], sunk.residual[0])
    copy_rows(there, s.rows)
    if len(s.bodies.mass) > 0:
        keep_momentum_of_rows(s.bodies, s.rows.J[:k], s.q, room.after, room.end, sunk.place, s.v)
        write_rates_at(s, s.rows, s.v, 2)
    if several:
        keep_the_rest_of_law(s, sunk.moved, rates, slip, turn, order)
    if len(own) > 0:
        correct_displaced(s, sunk.place, own)
    for j in range(len(s.q)):
        s.q[j] = sunk.place[j]
    s.at_end[0] = True
    return DONE


@kernel("void(MechanismStep, Sunk)")
def move_marks(s: MechanismStep, sunk: Sunk) -> None:
    """Write the gaps of the law's rows after the projection."""
    marks, known, m, every = s.middle, s.ahead, s.ahead.size[0], True
    for i in range(marks.size[0]):
        marks.gap[i] += inner(marks.J[i], sunk.moved)
        every = every and may_bounce(s, marks, i)
    if not every:
        owner = np.empty(m, np.int64)
        known_gaps(s, sunk.place)
        match_rows(known, marks, owner)
        for a in range(m):
            if owner[a] >= 0 and not may_bounce(s, known, a):
                marks.gap[owner[a]] = s.room.gap[a]


@kernel("i8(MechanismStep, f8[::1], f8, b1[::1])")
def project_positions(s: MechanismStep, v: Array, h: float, near: Array) -> int:
    """Project closed contacts out of penetration after a step of `Centered`; return a code.

    Parameters
    ----------
    s : MechanismStep
        With the step before position projection, placed where the law was applied (`room.middle`), with the velocity
        after the law and that at the end (`room.after`), with what `apply_law` leaves in the room, and with all rows
        that are known (see `nearby_kernel`). The gaps of the law's rows are those where it was applied, and
        `room.opened` has the speeds at which they may close. The known rows do not tell the gaps of those that
        `may_bounce`.
    v : ndarray, shape (nv,)
        The velocity before the law.
    h : float
        Length of the step [s].
    near : ndarray of bool, shape (m,)
        Which of the known rows are those of the law.
    """
    rows, marks, room, half, count = s.rows, s.middle, s.room, 0.5 * h, s.rows.size[0]
    if not may_sink(s):
        advance_gaps(s, half)
        take_velocity_of_end(s)
        return DONE
    moved, there, residual, marks.size[0] = np.zeros(len(v)), np.zeros(len(s.q)), np.zeros(1), 0
    for a in range(len(near)):
        if near[a]:
            copy_row(s.ahead, a, marks)
    for _ in range(MOST_LINEARISATIONS):
        code = closed_contacts(s, h, room.closed[: rows.size[0]])
        if code != FOUND:
            return code
        if not bears_or_sinks(s, h):
            break
        code = find_nearby(s, s.q, np.zeros(len(room.margins)))
        if code != FOUND:
            return code
        active = nearby_rows(s)
        floor, sticks, margins = np.empty(active.size[0]), np.empty(rows.size[0], np.bool_), np.empty(len(room.margins))
        depths = np.empty(active.size[0])
        if not write_floor(s, v, h, active, floor, depths):
            break
        write_largest_of_rows(active.J, s.scales.part, depths, margins)
        margins *= NEARBY
        mark_rows(s, half)
        if len(rows.T) == 0 or not sticking_contacts(s, h, sticks):
            sticks = sticks[:0]
        sunk = Sunk(floor, margins, sticks, moved, there, residual)
        code = raise_sunk(s, active, sunk)
        if code == IMPOSSIBLE:
            break
        if code != FOUND:
            return code
        found = nearby_rows(s)
        owner, joins = np.empty(found.size[0], np.int64), False
        match_rows(found, marks, owner)
        for a in range(len(owner)):
            joins = joins or owner[a] < 0
        if not joins:
            move_marks(s, sunk)
            code = follow(s, v, half, sunk, found, owner)
            if code != IMPOSSIBLE:
                return code
            break
        code = join_law(s, v, half, found, owner, moved, count)
        if code == IMPOSSIBLE:
            break
        if code != DONE:
            return code
    advance_gaps(s, half)
    take_velocity_of_end(s)
    return DONE

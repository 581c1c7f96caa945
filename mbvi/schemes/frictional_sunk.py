"""Kernels that find closed contacts with friction that have sunk at the end of a step; see `frictional_settle`."""

from __future__ import annotations

from ..compiled import kernel
from ..constraints.mechanism_rows import active_rows
from ..constraints.mechanism_tables import FOUND, copy_row
from ..constraints.rows import mutual_nearest
from ..projection.closed_contacts import is_closed, stays_sunk
from ..projection.raise_gaps import largest_travel
from ..projection.tree import factor, is_damped
from ..system.pinocchio_address import tangent
from ..system.system import Array
from .mechanism_steps import DONE, UNSOLVED, MechanismStep, move_freely


@kernel("b1(MechanismStep, f8, b1[::1])")
def closed_contacts(s: MechanismStep, h: float, closed: Array) -> bool:
    """Find which rows of the law are closed; return whether the rates tell; see `project_positions`.

    Parameters
    ----------
    s : MechanismStep
        With the step before position projection; gaps are those where the law was applied.
    h : float
        Length of the step [s].
    closed : ndarray of bool, shape (k,)
        Receives which are closed.
    """
    rows, k, tolerance = s.rows, s.rows.size[0], s.scales.tolerance
    some = restitution = rises = bounces = False
    for a in range(k):
        rise, percussion = h * rows.lever[a] * s.rates[2 * k + a], s.rates[a]
        depth = -rows.lever[a] * (rows.gap[a] + 0.5 * h * s.rates[2 * k + a])
        fall = h * rows.lever[a] * s.rates[3 * k + a]
        closed[a] = is_closed(percussion, rise, tolerance) or stays_sunk(depth, rise, fall, rows.e[a], tolerance)
        some = some or closed[a]
        restitution = restitution or rows.e[a] != 0.0
        if not closed[a]:
            # it may be closed for all that if its gap is no larger after a whole step
            rises = rises or (rise > tolerance and rows.e[a] < 1.0 and percussion > 0.0)
            bounces = bounces or percussion > 0.0 or rows.lever[a] * rows.gap[a] < -tolerance
    return not (restitution and (rises or (bounces and some)))


@kernel("b1(MechanismStep, f8)")
def bears_or_sinks(s: MechanismStep, h: float) -> bool:
    """Return whether a row of the law bears load, or is below zero by more than the tolerance at the end."""
    rows, k = s.rows, s.rows.size[0]
    for a in range(k):
        depth = -rows.lever[a] * (rows.gap[a] + 0.5 * h * s.rates[2 * k + a])
        if s.rates[a] > 0.0 or depth > s.scales.tolerance:
            return True
    return False


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


@kernel("b1(MechanismStep)")
def some_below(s: MechanismStep) -> bool:
    """Return whether some gap of the known rows is below zero by more than the tolerance."""
    for a in range(s.ahead.size[0]):
        if s.ahead.lever[a] * s.room.gap[a] < -s.scales.tolerance:
            return True
    return False


@kernel("b1(MechanismStep, f8[::1], f8)")
def write_free_motion(s: MechanismStep, v: Array, h: float) -> bool:
    """Write the free motion of v, and the factor of M where the mechanism is placed; False where M has none."""
    m = s.mechanism
    if not move_freely(s, v, h, True, s.room.free):
        return False
    # L is that of M already where there is no damping
    return not (is_damped(m.damping) and factor(m.mass, 0.0, m.damping, m.parent, s.room.L))


@kernel("i8(MechanismStep, f8[::1], f8)")
def search_at_end(s: MechanismStep, v: Array, h: float) -> int:
    """Find the rows at the end of the step, which becomes the place where rows are known; return a code.

    `s.middle` has the rows of the law as they were known, and receives what they are there. `room.owner` receives for
    each row found the row of the law at the same contact, -1 where there is none. The free motion of v is written
    before: it takes the mass matrix at the place of the law.
    """
    known, room, reach, marks = s.ahead, s.room, s.scales.reach, s.middle
    if not write_free_motion(s, v, h):
        return UNSOLVED
    code = active_rows(s.mechanism, s.constraints, s.q[:0], room.moved, s.q, s.scales.tolerance + 2.0 * reach, known)
    if code != FOUND:
        return code
    for j in range(len(s.q)):
        room.end[j] = s.q[j]
    m, k = known.size[0], marks.size[0]
    owner, order = room.owner[:m], room.order[:k]
    for i in range(k):
        # rows are found in the order of their numbers
        order[i] = i
    mutual_nearest(known.number[:m], known.point[:m], marks.number[:k], marks.point[:k], order, owner)
    for i in range(k):
        order[i] = -1
    for a in range(m):
        if owner[a] >= 0:
            order[owner[a]] = a
    for i in range(k):
        if order[i] >= 0:
            marks.size[0] = i
            copy_row(known, order[i], marks)
    marks.size[0] = k
    return DONE


@kernel("f8(MechanismStep)")
def find_sunk_contacts(s: MechanismStep) -> float:
    """Return how deep the closed contacts have sunk [m], 0 for no more than the tolerance; -1 where rows may join.

    The room of the step has the gaps of known rows, their rows of the law (`owner`), and which of these are closed. It
    receives for each row of the law its place among the known ones, -1 for none (`order`), whether it is active at the
    end (`settled`), and the lower bound of its gap (`bound`).
    """
    known, room, tolerance, depth, other, others = s.ahead, s.room, s.scales.tolerance, 0.0, 0.0, False
    for i in range(s.rows.size[0]):
        room.order[i], room.settled[i], room.bound[i] = -1, False, 0.0
    for a in range(known.size[0]):
        i, length = room.owner[a], known.lever[a] * room.gap[a]
        active = length <= tolerance
        if i < 0:
            other, others = max(other, -length), others or active
            continue
        sunk = room.closed[i] and length < -tolerance
        room.order[i], room.settled[i] = a, active
        # bounds below zero by no more than the tolerance stay: they would contradict each other by their rounding
        room.bound[i] = 0.0 if sunk or not active else min(room.gap[a], 0.0)
        depth = max(depth, -length if sunk else 0.0)
    # of the others each may belong to a contact that has moved
    if other > tolerance or (others and depth > tolerance):
        return -1.0
    return depth if depth > tolerance else 0.0

"""A step of `StewartTrinkle` for few bodies in one kernel; see `phases`."""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ...constraints.mechanism.rows import active_rows
from ...constraints.mechanism.tables import FOUND, copy_row
from ...projection.row_speeds import row_speeds
from ...projection.tree import factor
from ...system.mechanisms.mechanism import carry, place
from ...system.mechanisms.pinocchio_address import retract
from ...system.system import Array
from .phases import evaluate_forces, move_freely, write_rates
from .records import BOUNCES, DONE, UNSOLVED, MechanismStep
from .stewart_trinkle_velocity import displacing_velocity, project_bounds

# penetration at the end of a step above which it is retried where no depth is accepted, in lengths of the scene
RETRY_DEPTH = 1e-3


@kernel("void(i8[::1], i8[::1], f8[::1], f8[::1], b1[::1])")
def mark_within_reach(row: Array, of: Array, length: Array, reach: Array, within: Array) -> None:
    """Mark the rows that parts may close: those with a gap of at most the reach of one of their parts.

    A row within reach connects its parts, and both then have the larger reach: one may push the other as far.

    Parameters
    ----------
    row, of : ndarray of int
        Pairs of a row and a part that it acts on.
    length : ndarray, shape (k,)
        Gaps [m].
    reach : ndarray, shape (parts,)
        How far each part reaches by itself [m]. Receives how far it does with those that it is connected with.
    within : ndarray of bool, shape (k,)
        Receives the mask.
    """
    own, spreads = np.zeros(len(length)), True
    while spreads:
        spreads = False
        for j in range(len(row)):
            own[row[j]] = max(own[row[j]], reach[of[j]])
        for j in range(len(row)):
            a = row[j]
            if length[a] <= own[a] and reach[of[j]] < own[a]:
                reach[of[j]], spreads = own[a], True
    for a in range(len(length)):
        within[a] = length[a] <= own[a]


@kernel("void(MechanismStep, f8[::1], f8[::1], f8[::1])")
def write_reach(s: MechanismStep, q: Array, displacement: Array, reach: Array) -> None:
    """Write how far each part reaches [m], as `StewartTrinkle` does; place the mechanism at q."""
    m, part = s.mechanism, s.scales.part
    retract(m.calls, q, displacement, s.room.end)
    place(m, s.room.end)
    end = m.poses.copy()
    place(m, q)
    reach[:] = s.scales.tolerance
    for body in range(1, len(end)):
        turned = moved = 0.0
        for c in range(3):
            for r in range(3):
                turned += (end[body, r, c] - m.poses[body, r, c]) ** 2
            moved += (end[body, 3, c] - m.poses[body, 3, c]) ** 2
        far = 2.0 * (np.sqrt(moved) + s.scales.length * np.sqrt(turned)) + s.scales.tolerance
        for k in range(len(part)):
            if m.support[body, k] != 0.0:
                reach[part[k]] = max(reach[part[k]], far)


@kernel("i8(MechanismStep, f8[::1], f8[::1])")
def find_within_reach(s: MechanismStep, q: Array, displacement: Array) -> int:
    """Find the rows at q that a displacement, shape (nv,), may close; return a code."""
    rows, part, most, count = s.rows, s.scales.part, 0.0, 0
    reach = np.empty(len(s.room.margins))
    write_reach(s, q, displacement, reach)
    for p in range(len(reach)):
        most = max(most, reach[p])
    code = active_rows(s.mechanism, s.constraints, q[:0], displacement, q, most, rows)
    if code != FOUND or len(reach) == 1:
        return code
    k, n = rows.size[0], len(part)
    row, of, within = np.empty(k * n, np.int64), np.empty(k * n, np.int64), np.empty(k, np.bool_)
    for a in range(k):
        for j in range(n):
            if rows.J[a, j] != 0.0:
                row[count], of[count] = a, part[j]
                count += 1
    mark_within_reach(row[:count], of[:count], rows.lever[:k] * rows.gap[:k], reach, within)
    rows.size[0] = 0
    for a in range(k):
        if within[a]:
            copy_row(rows, a, rows)
    return FOUND


@kernel("b1(MechanismStep, f8[::1])")
def lower_to_the_end(s: MechanismStep, gap: Array) -> bool:
    """Lower gaps to those found at the end of the step, `s.ahead`; return whether each of these has a row and is small.

    Parameters
    ----------
    s : MechanismStep
        With the rows of the step, and those at its end.
    gap : ndarray, shape (k,)
        The gaps at the end, to first order.
    """
    rows, ahead = s.rows, s.ahead
    for b in range(ahead.size[0]):
        first = -1
        for a in range(rows.size[0]):
            if first < 0 and rows.number[a] == ahead.number[b]:
                first = a
        if first < 0 or -ahead.lever[b] * ahead.gap[b] > RETRY_DEPTH * s.scales.length:
            return False
        gap[first] = min(gap[first], ahead.gap[b])
    return True


@kernel("i8(MechanismStep, f8, f8[::1], f8[::1], f8)")
def stewart_trinkle_step(s: MechanismStep, t: float, q: Array, v: Array, h: float) -> int:
    """Write the state after a step of `StewartTrinkle` from q, v at t; return a code."""
    m, room, rows, scales = s.mechanism, s.room, s.rows, s.scales
    free, displacement = room.free, room.displacement
    evaluate_forces(s, t, q, v, h)
    if not move_freely(s, v, h, False, free):
        return UNSOLVED
    for j in range(len(v)):
        displacement[j] = h * free[j]
    s.constraints.given.time[0] = t + 0.5 * h
    code = find_within_reach(s, q, displacement)
    if code != FOUND:
        return code
    # the mass matrix at q, also where forces are damped
    if factor(m.mass, 0.0, m.damping, m.parent, room.L):
        return UNSOLVED
    k = rows.size[0]
    bound, lower, gap, change = room.law[:k], room.bound[:k], room.gap[:k], room.opened[:k]
    code, removes, residual = displacing_velocity(s, v, h, bound, lower)
    if code != DONE:
        return code
    row_speeds(rows.J, room.tangent, h, change)
    least = 0.0
    for a in range(k):
        gap[a] = rows.gap[a] + change[a]
        least = min(least, rows.lever[a] * gap[a])
    for j in range(len(v)):
        displacement[j] = h * room.tangent[j]
    carry(m, q, displacement, s.q)
    # rows deeper at the end than every known row; penetration within the tolerance is left
    below = min(-scales.tolerance, least - 1e-12 * scales.length)
    s.constraints.given.time[0] = t + h
    code = active_rows(m, s.constraints, q[:0], displacement, s.q, below, s.ahead)
    if code != FOUND:
        return code
    if not lower_to_the_end(s, gap):
        return BOUNCES
    # the displacement that removes penetration does not enter the velocity
    if removes and project_bounds(s, bound, lower, h) != DONE:
        return UNSOLVED
    s.residual[0] = max(s.residual[0], residual)
    write_rates(s, rows, v)
    for a in range(k):
        rows.gap[a] = gap[a]
    return DONE

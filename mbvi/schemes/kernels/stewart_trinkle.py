"""A step of `StewartTrinkle` for few bodies in one kernel; see `phases`."""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ...constraints.mechanism.rows import active_rows
from ...constraints.mechanism.tables import FOUND, copy_row
from ...projection.positions.travel import write_largest_of_parts, write_largest_of_rows
from ...projection.row_speeds import row_speeds
from ...projection.tree import factor
from ...system.free.sparse_rows import MOST_DENSE
from ...system.mechanisms.by_address.pinocchio_address import retract
from ...system.mechanisms.mechanism import carry, place
from ...system.system import Array
from ..gap_bounds.reach import spread_reach, write_largest_of_groups
from ..positions.displacement_kernel import independent_groups
from .phases import evaluate_forces, move_freely, write_rates
from .records import BOUNCES, DONE, UNSOLVED, MechanismStep
from .stewart_trinkle_velocity import displacing_velocity, project_bounds
from .walls import take_mean_rates

# penetration at the end of a step above which it is retried where no depth is accepted, in lengths of the scene
RETRY_DEPTH = 1e-3


@kernel("f8(MechanismStep, f8[::1], f8[::1], f8[::1])")
def write_reach(s: MechanismStep, q: Array, displacement: Array, reach: Array) -> float:
    """Write twice the largest displacement of a body of each part, shape (parts,) [m]; return the largest of all.

    The mechanism is then placed at q.
    """
    m, most = s.mechanism, 0.0
    retract(m.calls, q, displacement, s.room.end)
    place(m, s.room.end)
    end = m.poses.copy()
    place(m, q)
    for p in range(len(reach)):
        reach[p] = s.scales.tolerance
    # walls that move have no reach
    for body in range(1, len(s.scales.part_of_body) + 1):
        turned, moved, p = 0.0, 0.0, s.scales.part_of_body[body - 1]
        for c in range(3):
            for r in range(3):
                turned += (end[body, r, c] - m.poses[body, r, c]) ** 2
            moved += (end[body, 3, c] - m.poses[body, 3, c]) ** 2
        far = 2.0 * (np.sqrt(moved) + s.scales.length * np.sqrt(turned)) + s.scales.tolerance
        reach[p], most = max(reach[p], far), max(most, far)
    return most


@kernel("b1(MechanismStep)")
def has_groups(s: MechanismStep) -> bool:
    """Return whether rows may act on different parts; those of many bodies count as one group, see `groups`."""
    return s.scales.part[len(s.scales.part) - 1] > 0 and len(s.scales.part) <= MOST_DENSE


@kernel("void(MechanismStep, f8[::1])")
def take_within_reach(s: MechanismStep, reach: Array) -> None:
    """Leave out the rows that are not within the reach of their parts, shape (parts,), and find the groups of others.

    `room.owner` receives the first row of each group.
    """
    rows, k, several = s.rows, s.rows.size[0], has_groups(s)
    length, near, group = np.empty(k), np.empty(k, np.bool_), s.room.owner
    for a in range(k):
        length[a], group[a] = rows.lever[a] * rows.gap[a], 0
    if not several:
        return
    spread_reach(rows.J[:k], length, s.scales.part, reach, near)
    rows.size[0] = 0
    for a in range(k):
        if near[a]:
            copy_row(rows, a, rows)
    k = rows.size[0]
    independent_groups(rows.J[:k], s.scales.part, group[:k])


@kernel("void(MechanismStep, f8[::1])")
def take_deeper(s: MechanismStep, gap: Array) -> None:
    """Leave out the rows at the end of the step, `s.ahead`, that are not deeper than all known rows of their group.

    `gap`, shape (k,), are the gaps of the known rows there, to first order.
    """
    rows, ahead, k, m = s.rows, s.ahead, s.rows.size[0], s.ahead.size[0]
    depth, most, least, of_part = np.empty(k), np.empty(k), np.empty(m), np.empty(len(s.room.margins))
    for a in range(k):
        depth[a] = -rows.lever[a] * gap[a]
    write_largest_of_groups(depth, s.room.owner[:k], most)
    write_largest_of_rows(rows.J[:k], s.scales.part, most, of_part)
    write_largest_of_parts(ahead.J[:m], s.scales.part, of_part, least)
    ahead.size[0] = 0
    for b in range(m):
        if -ahead.lever[b] * ahead.gap[b] >= least[b] + 1e-12 * s.scales.length:
            copy_row(ahead, b, ahead)


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
    reach = write_reach(s, q, displacement, room.margins)
    # the mass matrix at q, also where forces are damped
    if factor(m.mass, 0.0, m.damping, m.parent, room.L):
        return UNSOLVED
    s.constraints.given.time[0] = t
    code = active_rows(m, s.constraints, q[:0], displacement, q, reach, rows)
    if code != FOUND:
        return code
    take_mean_rates(s, q, 0.5 * h)
    take_within_reach(s, room.margins)
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
    several = has_groups(s)
    below = -scales.tolerance if several else min(-scales.tolerance, least - 1e-12 * scales.length)
    s.constraints.given.time[0] = t + h
    code = active_rows(m, s.constraints, q[:0], displacement, s.q, below, s.ahead)
    if code != FOUND:
        return code
    if several:
        take_deeper(s, gap)
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

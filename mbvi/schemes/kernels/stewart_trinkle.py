"""A step of `StewartTrinkle` for few bodies in one kernel; see `phases`."""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ...constraints.mechanism.rows import active_rows
from ...constraints.mechanism.tables import FOUND
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


@kernel("f8(MechanismStep, f8[::1], f8[::1])")
def reach_of(s: MechanismStep, q: Array, displacement: Array) -> float:
    """Return twice the largest displacement of a body [m], as `StewartTrinkle` does; place the mechanism at q."""
    m, most = s.mechanism, 0.0
    retract(m.calls, q, displacement, s.room.end)
    place(m, s.room.end)
    end = m.poses.copy()
    place(m, q)
    for body in range(1, len(end)):
        turned = moved = 0.0
        for c in range(3):
            for r in range(3):
                turned += (end[body, r, c] - m.poses[body, r, c]) ** 2
            moved += (end[body, 3, c] - m.poses[body, 3, c]) ** 2
        most = max(most, np.sqrt(moved) + s.scales.length * np.sqrt(turned))
    return 2.0 * most + s.scales.tolerance


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
    reach = reach_of(s, q, displacement)
    # the mass matrix at q, also where forces are damped
    if factor(m.mass, 0.0, m.damping, m.parent, room.L):
        return UNSOLVED
    s.constraints.given.time[0] = t + 0.5 * h
    code = active_rows(m, s.constraints, q[:0], displacement, q, reach, rows)
    if code != FOUND:
        return code
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

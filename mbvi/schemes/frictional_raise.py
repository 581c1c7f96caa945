"""Kernels that raise closed contacts with friction, and make the velocity tangent to them; see `frictional_settle`."""

from __future__ import annotations

import numpy as np

from ..compiled import kernel
from ..constraints.mechanism_tables import RowBuffer, copy_row
from ..projection.coulomb_law import COMPLIANT, NOTHING, UNIQUE, coulomb_law
from ..projection.friction import AIM, EXACT
from ..projection.frictional_step import interleave, wide_speeds
from ..projection.held_rows import held_tangents, hold_rows, raises_near
from ..projection.raise_gaps import MOST_LINEARISATIONS, NEARBY
from ..projection.robot_step import solve_active_set
from ..projection.tree import solve
from ..system.free_momentum import keep_momentum_of_rows
from ..system.pinocchio_address import retract
from ..system.system import Array
from .frictional_sunk import known_gaps, write_free_motion
from .mechanism_steps import BOUNCES, DONE, UNSOLVED, MechanismStep

# what `raise_contacts` returns where there is no such displacement
_NONE = -1.0


@kernel("void(MechanismStep, RowBuffer)")
def solve_wide(s: MechanismStep, rows: RowBuffer) -> None:
    """Write rows with their tangents, and both solved with the mass matrix."""
    wide, k = s.room.wide, rows.size[0]
    interleave(rows.J[:k], rows.T[: 2 * k], wide[0, : 3 * k])
    solve(s.room.L, s.mechanism.parent, wide[0, : 3 * k], wide[2, : 3 * k], wide[1, : 3 * k])


@kernel("b1(MechanismStep, f8, b1[::1])")
def sticking_contacts(s: MechanismStep, h: float, sticks: Array) -> bool:
    """Find which rows of the law stick; return whether there are any."""
    k, some = len(sticks), False
    for a in range(k):
        percussion = after = 0.0
        for c in range(2):
            percussion += s.slip[2 * a + c] ** 2
            after += s.slip[2 * (2 * k + a) + c] ** 2
        slow = h * np.sqrt(after) <= s.scales.tolerance
        sticks[a] = s.rates[a] > 0.0 and percussion > 0.0 and slow
        some = some or sticks[a]
    return some


@kernel("f8(MechanismStep, b1[::1], b1)")
def displace(s: MechanismStep, sticks: Array, holds: bool) -> float:
    """Write the displacement that raises linear gaps to their bounds; return its residual.

    Parameters
    ----------
    s : MechanismStep
        With the rows of the law in metric; its room with the last displacement (`moved`), the gaps there (`gap`), their
        bounds (`bound`), and the rows that take part (`settled`). Of these `change` receives the percussions.
    sticks : ndarray of bool, shape (k,)
        The contacts whose tangents are held.
    holds : bool
        Whether some contact of the law is to be held.

    Returns
    -------
    float
        The relative residual, _NONE if there is no such displacement, inf if it is not found.
    """
    room, memory, k, n = s.room, s.memory, len(sticks), len(s.v)
    near, wide, moved, still = room.settled[:k], room.wide, room.moved, room.tangent
    J, W, held = wide[0, : 3 * k], wide[2, : 3 * k], room.held
    size, i = held_tangents(W, near, sticks, room.triangle, room.basis), 0
    if size < 0:
        return np.inf
    count = hold_rows(room.L, s.mechanism.parent, W, near, size, room.basis, held[0], held[1], held[2])
    if count < 0:
        return np.inf
    lower, table = room.opened[:count], room.table[: 3 * count].reshape((3, count))
    for a in range(k):
        if near[a]:
            lower[i] = room.bound[a] - room.gap[room.order[a]]
            for c in range(n):
                lower[i] += J[3 * a, c] * moved[c]
            i += 1
    for c in range(n):
        still[c] = 0.0
    last = memory.percussion[: memory.size[0]]
    residual = solve_active_set(
        held[0, :count], held[1, :count], held[2, :count], still, lower, last, 0.0, moved, table
    )
    # written so that a NaN is refused too
    if not 0.0 <= residual < np.inf:
        return _NONE if residual < -s.scales.residual else np.inf
    memory.size[0], i = count, 0
    for a in range(k):
        room.change[a] = 0.0
        if near[a]:
            room.change[a] = memory.percussion[i] = table[0, i]
            i += 1
    return residual if not holds or raises_near(room.L, J, W, near, moved, lower, s.scales.tolerance) else _NONE


@kernel("f8(MechanismStep, f8, f8, b1[::1], b1)")
def raise_contacts(s: MechanismStep, margin: float, depth: float, sticks: Array, holds: bool) -> float:
    """Write the nearest configuration in which no gap is below its bound, and the gaps there; return as `displace`.

    It is written to `room.middle`. The other arguments are those of `settle_with_friction` and `displace`; `depth` is
    the largest distance by which a gap must rise [m].
    """
    known, room, tolerance, m, k = s.ahead, s.room, s.scales.tolerance, s.ahead.size[0], s.rows.size[0]
    for c in range(len(s.v)):
        room.moved[c] = 0.0
    for _ in range(MOST_LINEARISATIONS):
        residual = displace(s, sticks, holds)
        # written so that a NaN is refused too
        if not 0.0 <= residual < np.inf:
            return residual
        retract(s.mechanism.calls, s.q, room.moved, room.middle)
        travel = known_gaps(s, room.middle)
        if not travel < s.scales.reach or NEARBY * depth + travel > margin:
            return np.inf
        for a in range(m):
            if room.owner[a] < 0 and known.lever[a] * room.gap[a] <= tolerance + NEARBY * depth:
                return np.inf
        settled = True
        for i in range(k):
            a = room.order[i]
            if a < 0:
                continue
            pushed = room.settled[i] and room.change[i] > 0.0
            room.settled[i] = known.lever[a] * room.gap[a] <= tolerance + NEARBY * depth
            if room.settled[i]:
                above = known.lever[a] * (room.gap[a] - room.bound[i])
                settled = settled and above >= -tolerance and (above <= tolerance or not pushed)
        if settled:
            return residual
    return _NONE


@kernel("void(MechanismStep, RowBuffer, f8, i8[::1])")
def take_projected(s: MechanismStep, there: RowBuffer, half: float, order: Array) -> None:
    """Replace the rows of the law by those `there`, at the end of the step, in the order of projected positions.

    Those that took part in the last projection come first. `order`, shape (k,), receives which row of the law each was.
    """
    rows, room, k, i = s.rows, s.room, s.rows.size[0], 0
    for a in range(k):
        if room.settled[a]:
            order[i] = a
            i += 1
        if room.order[a] >= 0:
            there.gap[a] = room.gap[room.order[a]]
        else:
            there.gap[a] = rows.gap[a] + half * s.rates[2 * k + a]
            for c in range(len(s.v)):
                there.gap[a] += there.J[a, c] * room.moved[c]
    for a in range(k):
        if not room.settled[a]:
            order[i] = a
            i += 1
    rows.size[0] = 0
    for i in range(k):
        copy_row(there, order[i], rows)
    solve_wide(s, rows)


@kernel("void(MechanismStep, i8[::1], f8[::1])")
def start_of_tangent_law(s: MechanismStep, order: Array, start: Array) -> None:
    """Write the free motion, of free bodies the velocity after the law less its percussions at the rows as they are.

    What the percussions of the tangent velocity differ by from those of the law is then an impulse at these rows.
    `order` is that of `take_projected`; `start` has shape (nv,).
    """
    A, k = s.room.wide[1], len(order)
    for j in range(len(start)):
        start[j] = s.room.free[j]
        if s.bodies.owner[j] >= 0:
            start[j] = s.v[j]
            for i in range(k):
                a = order[i]
                start[j] -= s.rates[a] * A[3 * i, j]
                start[j] -= s.slip[2 * a] * A[3 * i + 1, j] + s.slip[2 * a + 1] * A[3 * i + 2, j]


@kernel("b1(MechanismStep, f8[::1], f8, i8[::1], f8)")
def tangent_law(s: MechanismStep, v: Array, rest: float, order: Array, raised: float) -> bool:
    """Write the velocity tangent to the closed contacts after the projection, its rates and the residual.

    Parameters
    ----------
    s : MechanismStep
        With rows as `take_projected` leaves them, and the rates of the law before.
    v : ndarray, shape (nv,)
        The velocity before the law.
    rest : float
        Time from the end of the step to the next law [s].
    order : ndarray of int, shape (k,)
        As of `take_projected`.
    raised : float
        Residual of the position projection.

    Returns
    -------
    bool
        Whether the law is solved.
    """
    rows, room, memory, k, tolerance = s.rows, s.room, s.memory, len(order), s.scales.tolerance
    n, J, A, part = 3 * k, room.wide[0, : 3 * k], room.wide[1, : 3 * k], room.table
    before, lower, table = part[:n], part[n : 2 * n], part[2 * n : 5 * n].reshape((3, n))
    wide_speeds(J, v, before)
    start_of_tangent_law(s, order, room.tangent)
    for i in range(k):
        a, open_gap = order[i], rows.lever[i] * rows.gap[i] > tolerance
        if room.settled[a] and room.closed[a]:
            # the projection changed the gradients of closed contacts: that must not make them bounce
            rows.e[i] = 0.0
        lower[3 * i], lower[3 * i + 1], lower[3 * i + 2] = -rows.e[i] * before[3 * i], 0.0, 0.0
        # a gap that the projection left open may close until the next law: otherwise its body would fall freely;
        # a contact that bounces leaves by Newton's law
        if open_gap and (room.closed[a] or s.rates[a] == 0.0):
            lower[3 * i] = -rows.gap[i] / rest if room.settled[a] else min(lower[3 * i], -rows.gap[i] / rest)
    known, start, case = NOTHING, memory.start[:n], room.order[:k]
    if memory.size[1] == n:
        known = UNIQUE if memory.size[2] else COMPLIANT
    else:
        for i in range(n):
            start[i] = 0.0
    found, unique = coulomb_law(J, A, room.tangent, lower, rows.mu[:k], known, AIM, start, s.v, table, case)
    if not found <= EXACT * s.scales.residual:
        return False
    memory.size[1], memory.size[2], s.residual[0] = n, 1 if unique else 0, max(found, raised)
    wide_speeds(J, room.free, table[1])
    for i in range(n):
        a, c = i // 3, i % 3
        for r in range(4):
            value = before[i] if r == 3 else table[r, i]
            if c == 0:
                s.rates[r * k + a] = value
            else:
                s.slip[2 * (r * k + a) + c - 1] = value
    return True


@kernel("i8(MechanismStep, f8[::1], f8, f8, f8, b1)")
def raise_and_follow(s: MechanismStep, v: Array, h: float, margin: float, depth: float, searched: bool) -> int:
    """Raise the contacts that `find_sunk_contacts` found, and make the velocity tangent to them; return a code.

    Parameters
    ----------
    s, v, h, margin
        As of `settle_with_friction`; `s.middle` has the rows of the law with what they are at the end of the step.
    depth : float
        How deep contacts have sunk [m].
    searched : bool
        Whether `search_at_end` found these rows.
    """
    room, k, half = s.room, s.rows.size[0], 0.5 * h
    if not searched and not write_free_motion(s, v, h):
        return UNSOLVED
    solve_wide(s, s.middle)
    sticks, order = room.law[:k], room.owner[:k]
    raised = raise_contacts(s, margin, depth, sticks, sticking_contacts(s, h, sticks))
    # a body that landed tilted cannot turn about contacts that are all held: that is left to Python too
    if not 0.0 <= raised < np.inf:
        return BOUNCES
    take_projected(s, s.middle, half, order)
    for j in range(len(v)):
        room.drift[j] = s.v[j]
    if not tangent_law(s, v, half, order, raised):
        return UNSOLVED
    if len(s.bodies.mass) > 0:
        keep_momentum_of_rows(s.bodies, s.rows.J[:k], s.q, room.drift, room.end, room.middle, s.v)
        after = room.table[: 3 * k]
        wide_speeds(room.wide[0, : 3 * k], s.v, after)
        for a in range(k):
            s.rates[2 * k + a] = after[3 * a]
            s.slip[2 * (2 * k + a)], s.slip[2 * (2 * k + a) + 1] = after[3 * a + 1], after[3 * a + 2]
    for j in range(len(s.q)):
        s.q[j] = room.middle[j]
    return DONE

"""A step of `Centered` for a mechanism in one kernel; see `mechanism_steps`."""

from __future__ import annotations

import numpy as np

from ..compiled import kernel
from ..constraints.mechanism_rows import active_rows, write_gradients
from ..constraints.mechanism_tables import FOUND, RowBuffer, copy_row
from ..constraints.rows import mutual_nearest
from ..projection.closed_contacts import find_sunk
from ..projection.fused_step import FEW
from ..projection.raise_gaps import largest_bend, largest_travel
from ..projection.settle_positions import PROJECTED, UNDECIDED, settle_positions
from ..projection.tree import factor, solve
from ..system.free_momentum import keep_momentum_of_rows
from ..system.mechanism import place
from ..system.pinocchio_address import retract, tangent
from ..system.system import Array
from .mechanism_steps import (
    DONE,
    UNSOLVED,
    MechanismStep,
    act,
    apply_law,
    evaluate_effects,
    evaluate_forces,
    move_freely,
)
from .settle_kernel import project_positions
from .step import joins, margin_of, write_closing_speeds

# what `settle` returns beside codes of a step: it takes searches
FAR = -1


@kernel("void(f8[:,::1], f8[::1], f8, f8[::1])")
def row_speeds(J: Array, v: Array, time: float, change: Array) -> None:
    """Write by how much the gaps of the first rows change within a time, shape (k,)."""
    for a in range(len(change)):
        speed = 0.0
        for k in range(len(v)):
            speed += J[a, k] * v[k]
        change[a] = time * speed


@kernel("i8(RowBuffer, f8, f8, f8[::1], RowBuffer, b1[::1])")
def take_near(rows: RowBuffer, tolerance: float, margin: float, drift: Array, near_rows: RowBuffer, near: Array) -> int:
    """Copy the rows that join the law within a margin beyond the tolerance [m]; write which and return how many.

    `drift`, shape (nv,), leads to where the rows are; see `joins`.
    """
    near_rows.size[0] = 0
    for a in range(rows.size[0]):
        near[a] = rows.lever[a] * rows.gap[a] <= tolerance + margin
        if near[a] and margin > 0.0:
            change = 0.0
            for k in range(len(drift)):
                change += rows.J[a, k] * drift[k]
            near[a] = joins(rows.gap[a], change, rows.lever[a], tolerance)
        if near[a]:
            copy_row(rows, a, near_rows)
    return near_rows.size[0]


@kernel("i8(MechanismStep, f8[::1], f8[::1])")
def rows_in_the_middle(s: MechanismStep, middle: Array, change: Array) -> int:
    """Replace the rows of the end of a step by the same in its middle, in the same order; return a code.

    `middle`, shape (nq,), is the configuration there, and `change`, shape (k,), that of the gaps from there to the end.
    """
    rows, here, most, m = s.rows, s.middle, 0.0, s.rows.size[0]
    for a in range(m):
        most = max(most, rows.lever[a] * (abs(rows.gap[a]) + abs(change[a])))
    # twice the linear estimate, because the gradients change within the step
    reach = s.scales.tolerance + 2.0 * most
    code = active_rows(s.mechanism, s.constraints, middle[:0], s.room.moved, middle, reach, here)
    if code != FOUND:
        return code
    n, owner, order = here.size[0], s.room.owner[:m], s.room.order[: here.size[0]]
    for b in range(n):
        # rows are found in the order of their numbers
        order[b] = b
    mutual_nearest(rows.number[:m], rows.point[:m], here.number[:n], here.point[:n], order, owner)
    for a in range(m):
        if owner[a] >= 0:
            rows.size[0] = a
            copy_row(here, owner[a], rows)
        else:
            # a contact without a counterpart in the middle is taken at the place where it is at the end
            rows.gap[a] -= change[a]
            place(s.mechanism, middle)
            write_gradients(s.mechanism, s.constraints, rows, a)
    rows.size[0] = m
    return FOUND


@kernel("b1(RowBuffer, f8[::1], f8)")
def may_bounce(rows: RowBuffer, change: Array, tolerance: float) -> bool:
    """Return whether some row may bounce: it keeps its gap then, which must be that of the middle."""
    for a in range(rows.size[0]):
        rebound = -2.0 * rows.e[a] * change[a] * rows.lever[a]
        if rows.e[a] > 0.0 and (rebound > tolerance or rows.e[a] >= 1.0):
            return True
    return False


@kernel("i8(MechanismStep, f8[::1], f8[::1], f8[::1], f8, b1[::1], f8[::1], f8)")
def settle(
    s: MechanismStep, place_ahead: Array, middle: Array, v: Array, h: float, near: Array, free: Array, margin: float
) -> int:  # fmt: skip
    """Project closed contacts out of penetration after a step; return a code or `FAR`.

    Parameters
    ----------
    s : MechanismStep
        With the step before position projection, and all rows that are known, those of `place_ahead`.
    place_ahead, middle, v : ndarray
        Where the rows are known, where the law was applied, and the velocity before it.
    h : float
        Length of the step [s].
    near : ndarray of bool, shape (m,)
        Which of the known rows are those of the law.
    free : ndarray, shape (nv,)
        The free motion of v.
    margin : float
        How far beyond the tolerance the rows are known [m].
    """
    known, scales, room, mech, n, half = s.ahead, s.scales, s.room, s.mechanism, len(v), 0.5 * h
    m, k, reach, displacement = known.size[0], s.rows.size[0], scales.reach, room.displacement
    tangent(mech.calls, place_ahead, s.q, displacement)
    if not largest_travel(scales.squares, displacement) < reach:
        return FAR
    rates, law, open_speeds, i = room.table[: 4 * m].reshape((4, m)), room.law[:m], room.change[:m], 0
    for a in range(m):
        law[a], open_speeds[a] = near[a], room.opened[i] if near[a] else 0.0
        for r in range(4):
            rates[r, a] = s.rates[r * k + i] if near[a] else 0.0
        i += near[a]
    number, point, J, lever = known.number[:m], known.point[:m], known.J[:m], known.lever[:m]
    # copies: searches start from the rows as they are
    gap, e, end, settled = known.gap[:m].copy(), known.e[:m].copy(), room.gap[:m], room.settled[:m]
    depth = find_sunk(
        number, point, J, gap, lever, e, v, s.v, displacement, law, rates, h, half, scales.tolerance, room.closed[:m],
        end, room.bound[:m], settled,
    )  # fmt: skip
    if depth < 0.0:
        return FAR
    if depth == 0.0:
        i = 0
        for a in range(m):
            if near[a]:
                s.rows.gap[i] = end[a]
                i += 1
        return DONE
    w, W, A, law_J, law_A, law_W = room.drift, room.W[:m], room.A[:m], J.copy(), np.empty((m, n)), np.empty((m, n))
    for j in range(n):
        w[j], room.moved[j] = s.v[j], 0.0
    if factor(mech.mass, 0.0, room.moved, mech.parent, room.L):
        return UNSOLVED
    i = 0
    for a in range(m):
        if near[a]:
            law_J[a] = s.rows.J[i]
            i += 1
    solve(room.L, mech.parent, J, W, A)
    solve(room.L, mech.parent, law_J, law_W, law_A)
    code, residual = settle_positions(
        number, point, J, A, W, law_J, law_A, law_W, gap, lever, e, open_speeds, scales.squares, free, v, w,
        displacement, law, settled, rates, room.moved, room.tangent, s.bodies.owner >= 0, h, half, scales.tolerance,
        reach, margin, 0.0 if m <= FEW else 1e-3 * scales.residual,
    )  # fmt: skip
    if code == UNDECIDED:
        return FAR
    same, i, s.middle.size[0] = True, 0, 0
    for a in range(m):
        same = same and law[a] == near[a]
        if law[a]:
            # rows that no projection moved are those of the law
            copy_row(s.rows, i, s.middle) if near[a] and code != PROJECTED else copy_row(known, a, s.middle)
            last = s.middle.size[0] - 1
            s.middle.gap[last], s.middle.e[last] = gap[a], e[a]
        i += near[a]
    k, i, s.rows.size[0] = s.middle.size[0], 0, 0
    for a in range(k):
        copy_row(s.middle, a, s.rows)
    for a in range(m):
        if law[a]:
            for r in range(4):
                s.rates[r * k + i] = rates[r, a]
            i += 1
    if residual >= 0.0:
        s.memory.size[0], s.residual[0] = k, residual
        for a in range(k):
            s.memory.percussion[a] = s.rates[a]
    for j in range(n):
        s.v[j] = w[j]
        room.displacement[j] = half * w[j]
    if not same:
        retract(mech.calls, middle, room.displacement, s.q)
    if code == PROJECTED:
        for j in range(n):
            s.v[j] = room.tangent[j]
        before = s.q.copy()
        retract(mech.calls, before, room.moved, s.q)
        if len(s.bodies.mass) > 0:
            keep_momentum_of_rows(s.bodies, s.rows.J[:k], before, w, place_ahead, s.q, s.v)
            row_speeds(s.rows.J, s.v, 1.0, s.rates[2 * k : 3 * k])
    return DONE


@kernel("void(MechanismStep, f8, f8[::1], f8[::1], f8)")
def centered_forces(s: MechanismStep, t: float, q: Array, v: Array, half: float) -> None:
    """Compute all that the free motion takes at (t, q), with the effects of velocities half a step later."""
    late, w = s.scales.late, s.room.force_velocity
    # the gyroscopic torques of free bodies are those of the motion up to there
    evaluate_forces(s, t, q, v, half if len(late) else 2.0 * half)
    if len(late):
        # where M has no factor the step itself says so
        move_freely(s, v, half, False, w)
        for k in range(len(v)):
            if not late[k]:
                w[k] = v[k]
        if s.scales.loaded:
            act(s, t, q, w)
        evaluate_effects(s, q, v, w, 2.0 * half)


@kernel("i8(MechanismStep, f8, f8[::1], f8[::1], f8)")
def centered_step(s: MechanismStep, t: float, q: Array, v: Array, h: float) -> int:
    """Write the state after a step of `Centered` from q, v at t; return a code."""
    scales, room, half, n = s.scales, s.room, 0.5 * h, len(v)
    drift, end, middle = room.drift, room.end, room.middle
    for k in range(n):
        drift[k] = h * v[k]
    retract(s.mechanism.calls, q, drift, end)
    frictional, projects, near_margin, margin = len(s.rows.T) > 0, scales.projects, 0.0, 0.0
    if projects:
        near_margin = margin_of(largest_bend(scales.turn_squares, drift), scales.tolerance, scales.length)
        margin = near_margin + 2.0 * scales.reach
    code = active_rows(s.mechanism, s.constraints, q[:0], drift, end, scales.tolerance + margin, s.ahead)
    if code != FOUND:
        return code
    near = room.near[: s.ahead.size[0]]
    count = take_near(s.ahead, scales.tolerance, near_margin, drift, s.rows, near)
    for k in range(n):
        drift[k] = half * v[k]
    retract(s.mechanism.calls, q, drift, middle)
    centered_forces(s, t + half, middle, v, half)
    if count == 0:
        if not move_freely(s, v, h, True, s.v):
            return UNSOLVED
        s.residual[0] = 0.0
        for k in range(n):
            drift[k] = half * s.v[k]
        retract(s.mechanism.calls, middle, drift, s.q)
        return DONE
    change, gap, opened = room.change[:count], room.gap[:count], room.opened[:0]
    row_speeds(s.rows.J, v, half, change)
    bounces = projects and may_bounce(s.rows, change, scales.tolerance)
    for a in range(count):
        gap[a] = s.rows.gap[a]
    code = rows_in_the_middle(s, middle, change)
    if code != FOUND:
        return code
    if projects:
        row_speeds(s.rows.J, v, half, change)
        if not bounces:
            # gaps that lead to those of the end, which the position projection takes to be linear
            for a in range(count):
                s.rows.gap[a] = gap[a] - change[a]
        if write_closing_speeds(
            s.rows.gap[:count], s.rows.lever[:count], change, half, scales.tolerance, room.opened[:count]
        ):
            opened = room.opened[:count]
    if apply_law(s, v, h, True, opened) != DONE:
        return UNSOLVED
    for k in range(n):
        drift[k] = half * s.v[k]
    retract(s.mechanism.calls, middle, drift, s.q)
    if not projects:
        for a in range(count):
            s.rows.gap[a] += half * s.rates[2 * count + a]
        return DONE
    room.margin[0] = margin
    if len(opened) == 0:
        for a in range(count):
            room.opened[a] = 0.0
    if not frictional and not bounces:
        if not move_freely(s, v, h, True, room.free):
            return UNSOLVED
        code = settle(s, end, middle, v, h, near, room.free, margin)
        if code != FAR:
            return code
    return project_positions(s, v, h, near, bounces)

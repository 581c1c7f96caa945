"""A step of `Centered` for a mechanism in one kernel; see `mechanism_steps`."""

from __future__ import annotations

import numpy as np

from ..compiled import kernel
from ..constraints.mechanism_rows import FOUND, MOST_ROWS, RowBuffer, active_rows, append_row
from ..constraints.rows import mutual_nearest
from ..projection.closed_contacts import find_sunk
from ..projection.raise_gaps import largest_travel
from ..projection.settle_positions import PROJECTED, UNDECIDED, settle_positions
from ..projection.tree import advance_by, factor, solve
from ..system.pinocchio_address import crba, retract, tangent
from ..system.system import Array
from .mechanism_steps import BOUNCES, DONE, UNSOLVED, MechanismStep, apply_law, fly
from .nearby_rows import SECOND_ORDER
from .step import NEAR, write_closing_speeds


@kernel("void(f8[:,::1], f8[::1], i8, f8[::1])")
def row_speeds(J: Array, v: Array, count: int, speeds: Array) -> None:
    """Write J v of the first rows."""
    for a in range(count):
        speeds[a] = 0.0
        for k in range(len(v)):
            speeds[a] += J[a, k] * v[k]


@kernel("i8(RowBuffer, f8, RowBuffer, b1[::1])")
def take_near(rows: RowBuffer, reach: float, near_rows: RowBuffer, near: Array) -> int:
    """Copy the rows whose gap is within a length [m]; write which they are and return how many."""
    near_rows.count[0] = 0
    for a in range(rows.count[0]):
        near[a] = rows.lever[a] * rows.gap[a] <= reach
        if near[a]:
            append_row(rows, a, near_rows)
    return near_rows.count[0]


@kernel("i8(MechanismStep, f8[::1], f8[::1])")
def rows_in_the_middle(s: MechanismStep, middle: Array, change: Array) -> int:
    """Replace the rows by those in the middle of a step that correspond to the rows at its end; return a code.

    `middle`, shape (nq,), is the configuration there, and `change`, shape (k,), that of the gaps from there to the end.
    """
    ahead, here, most, m = s.ahead, s.middle, 0.0, s.ahead.count[0]
    for a in range(m):
        most = max(most, abs(ahead.gap[a]) + abs(change[a]))
    # twice the linear estimate, because the gradients change within the step
    reach = s.scales.tolerance + 2.0 * most
    code = active_rows(s.mechanism, s.constraints, middle[:0], s.torque, middle, reach, here)
    if code != FOUND:
        return code
    n, owner, order = here.count[0], np.empty(m, np.int64), np.empty(here.count[0], np.int64)
    for b in range(n):
        # rows are found in the order of their numbers
        order[b] = b
    mutual_nearest(ahead.number[:m], ahead.point[:m], here.number[:n], here.point[:n], order, owner)
    s.rows.count[0] = 0
    for b in range(n):
        matched = False
        for a in range(m):
            matched = matched or owner[a] == b
        if matched:
            append_row(here, b, s.rows)
    # a row without a counterpart in the middle keeps the gradient that it has at the end
    for a in range(m):
        if owner[a] < 0:
            append_row(ahead, a, s.rows)
    return FOUND


@kernel("b1(RowBuffer, f8[::1], f8)")
def may_bounce(rows: RowBuffer, change: Array, tolerance: float) -> bool:
    """Return whether some row may bounce; see `Centered`."""
    for a in range(rows.count[0]):
        rebound = -2.0 * rows.e[a] * change[a] * rows.lever[a]
        if rows.e[a] > 0.0 and (rebound > tolerance or rows.e[a] >= 1.0):
            return True
    return False


@kernel("i8(MechanismStep, f8[::1], f8[::1], f8[::1], f8, b1[::1], f8[::1], f8)")
def settle(
    s: MechanismStep, place_ahead: Array, middle: Array, v: Array, h: float, near: Array, free: Array, margin: float
) -> int:  # fmt: skip
    """Project closed contacts out of penetration after a step; return a code.

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
    known, scales, n, half = s.ahead, s.scales, len(v), 0.5 * h
    m, k, reach = known.count[0], s.rows.count[0], (2.0 * SECOND_ORDER) ** 0.5 * scales.length
    displacement, drift = np.empty(n), np.empty(n)
    tangent(s.mechanism.calls, place_ahead, s.q, displacement)
    if largest_travel(scales.squares, displacement) > reach:
        return BOUNCES
    rates, law, i = np.zeros((4, m)), near.copy(), 0
    for a in range(m):
        if near[a]:
            for r in range(4):
                rates[r, a] = s.rates[r * k + i]
            i += 1
    number, point, J, lever = known.number[:m], known.point[:m], known.J[:m], known.lever[:m]
    gap, e, end, settled = known.gap[:m], known.e[:m].copy(), np.empty(m), np.empty(m, np.bool_)
    depth = find_sunk(
        number, point, J, gap, lever, e, displacement, law, rates, h, half, scales.tolerance, np.empty(m, np.bool_), end,
        np.empty(m), settled,
    )  # fmt: skip
    if depth < 0.0:
        return BOUNCES
    if depth == 0.0:
        i = 0
        for a in range(m):
            if near[a]:
                s.rows.gap[i] = end[a]
                i += 1
        return DONE
    mech = s.mechanism
    L, W, A = np.empty((n, n)), np.empty((m, n)), np.empty((m, n))
    w, moved, sliding, still = s.v.copy(), np.empty(n), np.empty(n), np.zeros(n)
    if factor(mech.mass, 0.0, still, mech.parent, L):
        return UNSOLVED
    solve(L, mech.parent, J, W, A)
    code, residual = settle_positions(
        number, point, J, A, W, gap, lever, e, scales.squares, free, v, w, displacement, law, settled, rates, moved,
        sliding, h, half, scales.tolerance, reach, margin, 0.0,
    )  # fmt: skip
    if code == UNDECIDED:
        return BOUNCES
    same, s.rows.count[0] = True, 0
    for a in range(m):
        same = same and law[a] == near[a]
        known.e[a] = e[a]
        if law[a]:
            append_row(known, a, s.rows)
    k, i = s.rows.count[0], 0
    for a in range(m):
        if law[a]:
            for r in range(4):
                s.rates[r * k + i] = rates[r, a]
            i += 1
    if residual >= 0.0:
        s.memory.size[0] = k
        for a in range(k):
            s.memory.percussion[a] = s.rates[a]
        s.residual[0] = residual
    if not same:
        for j in range(n):
            drift[j] = half * w[j]
        retract(mech.calls, middle, drift, s.q)
    for j in range(n):
        s.v[j] = w[j]
    if code == PROJECTED:
        for j in range(n):
            s.v[j] = sliding[j]
        middle_q = s.q.copy()
        retract(mech.calls, middle_q, moved, s.q)
    return DONE


@kernel("i8(MechanismStep, f8, f8[::1], f8[::1], f8, b1)")
def centered_step(s: MechanismStep, t: float, q: Array, v: Array, h: float, projects: bool) -> int:
    """Write the state after a step of `Centered` from q, v at t; return a code.

    `projects` is its `project_positions`.
    """
    scales, half, n, nq = s.scales, 0.5 * h, len(v), len(q)
    drift, end, middle, force_velocity = np.empty(n), np.empty(nq), np.empty(nq), np.empty(n)
    for k in range(n):
        drift[k] = h * v[k]
    retract(s.mechanism.calls, q, drift, end)
    frictional, margin, reach = len(s.rows.T) > 0, 0.0, 0.0
    if projects:
        reach = (2.0 * SECOND_ORDER) ** 0.5 * scales.length
        if frictional:
            travel = largest_travel(scales.squares, drift)
            margin = max((NEAR - 1.0) * scales.tolerance, travel**2 / scales.length)
    code = active_rows(s.mechanism, s.constraints, q[:0], drift, end, scales.tolerance + (margin + 2.0 * reach), s.ahead)
    if code != FOUND:
        return code
    m, near = s.ahead.count[0], np.empty(MOST_ROWS, np.bool_)
    count = take_near(s.ahead, scales.tolerance + margin, s.rows, near)
    for k in range(n):
        drift[k] = half * v[k]
    retract(s.mechanism.calls, q, drift, middle)
    for k in range(n):
        force_velocity[k] = v[k]
    if not scales.controlled:
        fly(s, t + half, middle, v, h, force_velocity)
        for k in range(n):
            force_velocity[k] = 0.5 * (v[k] + force_velocity[k])
    if count == 0:
        fly(s, t + half, middle, force_velocity, h, s.v)
        s.residual[0] = 0.0
        for k in range(n):
            if not scales.controlled:
                s.v[k] = v[k] + (s.v[k] - force_velocity[k])
            drift[k] = half * s.v[k]
        retract(s.mechanism.calls, middle, drift, s.q)
        return DONE
    change = np.empty(count)
    row_speeds(s.rows.J, v, count, change)
    for a in range(count):
        change[a] *= half
    if projects:
        if may_bounce(s.rows, change, scales.tolerance):
            return BOUNCES
        for a in range(count):
            s.rows.gap[a] -= change[a]
    else:
        code = rows_in_the_middle(s, middle, change)
        if code != FOUND:
            return code
        count = s.rows.count[0]
    opened = np.empty(count if frictional and projects else 0)
    if len(opened) and not write_closing_speeds(
        s.rows.gap[:count], s.rows.lever[:count], change, half, scales.tolerance, opened
    ):
        opened = opened[:0]
    crba(s.mechanism.calls, middle)
    if apply_law(s, t + half, middle, v, force_velocity, h, opened) != DONE:
        return UNSOLVED
    for k in range(n):
        drift[k] = half * s.v[k]
    retract(s.mechanism.calls, middle, drift, s.q)
    if not projects or frictional:
        if projects and sinks(s, end, margin + 2.0 * reach):
            return BOUNCES
        for a in range(count):
            s.rows.gap[a] += half * s.rates[2 * count + a]
        return DONE
    free, mech = np.empty(n), s.mechanism
    if advance_by(mech.mass, mech.damping, mech.parent, v, h, s.torque, mech.effects, np.empty((n, n)), free):
        return UNSOLVED
    return settle(s, end, middle, v, h, near[:m], free, margin + 2.0 * reach)


@kernel("b1(MechanismStep, f8[::1], f8)")
def sinks(s: MechanismStep, place_ahead: Array, margin: float) -> bool:
    """Return whether some gap at the end of the step may be below zero by more than the tolerance.

    `place_ahead`, shape (nq,), is where the rows are known, up to a gap of `margin` beyond the tolerance [m].
    """
    known, n = s.ahead, len(s.v)
    displacement = np.empty(n)
    tangent(s.mechanism.calls, place_ahead, s.q, displacement)
    travel = largest_travel(s.scales.squares, displacement)
    if travel > (2.0 * SECOND_ORDER) ** 0.5 * s.scales.length or travel > margin:
        return True
    for a in range(known.count[0]):
        gap = known.gap[a]
        for k in range(n):
            gap += known.J[a, k] * displacement[k]
        if known.lever[a] * gap < -s.scales.tolerance:
            return True
    return False

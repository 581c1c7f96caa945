"""Kernels that tell which contacts of a step are closed; see `closed_contacts`."""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ...constraints.mechanism.rows import active_rows
from ...constraints.mechanism.tables import FOUND
from ...projection.dense.orthonormal_rows import inner
from ...projection.positions.closed_contacts import is_closed, stays_sunk
from ...projection.tree import solve
from ...system.mechanisms.mechanism import carry
from ...system.system import Array
from ..kernels.records import MechanismStep
from .carried_kernel import carry_along
from .closed_contacts import INDEPENDENT, SAME_CONTACT
from .nearby_kernel import copy_of, copy_rows, match_rows


@kernel("i8(MechanismStep, f8, b1[::1])")
def closed_contacts(s: MechanismStep, h: float, closed: Array) -> int:
    """Find which rows of the law are closed, shape (k,); return a code.

    Parameters
    ----------
    s : MechanismStep
        With the step before position projection, and the factor of M where the law was applied, in `room.middle`. Gaps
        are those there.
    h : float
        Length of the step [s].
    closed : ndarray of bool, shape (k,)
        Receives which are closed.
    """
    rows, k, tolerance, rises, restitution = s.rows, s.rows.size[0], s.scales.tolerance, False, False
    sunk = np.empty(k, np.bool_)
    for a in range(k):
        percussion, rise, fall = (
            s.rates[a],
            h * rows.lever[a] * s.rates[2 * k + a],
            h * rows.lever[a] * s.rates[3 * k + a],
        )
        depth = -rows.lever[a] * (rows.gap[a] + 0.5 * h * s.rates[2 * k + a])
        sunk[a] = stays_sunk(depth, rise, fall, rows.e[a], tolerance)
        closed[a] = sunk[a] or is_closed(percussion, rise, tolerance)
        # at e = 1 every contact that rises bounces
        rises = rises or (rise > tolerance and rows.e[a] < 1.0 and percussion > 0.0)
        restitution = restitution or rows.e[a] != 0.0
    if not restitution:
        # without restitution a contact bears load and does not rise, or it leaves
        return FOUND
    if rises:
        code = close_what_returns(s, h, closed)
        if code != FOUND:
            return code
    open_beside_bounces(s, sunk, closed)
    return FOUND


@kernel("i8(MechanismStep, f8, b1[::1])")
def close_what_returns(s: MechanismStep, h: float, closed: Array) -> int:
    """Close rows that rise after the law if their gap is no larger after a whole step; return a code.

    The arguments are those of `closed_contacts`. `s.middle` is used, and left as it was.
    """
    rows, k, ahead, tolerance = s.rows, s.rows.size[0], s.middle, s.scales.tolerance
    drift, place, lowest, kept = np.empty(len(s.v)), np.empty(len(s.q)), np.empty(k), copy_of(ahead)
    here = copy_of(rows)
    for j in range(len(drift)):
        drift[j] = h * s.v[j]
    carry(s.mechanism, s.room.middle, drift, place)
    code = active_rows(s.mechanism, s.constraints, s.q[:0], drift, place, tolerance, ahead)
    if code == FOUND:
        m = ahead.size[0]
        owner = np.empty(m, np.int64)
        carry_along(s, here, np.ones(k, np.bool_), s.room.middle, place)
        match_rows(ahead, here, owner)
        for a in range(k):
            lowest[a] = np.inf
        for i in range(m):
            a, apart = owner[i], 0.0
            for c in range(3):
                apart += (ahead.point[i, c] - here.point[a, c]) ** 2
            # not another contact of the same pair, such as the edge of a box that sinks while the other rises; joint
            # limits have no place
            if a >= 0 and not np.sqrt(apart) > SAME_CONTACT * s.scales.length:
                lowest[a] = min(lowest[a], ahead.gap[i])
        for a in range(k):
            rises = h * rows.lever[a] * s.rates[2 * k + a] > tolerance and rows.e[a] < 1.0 and s.rates[a] > 0.0
            closed[a] = closed[a] or (rises and rows.lever[a] * lowest[a] <= rows.lever[a] * rows.gap[a] + tolerance)
    copy_rows(kept, ahead)
    return code


@kernel("void(MechanismStep, b1[::1], b1[::1])")
def open_beside_bounces(s: MechanismStep, sunk: Array, closed: Array) -> None:
    """Count rows as open that are coupled to one that bounces, unless they stay sunk.

    To project a contact of a body that bounces at another contact would make the body rock; but one that stays sunk
    would do so as long as the body bounces. The masks have shape (k,).
    """
    rows, k, tolerance, n = s.rows, s.rows.size[0], s.scales.tolerance, len(s.v)
    bounces, some, landed = np.empty(k, np.bool_), False, False
    for a in range(k):
        bounces[a] = not closed[a] and (s.rates[a] > 0.0 or rows.lever[a] * rows.gap[a] < -tolerance)
        some, landed = some or bounces[a], landed or (closed[a] and not sunk[a])
    if not (some and landed):
        return
    W, A, length = np.empty((k, n)), np.empty((k, n)), np.empty(k)
    solve(s.room.L, s.mechanism.parent, rows.J[:k], W, A)
    for a in range(k):
        length[a] = np.sqrt(inner(W[a], W[a]))
    for a in range(k):
        if closed[a] and not sunk[a]:
            for b in range(k):
                if bounces[b] and abs(inner(W[a], W[b])) > INDEPENDENT * length[a] * length[b]:
                    closed[a] = False


@kernel("b1(MechanismStep, f8)")
def bears_or_sinks(s: MechanismStep, h: float) -> bool:
    """Return whether a row of the law bears load, or is below zero by more than the tolerance at the end."""
    rows, k = s.rows, s.rows.size[0]
    for a in range(k):
        depth = -rows.lever[a] * (rows.gap[a] + 0.5 * h * s.rates[2 * k + a])
        if s.rates[a] > 0.0 or depth > s.scales.tolerance:
            return True
    return False


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

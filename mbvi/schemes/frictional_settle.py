"""Projects closed contacts with friction out of penetration in one kernel, where no row joins.

The kernel does what `project_positions` does there, which is its reference. Where anything else is needed it returns
`BOUNCES`, and the step is left to that. Without friction it finds out whether contacts have sunk that have moved far.
"""

from __future__ import annotations

from ..compiled import kernel
from ..constraints.mechanism_tables import copy_row
from ..system.system import Array
from .frictional_raise import raise_and_follow
from .frictional_sunk import bears_or_sinks, closed_contacts, find_sunk_contacts, known_gaps, search_at_end, some_below
from .mechanism_steps import BOUNCES, DONE, MechanismStep


@kernel("i8(MechanismStep, f8[::1], f8, b1[::1], f8)")
def settle_with_friction(s: MechanismStep, v: Array, h: float, near: Array, margin: float) -> int:
    """Project closed contacts out of penetration after a step of `Centered` with friction; return a code.

    Parameters
    ----------
    s : MechanismStep
        With the step before position projection, and all rows that are known, those of `room.end`. The gaps of the
        law's rows are those where it was applied.
    v : ndarray, shape (nv,)
        The velocity before the law.
    h : float
        Length of the step [s].
    near : ndarray of bool, shape (m,)
        Which of the known rows are those of the law.
    margin : float
        How far beyond the tolerance the rows are known [m].
    """
    room, k, reach, depth, some, i = s.room, s.rows.size[0], s.scales.reach, 0.0, False, 0
    travel = known_gaps(s, s.q)
    far = not travel < reach or travel > margin
    if far or some_below(s):
        if not closed_contacts(s, h, room.closed[:k]):
            return BOUNCES
        some = not far or bears_or_sinks(s, h)
    if some:
        # the rows of the law as they are at the end
        s.middle.size[0] = 0
        for a in range(len(near)):
            if near[a]:
                copy_row(s.ahead, a, s.middle)
    if some and far:
        code = search_at_end(s, v, h)
        if code != DONE:
            return code
        known_gaps(s, s.q)
        margin = 2.0 * reach
    elif some:
        for a in range(len(near)):
            room.owner[a] = i if near[a] else -1
            i += near[a]
    if some:
        depth = find_sunk_contacts(s)
    # without friction `settle` raises contacts, where bodies have not moved far
    if depth < 0.0 or (depth > 0.0 and len(s.rows.T) == 0):
        return BOUNCES
    if depth > 0.0:
        return raise_and_follow(s, v, h, margin, depth, far)
    for a in range(k):
        s.rows.gap[a] += 0.5 * h * s.rates[2 * k + a]
    return DONE

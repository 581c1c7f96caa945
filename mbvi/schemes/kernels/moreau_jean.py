"""A step of `MoreauJean` for a mechanism in one kernel; see `phases`."""

from __future__ import annotations

from ...compiled import kernel
from ...system.system import Array
from .phases import find, jump, move
from .records import DONE, MechanismStep


@kernel("i8(MechanismStep, f8, f8[::1], f8[::1], f8)")
def moreau_jean_step(s: MechanismStep, t: float, q: Array, v: Array, h: float) -> int:
    """Write the state after a step of `MoreauJean` from q, v at t; return a code."""
    before, after = (1.0 - s.scales.theta) * h, s.scales.theta * h
    move(s, q, v, before, s.room.middle)
    code = find(s, t + before, s.room.middle)
    if code == DONE:
        code = jump(s, t + before, s.room.middle, v, h)
    if code != DONE:
        return code
    move(s, s.room.middle, s.v, after, s.q)
    m = s.rows.size[0]
    for a in range(m):
        s.rows.gap[a] += after * s.rates[2 * m + a]
    return DONE

"""A step of `Paoli` for a mechanism in one kernel; see `phases`."""

from __future__ import annotations

from ...compiled import kernel
from ...constraints.mechanism.rows import active_rows
from ...system.system import Array
from .phases import jump, move
from .records import DONE, MechanismStep


@kernel("i8(MechanismStep, f8, f8[::1], f8[::1], f8)")
def paoli_step(s: MechanismStep, t: float, q: Array, v: Array, h: float) -> int:
    """Write the state after a step of `Paoli` from q, v at t; return a code."""
    move(s, q, v, h, s.q)
    s.constraints.given.time[0] = t + h
    # how far the bodies have moved since the last query is h v
    code = active_rows(s.mechanism, s.constraints, q, s.room.drift, s.q, s.scales.tolerance, s.rows)
    if code != DONE:
        return code
    return jump(s, t + h, s.q, v, h)

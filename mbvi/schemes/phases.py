"""Phases of a step as kernels: what schemes that are kernels are made of.

A scheme is a kernel that calls phases in its own order on one `MechanismStep`; see docs/howto/own_scheme.md. A phase
that returns a code other than `DONE` ends the step with it.
"""

from __future__ import annotations

from ..compiled import kernel
from ..constraints.mechanism_rows import active_rows
from ..system.pinocchio_address import retract
from ..system.system import Array
from .mechanism_steps import DONE, MechanismStep, apply_law, evaluate_forces, fly

__all__ = ["DONE", "Array", "MechanismStep", "find", "jump", "kernel", "move"]


@kernel("void(MechanismStep, f8[::1], f8[::1], f8, f8[::1])")
def move(s: MechanismStep, q: Array, v: Array, h: float, to: Array) -> None:
    """Write the configuration q + h v by the retraction, shape (nq,)."""
    drift = s.room.drift
    for k in range(len(v)):
        drift[k] = h * v[k]
    retract(s.mechanism.calls, q, drift, to)


@kernel("i8(MechanismStep, f8[::1])")
def find(s: MechanismStep, q: Array) -> int:
    """Find the active rows at q, in `s.rows`; return a code."""
    return active_rows(s.mechanism, s.constraints, q[:0], s.room.drift, q, s.scales.tolerance, s.rows)


@kernel("i8(MechanismStep, f8, f8[::1], f8[::1], f8)")
def jump(s: MechanismStep, t: float, q: Array, v: Array, h: float) -> int:
    """Write to `s.v` the velocity after forces at (t, q, v) for a time h and the law for `s.rows`; return a code."""
    if s.rows.size[0] == 0:
        s.residual[0] = 0.0
        fly(s, t, q, v, h, s.v)
        return DONE
    evaluate_forces(s, t, q, v, h)
    return apply_law(s, v, h, False, q[:0])

"""Phases of a step as kernels: what schemes that are kernels are made of.

A scheme is a kernel that calls phases in its own order on one `MechanismStep`; see docs/howto/own_scheme.md. A phase
that returns a code other than `DONE` ends the step with it: the step is then left to the scheme's own method, which
starts from the same state; the caches of distances and the percussions of the last projection are such that it gives
the same.
"""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ...constraints.mechanism.rows import active_rows
from ...constraints.mechanism.tables import RowBuffer
from ...projection.coulomb.few_contacts import MOST_CONTACTS
from ...projection.coulomb.friction import AIM, EXACT
from ...projection.coulomb.frictional_step import frictional_law_of_rows
from ...projection.coulomb.law import COMPLIANT, NOTHING, UNIQUE
from ...projection.dense.fused_step import FEW
from ...projection.dense.robot_step import law_of_rows, newton_law
from ...projection.row_speeds import row_speeds
from ...projection.tree import advance_by, factor_again
from ...projection.tree_factor import DEPENDENT, keep_equalities, span_equalities
from ...system.control_table import write_torque
from ...system.free.spinning import spin_effects
from ...system.mechanisms.mechanism import carry, evaluate_nonlinear_effects, weigh
from ...system.system import Array
from .joint_friction import apply_joint_friction, bounded_coulomb, joints_with_friction
from .records import DONE, UNSOLVED, MechanismStep

__all__ = [
    "DONE", "Array", "MechanismStep", "act", "apply_law", "evaluate_effects", "evaluate_forces", "find", "fly",
    "has_friction", "jump", "kernel", "move", "move_freely",
]  # fmt: skip


@kernel("void(MechanismStep, f8, f8[::1], f8[::1])")
def act(s: MechanismStep, t: float, q: Array, v: Array) -> None:
    """Write the torques of the control; those of other parts of the system stay zero."""
    begin, end = s.acted[2], s.acted[3]
    write_torque(s.control, t, q[s.acted[0] : s.acted[1]], v[begin:end], s.room.torque[begin:end])


@kernel("void(MechanismStep, f8, f8[::1], f8[::1], f8, f8[::1])")
def fly(s: MechanismStep, t: float, q: Array, v: Array, h: float, w: Array) -> None:
    """Write the velocity after a time h in flight; NaN where the mass matrix is not positive definite.

    Forces act, and dry friction of joints.
    """
    evaluate_forces(s, t, q, v, h)
    if not (move_freely(s, v, h, False, w) and apply_joint_friction(s, h, w)):
        w[0] = np.nan


@kernel("void(MechanismStep, f8, f8[::1], f8[::1], f8)")
def evaluate_forces(s: MechanismStep, t: float, q: Array, v: Array, h: float) -> None:
    """Compute all that the free motion takes at (t, q, v), for a time h."""
    act(s, t, q, v)
    weigh(s.mechanism, q)
    evaluate_effects(s, q, v, v, h)


@kernel("void(MechanismStep, f8[::1], f8[::1], f8[::1], f8)")
def evaluate_effects(s: MechanismStep, q: Array, v: Array, at: Array, h: float) -> None:
    """Compute the nonlinear effects at the velocity `at`; of free bodies those of a step from v of a length h."""
    m = s.mechanism
    evaluate_nonlinear_effects(m, q, at)
    if len(m.free.first):
        spin_effects(m.free, v, at, h, s.room.torque, m.effects)


@kernel("b1(MechanismStep, f8[::1], f8, b1, f8[::1])")
def move_freely(s: MechanismStep, v: Array, h: float, twice: bool, w: Array) -> bool:
    """Write the velocity after a time h under the forces that were evaluated last; False where M has no factor.

    Dry friction of joints does not act; see `apply_joint_friction`. `twice` is that of `advance_by`, and then the
    damping that in the room.
    """
    m, room = s.mechanism, s.room
    damping, known = room.damping if twice else m.damping, room.damped[: room.known[0]]
    bad = advance_by(
        m.mass, damping, m.parent, v, h, room.torque, m.effects, twice, known, room.L, room.changes, w
    )  # fmt: skip
    return bad == 0


@kernel("b1(MechanismStep, f8[::1], f8, b1)")
def write_free_motion(s: MechanismStep, v: Array, h: float, twice: bool) -> bool:
    """Write the free motion of v, and the factor of M where the mechanism is placed; False where M has none.

    `twice` is that of `advance_by`.
    """
    m, room = s.mechanism, s.room
    return move_freely(s, v, h, twice, room.free) and factor_again(m.mass, m.damping, m.parent, twice, room.L) == 0


@kernel("b1(RowBuffer)")
def has_friction(rows: RowBuffer) -> bool:
    """Return whether some row has friction."""
    for a in range(rows.size[0] if len(rows.T) > 0 else 0):
        if rows.mu[a] > 0.0:
            return True
    return False


@kernel("i8(MechanismStep, f8[::1], f8, f8[::1])")
def apply_law_with_joints(s: MechanismStep, v: Array, h: float, opened: Array) -> int:
    """Do what `apply_law` does where joints have dry friction, contacts torsional or rolling friction, or are many.

    The room has the free motion and the factor of M.
    """
    rows, k = s.rows, s.rows.size[0]
    lower, p = np.empty(k), np.empty((k, 6))
    newton_law(rows.J[:k], v, rows.e[:k], opened, lower, s.rates[: 4 * k].reshape((4, k)))
    code = bounded_coulomb(s, rows, s.room.free, lower, h, EXACT * s.scales.residual, s.v, p)
    if code == DONE:
        write_rates_of(s, rows, v, p)
    return code


@kernel("void(MechanismStep, RowBuffer, f8[::1], i8)")
def write_rates_at(s: MechanismStep, rows: RowBuffer, v: Array, r: int) -> None:
    """Write the rates of rows at a velocity, shape (nv,), to place r of `rates`, `slip` and `turn`."""
    k = rows.size[0]
    row_speeds(rows.J, v, 1.0, s.rates[r * k : (r + 1) * k])
    if len(rows.T) > 0:
        row_speeds(rows.T, v, 1.0, s.slip[2 * r * k : 2 * (r + 1) * k])
    if len(rows.R) > 0:
        row_speeds(rows.R, v, 1.0, s.turn[3 * r * k : 3 * (r + 1) * k])


@kernel("void(MechanismStep, RowBuffer, f8[::1])")
def write_rates(s: MechanismStep, rows: RowBuffer, v: Array) -> None:
    """Write the rates of rows under forces alone, after and before the law; v, shape (nv,), is the velocity before."""
    write_rates_at(s, rows, s.room.free, 1)
    write_rates_at(s, rows, s.v, 2)
    write_rates_at(s, rows, v, 3)


@kernel("void(MechanismStep, RowBuffer, f8[::1], f8[:,::1])")
def write_rates_of(s: MechanismStep, rows: RowBuffer, v: Array, p: Array) -> None:
    """Write percussions p, shape (k, 6), and the rates of rows under forces alone, after and before the law."""
    k = rows.size[0]
    for a in range(k):
        s.rates[a] = p[a, 0]
        for c in range(2 if len(rows.T) > 0 else 0):
            s.slip[2 * a + c] = p[a, 1 + c]
        for c in range(3 if len(rows.R) > 0 else 0):
            s.turn[3 * a + c] = p[a, 3 + c]
    write_rates(s, rows, v)


@kernel("void(MechanismStep, f8[::1])")
def take_along_equalities(s: MechanismStep, v: Array) -> None:
    """Keep of the free motion and of v what keeps the equalities; `room.across` has what the free motion loses."""
    room, parent = s.room, s.mechanism.parent
    for k in range(len(v)):
        room.across[k] = room.free[k]
    keep_equalities(room.L, parent, room.free)
    keep_equalities(room.L, parent, v)
    for k in range(len(v)):
        room.across[k] -= room.free[k]


@kernel("void(MechanismStep, f8[::1], f8[::1])")
def keep_those_at(s: MechanismStep, q: Array, v: Array) -> None:
    """Let the room's factor of M keep the equalities at q, and the free motion and v what keeps them there."""
    m, L = s.mechanism, s.room.L
    weigh(m, q)
    span_equalities(m.mass, m.parent, DEPENDENT, L, L[:0])
    keep_equalities(L, m.parent, s.room.free)
    keep_equalities(L, m.parent, v)


@kernel("void(MechanismStep)")
def add_across(s: MechanismStep) -> None:
    """Add to the velocity after the law what does not keep the equalities; see `along_equalities`."""
    for k in range(len(s.v)):
        s.v[k] += s.room.across[k]


@kernel("i8(MechanismStep, f8[::1], f8, b1, f8[::1])")
def apply_law(s: MechanismStep, v: Array, h: float, twice: bool, opened: Array) -> int:
    """Write the velocity, the rates and the residual that the law gives, where there are rows; return a code.

    The room then has the free motion and the factor of M.

    Parameters
    ----------
    s : MechanismStep
        With the rows of the law, where the law acts, and the forces there.
    v : ndarray, shape (nv,)
        The velocity before. With `twice` it keeps afterwards only what keeps the equalities.
    h : float
        Length of the step [s].
    twice : bool
        See `advance_by`, and `along_equalities` for the law.
    opened : ndarray, shape (k,) or (0,)
        See `closing_speeds`.
    """
    if not write_free_motion(s, v, h, twice):
        return UNSOLVED
    held = twice and len(s.mechanism.equalities.gap) > 0
    if held:
        take_along_equalities(s, v)
    code = apply_law_of_rows(s, v, h, opened)
    if held and code == DONE:
        add_across(s)
    return code


@kernel("i8(MechanismStep, f8[::1], f8, f8[::1])")
def apply_law_of_rows(s: MechanismStep, v: Array, h: float, opened: Array) -> int:
    """Do what `apply_law` does, where the room has the free motion and the factor of M."""
    m, rows, memory, k = s.mechanism, s.rows, s.memory, s.rows.size[0]
    limit = 0.0 if k <= FEW else 1e-3 * s.scales.residual
    J, e, rates = rows.J[:k], rows.e[:k], s.rates[: 4 * k].reshape((4, k))
    rough = has_friction(rows)
    if joints_with_friction(m.friction) > 0 or (rough and (len(rows.R) > 0 or k > MOST_CONTACTS)):
        return apply_law_with_joints(s, v, h, opened)
    if not rough:
        last = memory.percussion[: memory.size[0]]
        found = law_of_rows(s.room.L, m.parent, s.room.free, v, J, e, opened, last, limit, s.v, rates)
        # written so that a NaN is refused too
        if not 0.0 <= found < np.inf:
            return UNSOLVED
        memory.size[0] = k
        for a in range(k):
            memory.percussion[a] = rates[0, a]
        # tangents of rows without friction are zero
        for i in range(min(8 * k, len(s.slip))):
            s.slip[i] = 0.0
        for i in range(min(12 * k, len(s.turn))):
            s.turn[i] = 0.0
        s.residual[0] = found
        return DONE
    known, start, slip = NOTHING, memory.start[: 3 * k], s.slip[: 8 * k].reshape((4, k, 2))
    if memory.size[1] == 3 * k:
        known = UNIQUE if memory.size[2] else COMPLIANT
    else:
        for i in range(3 * k):
            start[i] = 0.0
    found, unique = frictional_law_of_rows(
        s.room.L, m.parent, s.room.free, v, J, rows.T[: 2 * k], e, opened[:0], opened, rows.mu[:k], known, AIM, start,
        s.v, rates, slip,
    )  # fmt: skip
    # Python checks each row of the others
    if not 0.0 <= found <= EXACT * s.scales.residual:
        return UNSOLVED
    memory.size[1], memory.size[2], s.residual[0] = 3 * k, 1 if unique else 0, found
    return DONE


@kernel("void(MechanismStep, f8[::1], f8[::1], f8, f8[::1])")
def move(s: MechanismStep, q: Array, v: Array, h: float, to: Array) -> None:
    """Write the configuration q + h v by the retraction, shape (nq,)."""
    drift = s.room.drift
    for k in range(len(v)):
        drift[k] = h * v[k]
    carry(s.mechanism, q, drift, to)


@kernel("i8(MechanismStep, f8, f8[::1])")
def find(s: MechanismStep, t: float, q: Array) -> int:
    """Find the active rows at (t, q), in `s.rows`; return a code."""
    s.constraints.given.time[0] = t
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

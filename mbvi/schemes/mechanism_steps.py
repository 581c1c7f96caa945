"""One step of a mechanism in one kernel: what `Paoli.step`, `Centered.step` and `MoreauJean.step` do, with few rows.

A kernel returns a code. Where that is not `DONE`, the step is left to the scheme's own method, which starts from the
same state; the caches of distances and the percussions of the last projection are such that it gives the same.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..compiled import kernel, record
from ..constraints.mechanism_rows import MechanismConstraints, active_rows
from ..constraints.mechanism_tables import FOUND, MOST_ROWS, RowBuffer
from ..projection.coulomb import MOST_CONTACTS
from ..projection.coulomb_law import COMPLIANT, NOTHING, UNIQUE
from ..projection.friction import AIM, EXACT
from ..projection.frictional_step import frictional_tree_law
from ..projection.fused_step import FEW
from ..projection.robot_step import tree_law
from ..projection.tree import advance_by
from ..system.control_table import ControlTable, write_torque
from ..system.free_body_table import FreeBodyTable
from ..system.mechanism import Mechanism, evaluate_nonlinear_effects, weigh
from ..system.pinocchio_address import retract
from ..system.spinning import spin_effects
from ..system.system import Array

# what a step kernel returns, beside the codes of `active_rows`: done; the law is not solved; with `StewartTrinkle` the
# end of the step takes searches
DONE, UNSOLVED, BOUNCES = FOUND, 3, 4


@record("f8[::1], f8[::1], i8[::1]")
class LawMemory(NamedTuple):
    """What the law starts from.

    Attributes
    ----------
    percussion : ndarray, shape (MOST_ROWS,)
        Percussions of the last projection.
    start : ndarray, shape (3 MOST_ROWS,)
        The start of Coulomb's law, as of `FrictionalStart`.
    size : ndarray of int, shape (3,)
        How many entries both have, and whether the answer at the start was unique.
    """

    percussion: Array
    start: Array
    size: Array


@record("f8, f8, f8, f8, f8[:,::1], f8[:,::1], b1[::1], i8[::1], f8, b1, b1")
class Scales(NamedTuple):
    """Numbers of a problem and of a scheme.

    Attributes
    ----------
    tolerance, length : float
        Activation tolerance and length of the scene [m].
    reach : float
        Travel below which gaps count as linear [m].
    residual : float
        Relative residual that a projection may have.
    squares, turn_squares : ndarray, shape (families, nv)
        As of `ClearanceCache`.
    late : ndarray of bool, shape (nv,) or (0,)
        The velocities at which `Centered` evaluates forces half a step later; of no size where there are none.
    part : ndarray of int, shape (nv,)
        As of `independent_parts`.
    theta : float
        Of `MoreauJean`.
    projects : bool
        `project_positions` of `Centered`.
    loaded : bool
        Whether forces from outside act.
    """

    tolerance: float
    length: float
    reach: float
    residual: float
    squares: Array
    turn_squares: Array
    late: Array
    part: Array
    theta: float
    projects: bool
    loaded: bool


@record(
    "f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[:,::1], f8[::1], f8[::1], f8[:,::1], f8[:,::1],"
    " f8[:,::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], i8[::1], i8[::1], b1[::1], b1[::1], b1[::1],"
    " b1[::1]"
)
class Room(NamedTuple):
    """Room within a step: kernels that make no arrays are faster.

    Attributes
    ----------
    torque, drift, force_velocity, free, displacement, moved, tangent : ndarray, shape (nv,)
        Tangent vectors.
    changes : ndarray, shape (2, nv)
        Room of `advance_by`.
    end, middle : ndarray, shape (nq,)
        Configurations.
    L, A, W : ndarray, shapes (nv, nv), (MOST_ROWS, nv), (MOST_ROWS, nv)
        Factor of the mass matrix, and rows solved with it.
    change, opened, gap, bound : ndarray, shape (MOST_ROWS,)
        Of rows.
    table : ndarray, shape (8 MOST_ROWS,)
        Several numbers of each row.
    margin : ndarray, shape (1,)
        How far beyond the tolerance rows are known [m].
    owner, order : ndarray of int, shape (MOST_ROWS,)
        Rows.
    near, law, closed, settled : ndarray of bool, shape (MOST_ROWS,)
        Masks of rows.
    """

    torque: Array
    drift: Array
    force_velocity: Array
    free: Array
    displacement: Array
    moved: Array
    tangent: Array
    changes: Array
    end: Array
    middle: Array
    L: Array
    A: Array
    W: Array
    change: Array
    opened: Array
    gap: Array
    bound: Array
    table: Array
    margin: Array
    owner: Array
    order: Array
    near: Array
    law: Array
    closed: Array
    settled: Array


def room(nq: int, nv: int) -> Room:
    """Return room for a mechanism."""
    tangents, places = np.zeros((7, nv)), np.zeros((2, nq))
    matrices = np.zeros((nv, nv)), np.zeros((MOST_ROWS, nv)), np.zeros((MOST_ROWS, nv))
    floats, table, margin = np.zeros((4, MOST_ROWS)), np.zeros(8 * MOST_ROWS), np.zeros(1)
    numbers, masks = np.zeros((2, MOST_ROWS), np.int64), np.zeros((4, MOST_ROWS), bool)
    fields: Any = *tangents, np.zeros((2, nv)), *places, *matrices, *floats, table, margin, *numbers, *masks
    return Room(*fields)


@record(
    "Mechanism, FreeBodyTable, MechanismConstraints, LawMemory, Scales, ControlTable, i8[::1], Room, RowBuffer,"
    " RowBuffer, RowBuffer, f8[::1], f8[::1], f8[::1], f8[::1], f8[::1]"
)
class MechanismStep(NamedTuple):
    """A mechanism with its constraints, and room for one step.

    Attributes
    ----------
    mechanism, bodies, constraints, memory, scales, control
        What steps; `bodies` are those parts of the mechanism that are free bodies.
    acted : ndarray of int, shape (4,)
        Where the coordinates that the control knows begin and end in q, and in v.
    room : Room
        Room within the step.
    rows : RowBuffer
        Receives the rows of the law; their gaps are those at the end of the step.
    ahead, middle : RowBuffer
        Room for the rows elsewhere in the step.
    q, v : ndarray, shapes (nq,) and (nv,)
        Receive the state after the step.
    rates : ndarray, shape (4 MOST_ROWS,)
        Receives the rates of the rows as of `Step`, one after the other, in its first 4 k places.
    slip : ndarray, shape (8 MOST_ROWS,)
        Receives `Step.slip` in the same way; of no size without friction.
    residual : ndarray, shape (1,)
        Receives the relative residual of the law.
    """

    mechanism: Mechanism
    bodies: FreeBodyTable
    constraints: MechanismConstraints
    memory: LawMemory
    scales: Scales
    control: ControlTable
    acted: Array
    room: Room
    rows: RowBuffer
    ahead: RowBuffer
    middle: RowBuffer
    q: Array
    v: Array
    rates: Array
    slip: Array
    residual: Array


@kernel("void(MechanismStep, f8, f8[::1], f8[::1])")
def act(s: MechanismStep, t: float, q: Array, v: Array) -> None:
    """Write the torques of the control; those of other parts of the system stay zero."""
    begin, end = s.acted[2], s.acted[3]
    write_torque(s.control, t, q[s.acted[0] : s.acted[1]], v[begin:end], s.room.torque[begin:end])


@kernel("void(MechanismStep, f8, f8[::1], f8[::1], f8, f8[::1])")
def fly(s: MechanismStep, t: float, q: Array, v: Array, h: float, w: Array) -> None:
    """Write the velocity after a time h under forces alone; NaN where the mass matrix is not positive definite."""
    evaluate_forces(s, t, q, v, h)
    if not move_freely(s, v, h, False, w):
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

    `twice` is that of `advance_by`.
    """
    m, room = s.mechanism, s.room
    bad = advance_by(m.mass, m.damping, m.parent, v, h, room.torque, m.effects, twice, room.L, room.changes, w)
    return bad == 0


@kernel("b1(RowBuffer)")
def has_friction(rows: RowBuffer) -> bool:
    """Return whether some row has friction."""
    for a in range(rows.size[0] if len(rows.T) > 0 else 0):
        if rows.mu[a] > 0.0:
            return True
    return False


@kernel("i8(MechanismStep, f8[::1], f8, b1, f8[::1])")
def apply_law(s: MechanismStep, v: Array, h: float, twice: bool, opened: Array) -> int:
    """Write the velocity, the rates and the residual that the law gives, where there are rows; return a code.

    Parameters
    ----------
    s : MechanismStep
        With the rows of the law, where the law acts, and the forces there.
    v : ndarray, shape (nv,)
        The velocity before.
    h : float
        Length of the step [s].
    twice : bool
        As of `advance_by`.
    opened : ndarray, shape (k,) or (0,)
        As of `closing_speeds`.
    """
    m, rows, memory, k = s.mechanism, s.rows, s.memory, s.rows.size[0]
    limit = 0.0 if k <= FEW else 1e-3 * s.scales.residual
    J, e, rates = rows.J[:k], rows.e[:k], s.rates[: 4 * k].reshape((4, k))
    if not has_friction(rows):
        last = memory.percussion[: memory.size[0]]
        found = tree_law(
            m.mass, m.damping, m.parent, v, h, s.room.torque, m.effects, twice, J, e, opened, last, limit, s.v, rates
        )
        # written so that a NaN is refused too
        if not 0.0 <= found < np.inf:
            return UNSOLVED
        memory.size[0] = k
        for a in range(k):
            memory.percussion[a] = rates[0, a]
        # tangents of rows without friction are zero
        for i in range(min(8 * k, len(s.slip))):
            s.slip[i] = 0.0
        s.residual[0] = found
        return DONE
    if k > MOST_CONTACTS:
        return UNSOLVED
    known, start, slip = NOTHING, memory.start[: 3 * k], s.slip[: 8 * k].reshape((4, k, 2))
    if memory.size[1] == 3 * k:
        known = UNIQUE if memory.size[2] else COMPLIANT
    else:
        for i in range(3 * k):
            start[i] = 0.0
    found, unique = frictional_tree_law(
        m.mass, m.damping, m.parent, v, h, s.room.torque, m.effects, twice, J, rows.T[: 2 * k], e, opened[:0],
        opened, rows.mu[:k], known, AIM, start, s.v, rates, slip,
    )  # fmt: skip
    # Python checks each row of the others
    if not 0.0 <= found <= EXACT * s.scales.residual:
        return UNSOLVED
    memory.size[1], memory.size[2], s.residual[0] = 3 * k, 1 if unique else 0, found
    return DONE


@kernel("i8(MechanismStep, f8, f8[::1], f8[::1], f8)")
def paoli_step(s: MechanismStep, t: float, q: Array, v: Array, h: float) -> int:
    """Write the state after a step of `Paoli` from q, v at t; return a code."""
    drift = s.room.drift
    for k in range(len(v)):
        drift[k] = h * v[k]
    retract(s.mechanism.calls, q, drift, s.q)
    code = active_rows(s.mechanism, s.constraints, q, drift, s.q, s.scales.tolerance, s.rows)
    if code != FOUND:
        return code
    if s.rows.size[0] == 0:
        s.residual[0] = 0.0
        fly(s, t + h, s.q, v, h, s.v)
        return DONE
    evaluate_forces(s, t + h, s.q, v, h)
    return apply_law(s, v, h, False, drift[:0])


@kernel("i8(MechanismStep, f8, f8[::1], f8[::1], f8)")
def moreau_jean_step(s: MechanismStep, t: float, q: Array, v: Array, h: float) -> int:
    """Write the state after a step of `MoreauJean` from q, v at t; return a code."""
    theta, before = s.scales.theta, (1.0 - s.scales.theta) * h
    drift, middle = s.room.drift, s.room.middle
    for k in range(len(v)):
        drift[k] = before * v[k]
    retract(s.mechanism.calls, q, drift, middle)
    code = active_rows(s.mechanism, s.constraints, q[:0], drift, middle, s.scales.tolerance, s.rows)
    if code != FOUND:
        return code
    count = s.rows.size[0]
    if count == 0:
        s.residual[0] = 0.0
        fly(s, t + before, middle, v, h, s.v)
    else:
        evaluate_forces(s, t + before, middle, v, h)
        if apply_law(s, v, h, False, drift[:0]) != DONE:
            return UNSOLVED
    for k in range(len(v)):
        drift[k] = theta * h * s.v[k]
    retract(s.mechanism.calls, middle, drift, s.q)
    for a in range(count):
        s.rows.gap[a] += theta * h * s.rates[2 * count + a]
    return DONE

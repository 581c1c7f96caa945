"""The records of a step of a mechanism in one kernel: what the kernels of schemes and their phases work on."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ...compiled import record
from ...constraints.mechanism.rows import MechanismConstraints
from ...constraints.mechanism.tables import FOUND, MOST_ROWS, RowBuffer
from ...constraints.mechanism.walls import PrescribedJoints
from ...system.control_table import ControlTable
from ...system.free.free_body_table import FreeBodyTable
from ...system.mechanisms.mechanism import Mechanism
from ...system.system import Array

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
        The start of Coulomb's law; see `FrictionalStart`.
    size : ndarray of int, shape (3,)
        How many entries both have, and whether the answer at the start was unique.
    """

    percussion: Array
    start: Array
    size: Array


@record("f8, f8, f8, f8[:,::1], f8[:,::1], b1[::1], i8[::1], i8[::1], f8[::1], f8, b1, b1")
class Scales(NamedTuple):
    """Numbers of a problem and of a scheme.

    Attributes
    ----------
    tolerance, length : float
        Activation tolerance and length of the scene [m].
    residual : float
        Relative residual that a projection may have.
    squares, turn_squares : ndarray, shape (families, nv)
        See `ClearanceCache`.
    late : ndarray of bool, shape (nv,) or (0,)
        The velocities at which `Centered` evaluates forces half a step later; of no size where there are none.
    part : ndarray of int, shape (n,)
        See `independent_parts`; without joints of walls, which belong to no part.
    part_of_body : ndarray of int, shape (n,)
        See `parts_of_bodies`.
    reach : ndarray, shape (parts,)
        See `linear_reach`.
    theta : float
        Of `MoreauJean`.
    projects : bool
        `project_positions` of `Centered`.
    loaded : bool
        Whether forces from outside act.
    """

    tolerance: float
    length: float
    residual: float
    squares: Array
    turn_squares: Array
    late: Array
    part: Array
    part_of_body: Array
    reach: Array
    theta: float
    projects: bool
    loaded: bool


@record(
    "f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[:,::1],"
    " f8[::1], f8[::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1],"
    " f8[::1], f8[::1], i8[::1], i8[::1], i8[::1], b1[::1], b1[::1], b1[::1], b1[::1]"
)
class Room(NamedTuple):
    """Room within a step: kernels that make no arrays are faster.

    Attributes
    ----------
    torque, drift, force_velocity, free, displacement, moved, tangent : ndarray, shape (nv,)
        Tangent vectors.
    before, after, across, damping : ndarray, shape (nv,)
        Of `Centered` the velocity in the middle of the step before the law, and that at its end; what does not keep the
        equalities of the one after the law; the damping of the step.
    changes : ndarray, shape (2, nv)
        Room of `advance_by`.
    end, middle : ndarray, shape (nq,)
        Configurations.
    L, A, W : ndarray, shapes (nv + m, nv), (MOST_ROWS, nv), (MOST_ROWS, nv)
        Factor of the mass matrix and basis of the equalities, and rows solved with it.
    damped : ndarray, shape (nv + m, nv)
        The same of M + h D / 2.
    change, opened, gap, bound : ndarray, shape (MOST_ROWS,)
        Of rows.
    table : ndarray, shape (8 MOST_ROWS,)
        Several numbers of each row.
    margins : ndarray, shape (parts,)
        Of each mechanism and free body how far beyond the tolerance rows are known, less twice `Scales.reach`; of
        `StewartTrinkle` its reach [m].
    bouncing : ndarray, shape (parts,)
        See `parts_that_bounce`.
    known : ndarray of int, shape (1,)
        How many rows of `damped` belong to this step: all or none.
    owner, order : ndarray of int, shape (MOST_ROWS,)
        Rows.
    near, law, closed, bounces : ndarray of bool, shape (MOST_ROWS,)
        Masks of rows.
    """

    torque: Array
    drift: Array
    force_velocity: Array
    free: Array
    displacement: Array
    moved: Array
    tangent: Array
    before: Array
    after: Array
    across: Array
    damping: Array
    changes: Array
    end: Array
    middle: Array
    L: Array
    A: Array
    W: Array
    damped: Array
    change: Array
    opened: Array
    gap: Array
    bound: Array
    table: Array
    margins: Array
    bouncing: Array
    known: Array
    owner: Array
    order: Array
    near: Array
    law: Array
    closed: Array
    bounces: Array


def room(nq: int, nv: int, equalities: int, parts: int) -> Room:
    """Return room for a mechanism of some parts, with some rows of equalities."""
    tangents, places = np.zeros((11, nv)), np.zeros((2, nq))
    factors, solved = np.zeros((2, nv + equalities, nv)), np.zeros((2, MOST_ROWS, nv))
    floats, table, of_parts = np.zeros((4, MOST_ROWS)), np.zeros(8 * MOST_ROWS), np.zeros((2, parts))
    numbers, masks = np.zeros((2, MOST_ROWS), np.int64), np.zeros((4, MOST_ROWS), bool)
    matrices: Any = factors[0], *solved, factors[1]
    known = np.zeros(1, np.int64)
    fields: Any = *tangents, np.zeros((2, nv)), *places, *matrices, *floats, table, *of_parts, known, *numbers, *masks
    return Room(*fields)


@record(
    "Mechanism, FreeBodyTable, MechanismConstraints, LawMemory, Scales, PrescribedJoints, ControlTable, i8[::1], Room,"
    " RowBuffer, RowBuffer, RowBuffer, f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[:,::1], i8[::1],"
    " b1[::1]"
)
class MechanismStep(NamedTuple):
    """A mechanism with its constraints, and room for one step.

    Attributes
    ----------
    mechanism, bodies, constraints, memory, scales, prescribed, control
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
        Receives `Step.slip` in the same way, without rotations; of no size without friction.
    turn : ndarray, shape (12 MOST_ROWS,)
        Receives that of rotations; of no size without torsional and rolling friction.
    residual : ndarray, shape (1,)
        Receives the relative residual of the law.
    correction : ndarray, shape (MOST_ROWS, 6)
        Receives `Step.correction`; of no size where positions are not projected.
    corrected : ndarray of int, shape (1,)
        Receives of how many rows it is: all or none.
    at_end : ndarray of bool, shape (1,)
        Receives `Step.at_end` where it is true.
    """

    mechanism: Mechanism
    bodies: FreeBodyTable
    constraints: MechanismConstraints
    memory: LawMemory
    scales: Scales
    prescribed: PrescribedJoints
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
    turn: Array
    residual: Array
    correction: Array
    corrected: Array
    at_end: Array

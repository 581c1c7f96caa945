"""Making the records of the compiled loop: what steps a problem, and what its runs write to."""

from __future__ import annotations

import numpy as np

from ...constraints.mechanism.state import MechanismState, columns_of, row_buffer
from ...constraints.mechanism.tables import MOST_ROWS
from ...problem import Problem
from ...schemes import MoreauJean, Scheme
from ...schemes.gap_bounds.reach import parts_of_bodies
from ...schemes.kernels.records import LawMemory, MechanismStep, Scales, room
from ...schemes.positions.nearby_rows import linear_reach
from ...system.mechanisms.mechanism import Mechanism
from ...system.parts import parts_of
from ...system.system import Array
from ..tunnelling import TunnellingGuard
from .callbacks import PythonCallbacks
from .loop_record import PLAIN, ROUGH, TURNING, LoopRecord
from .loop_scope import control_of
from .moving_walls import NONE_PRESCRIBED, InLoop

# steps in one call of the kernel, so that bars and files go on
CHUNK = 2000
# rows of these for which there is room
_ROWS = 40_000


def mechanism_step(
    problem: Problem, scheme: Scheme, residual: float, mechanism: Mechanism, state: MechanismState,
    callbacks: PythonCallbacks | None, own: InLoop | None = None,
) -> MechanismStep:  # fmt: skip
    """Return what steps a problem that the loop takes, with room for one step; `own` only where walls may move."""
    system, constraints = problem.system, problem.constraints
    frictional, turns = constraints.frictional, constraints.resistance is not None
    nq, nv = len(mechanism.placed), len(mechanism.damping)
    prescribed = NONE_PRESCRIBED if own is None else own.prescribed
    control, acted = control_of(system)
    if callbacks is not None and callbacks.table is not None:
        control, acted = callbacks.table, np.array([0, system.nq, 0, system.nv])
    memory = LawMemory(np.zeros(MOST_ROWS), np.zeros(3 * MOST_ROWS), np.zeros(3, np.int64))
    theta = scheme.theta if isinstance(scheme, MoreauJean) else 0.5
    squares, turn_squares = constraints.cache.squares, constraints.cache.turn_squares
    # forces from outside act on all parts
    parts = (system,) if system.loaded else parts_of(system)
    late = np.concatenate([np.full(part.nv, part.velocity_dependent) for part in parts])
    late = np.append(late, np.zeros(nv - system.nv, bool)) if late.any() else late[:0]
    part = constraints.part
    scales = Scales(
        problem.tolerance, problem.length, residual, squares, turn_squares, late, part, parts_of_bodies(system, part),
        linear_reach(problem), theta, scheme.project_positions, system.loaded,
    )  # fmt: skip
    rows, ahead, middle = (row_buffer(nv, frictional, turns) for _ in range(3))
    bodies = problem.free_bodies
    bodies = bodies._replace(owner=np.append(bodies.owner, np.full(nv - system.nv, -1)))
    space = room(nq, nv, len(mechanism.mass) - nv, part[-1] + 1)
    return MechanismStep(
        mechanism, bodies, state.arrays, memory, scales, prescribed, control, acted, space, rows,
        ahead, middle,
        np.zeros(nq), np.zeros(nv), np.zeros(4 * MOST_ROWS), np.zeros(8 * MOST_ROWS if frictional else 0),
        np.zeros(12 * MOST_ROWS if turns else 0), np.zeros(1), np.zeros((MOST_ROWS * scheme.project_positions, 6)),
        np.zeros(1, np.int64), np.zeros(1, bool),
    )  # fmt: skip


def loop_record(
    problem: Problem, scheme: Scheme, guard: TunnellingGuard, t: Array, q: Array, v: Array, penetration: Array,
    violation: Array, residual: Array, own: InLoop | None = None,
) -> LoopRecord:  # fmt: skip
    """Return the record of a loop that writes states to given arrays, and logs the rows of up to `CHUNK` steps."""
    width = ROUGH if problem.constraints.frictional else PLAIN
    width = width if problem.constraints.resistance is None else TURNING
    pairs, joints = guard.shares[1].shape[1], 0 if own is None else len(own.prescribed.motion)
    nq, nv, constraints = len(problem.q0) + joints, len(problem.v0) + joints, problem.constraints
    constraints = constraints if own is None else own.constraints
    family, member, thickness, ways = columns_of(constraints, guard.watched)
    return LoopRecord(
        t, q, v, penetration, violation, residual, np.zeros(1, np.int64), np.zeros(CHUNK + 1, np.int64),
        np.zeros(CHUNK, bool), np.zeros(_ROWS, np.int64), np.zeros((_ROWS, width)), constraints.lever,
        constraints.limits, np.zeros(4 * MOST_ROWS), *guard.shares,
        family, member, thickness, ways, guard.slow_speed, scheme.timing.jump, np.zeros(pairs), np.zeros((2, pairs)),
        np.zeros((3, nv)), np.zeros((2, nq)), np.zeros((_ROWS * scheme.project_positions, 6)),
        np.zeros((CHUNK + 1, nq)), np.zeros((CHUNK + 1, nv)), np.zeros(CHUNK, bool),
    )  # fmt: skip

"""Kernel of rollouts: many runs of one mechanism, one after the other, without Python."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..compiled import kernel, record
from ..constraints.mechanism_rows import MechanismConstraints, active_rows, copy_memory
from ..schemes.mechanism_steps import DONE, MechanismStep
from .step_loop import FULL, LoopRecord, run_steps

Array = np.ndarray

# what `run_rollouts` returns beside the codes of `run_steps`: the law may apply at the start, or a body is buried
START = 7
# speed relative to the rows' largest terms below which a row does not close; half of that of `simulate`, which decides
_ROUNDING = 5e-13


@record(
    "f8[:,::1], f8[:,::1], f8[:,:,::1], f8[:,:,::1], b1[::1], f8[::1], f8[::1], f8, MechanismConstraints,"
    " MechanismConstraints, i8[::1], f8[::1], f8[:,::1]"
)
class Batch(NamedTuple):
    """Initial states and results of rollouts, and what they begin from.

    Attributes
    ----------
    q0, v0 : ndarray, shapes (n, nq) and (n, nv)
        Initial states.
    q, v : ndarray, shapes (n, steps + 1, nq) and (n, steps + 1, nv)
        Receive the states.
    valid : ndarray of bool, shape (n,)
        Which rollouts to run.
    now_q, now_v : ndarray, shapes (nq,) and (nv,)
        The state within a rollout.
    thickness : float
        Depth of a contact that is checked by Python [m].
    built, begun : MechanismConstraints
        What the constraints held when the problem was built, and after the first query of the last rollout.
    rows : ndarray of int, shape (1,)
        How many rows that query found; -1 where another rollout cannot begin from it.
    begun_q, begun_J : ndarray, shapes (nq,) and (MOST_ROWS, nv)
        The configuration of that query, and the gradients of these rows.
    """

    q0: Array
    v0: Array
    q: Array
    v: Array
    valid: Array
    now_q: Array
    now_v: Array
    thickness: float
    built: MechanismConstraints
    begun: MechanismConstraints
    rows: Array
    begun_q: Array
    begun_J: Array


@kernel("i8(MechanismStep, Batch, i8)")
def begin_rollout(s: MechanismStep, batch: Batch, i: int) -> int:
    """Bring a rollout to its initial state; return a code."""
    m, same = batch.rows[0], batch.rows[0] >= 0
    for k in range(len(batch.now_q)):
        batch.now_q[k] = batch.q[i, 0, k] = batch.q0[i, k]
        same = same and batch.q0[i, k] == batch.begun_q[k]
    for k in range(len(batch.now_v)):
        batch.now_v[k] = batch.v[i, 0, k] = batch.v0[i, k]
    s.memory.size[0] = s.memory.size[1] = s.memory.size[2] = 0
    if same:
        copy_memory(batch.begun, s.constraints)
    else:
        batch.rows[0] = -1
        copy_memory(batch.built, s.constraints)
        q = batch.now_q
        code = active_rows(s.mechanism, s.constraints, q[:0], batch.now_v, q, s.scales.tolerance, s.rows)
        if code != DONE:
            return code
        m = s.rows.size[0]
        for a in range(m):
            if s.rows.lever[a] * s.rows.gap[a] < -batch.thickness:
                return START
            for k in range(len(batch.now_v)):
                batch.begun_J[a, k] = s.rows.J[a, k]
        for k in range(len(q)):
            batch.begun_q[k] = q[k]
        copy_memory(s.constraints, batch.begun)
        batch.rows[0] = m
    for a in range(m):
        speed = scale = 0.0
        for k in range(len(batch.now_v)):
            speed += batch.begun_J[a, k] * batch.now_v[k]
            scale += abs(batch.begun_J[a, k] * batch.now_v[k])
        # written so that a NaN is left to Python
        if not speed >= -_ROUNDING * scale:
            return START
    return DONE


@kernel("Tuple((i8, i8, i8))(MechanismStep, LoopRecord, Batch, i8, i8, i8, i8, f8, f8, i8, f8, f8)", nogil=True)
def run_rollouts(
    s: MechanismStep, log: LoopRecord, batch: Batch, scheme: int, i: int, first: int, end: int, t0: float, h: float,
    steps: int, limit: float, still: float,
) -> tuple[int, int, int]:  # fmt: skip
    """Take the rollouts from step `first` of rollout i on, up to rollout `end` - 1, or to what is left to Python.

    Parameters
    ----------
    s, scheme, t0, h, limit, still
        As of `run_steps`.
    log : LoopRecord
        Its times, penetrations and residuals have room for one rollout.
    batch : Batch
        The rollouts.
    i, first, end : int
        The rollout to go on with, its next step (0: it has not begun), and the one after the last.
    steps : int
        Steps of each.

    Returns
    -------
    i, first : int
        What is left to Python: this step of this rollout, or its initial state where the step is 0.
    code : int
        Why: a code of `run_steps`, or `START`; `DONE` where i is `end`.
    """
    held = s.control.held
    while i < end:
        if batch.valid[i]:
            if held[1] > 0:
                held[0] = i * held[1] % len(s.control.torque)
            if first == 0:
                code = begin_rollout(s, batch, i)
                if code != DONE:
                    return i, 0, code
                first = 1
            states = LoopRecord(
                log.t, batch.q[i], batch.v[i], log.penetration, log.residual, log.begin, log.event, log.number, log.rows,
                log.lever, log.before, log.share, log.shares, log.thickness,
            )  # fmt: skip
            code = FULL
            while code == FULL:
                first, _, code = run_steps(
                    s, states, scheme, batch.now_q, batch.now_v, t0, h, first, steps + 1, steps, 1, first, limit, still
                )
            if code != DONE:
                return i, first, code
        i, first = i + 1, 0
    return end, 0, DONE

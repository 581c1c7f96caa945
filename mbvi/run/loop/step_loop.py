"""Kernels of the compiled loop: many steps of a mechanism with their record, a kernel for each scheme."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ...compiled import calling_others, kernel
from ...constraints.mechanism.tables import MOST_ROWS
from ...schemes.kernels.centered import centered_step
from ...schemes.kernels.moreau_jean import moreau_jean_step
from ...schemes.kernels.paoli import paoli_step
from ...schemes.kernels.records import DONE, MechanismStep
from ...schemes.kernels.stewart_trinkle import stewart_trinkle_step
from ...schemes.kernels.walls import set_prescribed_joints
from ..recording.recorder import record_depth
from .guard import may_pass
from .loop_record import ROUGH, TURNING, LoopRecord

Array = np.ndarray
# kernels as `run_paoli`
Loop = Callable[..., tuple[int, int, int]]

# what the loop returns beside the codes of a step: a body may pass through another; no room for more rows
SWIFT, FULL = 5, 6


@kernel("void(MechanismStep, LoopRecord, i8)")
def log_rows(s: MechanismStep, log: LoopRecord, begin: int) -> None:
    """Write the rows of a step to the log from place `begin` on."""
    rows, m = s.rows, s.rows.size[0]
    for a in range(m):
        to = log.rows[begin + a]
        log.number[begin + a], to[0], to[1] = rows.number[a], rows.gap[a], rows.e[a]
        for c in range(3):
            to[2 + c], to[5 + c] = rows.point[a, c], rows.normal[a, c]
        for r in range(4):
            to[8 + r] = s.rates[r * m + a]
        if len(to) >= ROUGH:
            to[12] = rows.mu[a]
            for c in range(2):
                for k in range(3):
                    to[13 + 3 * c + k] = rows.axes[a, c, k]
                for r in range(4):
                    to[19 + 2 * r + c] = s.slip[(r * m + a) * 2 + c]
        if len(to) == TURNING:
            for r in range(4):
                for c in range(3):
                    to[27 + 3 * r + c] = s.turn[(r * m + a) * 3 + c]
        for c in range(6 if len(log.correction) > 0 else 0):
            log.correction[begin + a, c] = s.correction[a, c] if a < s.corrected[0] else 0.0


@kernel(
    "Tuple((i8, i8, i8))(MechanismStep, LoopRecord, f8[::1], f8[::1], f8, f8, i8, i8, i8, i8, i8, f8, f8)",
    nogil=True,
)
def run_paoli(
    s: MechanismStep, log: LoopRecord, q: Array, v: Array, t0: float, h: float, first: int, end: int, total: int,
    every: int, count: int, limit: float, still: float,
) -> tuple[int, int, int]:  # fmt: skip
    """Take the steps of a scheme number `first` to `end` - 1, or up to one that is left to Python.

    Parameters
    ----------
    s : MechanismStep
        What steps.
    log : LoopRecord
        Receives the states.
    q, v : ndarray, shapes (nq,) and (nv,)
        The state before the first step; receives that after the last.
    t0, h : float
        Time at the start of the run, and length of a step [s].
    first, end, total, every, count : int
        Numbers of the first step, of that after the last, of the run's last step; one state in `every` is recorded, and
        the last one; number of states recorded before.
    limit : float
        See `may_pass`.
    still : float
        See `record_depth`.

    Returns
    -------
    next : int
        Number of the step that was not taken.
    count : int
        How many states are recorded.
    code : int
        Why it was not taken: a code of the step, `SWIFT` or `FULL`; `DONE` if it is `end`.
    """
    rows, memory, place = s.rows, s.memory, 0
    for i in range(first, end):
        log.begin[i - first] = place
        if i - first == len(log.event):
            return i, count, FULL
        size = memory.size[0], memory.size[1], memory.size[2]
        for a in range(size[0]):
            log.before[a] = memory.percussion[a]
        for a in range(size[1]):
            log.before[MOST_ROWS + a] = memory.start[a]
        t, log.taken[0], s.at_end[0] = t0 + (i - 1) * h, i - first, False
        set_prescribed_joints(s, t, q, v)
        code = paoli_step(s, t, q, v, h)
        m = rows.size[0]
        if code == DONE and place + m > len(log.number):
            code = FULL
        if code == DONE and may_pass(s, log, q, v, h, limit):
            code = SWIFT
        if code != DONE:
            memory.size[0], memory.size[1], memory.size[2] = size
            for a in range(size[0]):
                memory.percussion[a] = log.before[a]
            for a in range(size[1]):
                memory.start[a] = log.before[MOST_ROWS + a]
            return i, count, code
        log.event[i - first], log.at_end[i - first] = False, s.at_end[0]
        if m > 0:
            rates = s.rates[: 4 * m].reshape((4, m))
            log.event[i - first] = record_depth(
                count, rows.number[:m], rows.gap[:m], rates, s.residual[0], log.lever, log.limits, still,
                log.penetration, log.violation, log.residual,
            )  # fmt: skip
            log_rows(s, log, place)
            place += m
        for k in range(len(q)):
            log.q_before[i - first, k], q[k] = q[k], s.q[k]
        for k in range(len(v)):
            log.v_before[i - first, k], v[k] = v[k], s.v[k]
        if i % every == 0 or i == total:
            log.t[count] = t + h
            # those of walls come last
            for k in range(log.q.shape[1]):
                log.q[count, k] = q[k]
            for k in range(log.v.shape[1]):
                log.v[count, k] = v[k]
            count += 1
    log.begin[end - first] = place
    return end, count, DONE


# a kernel of its own for each scheme: a run compiles the steps of no other
run_moreau_jean = calling_others(run_paoli, "run_moreau_jean", paoli_step=moreau_jean_step)
run_centered = calling_others(run_paoli, "run_centered", paoli_step=centered_step)
run_stewart_trinkle = calling_others(run_paoli, "run_stewart_trinkle", paoli_step=stewart_trinkle_step)
LOOPS: dict[Any, Loop] = {
    paoli_step: run_paoli, moreau_jean_step: run_moreau_jean, centered_step: run_centered,
    stewart_trinkle_step: run_stewart_trinkle,
}  # fmt: skip


def loop_with(step: Any) -> Loop:
    """Return the loop whose steps are those of a kernel as `paoli_step`."""
    if step not in LOOPS:
        # kernels of users' modules may have equal names
        name = f"run_{step.__module__}_{step.__name__}".replace(".", "_")
        LOOPS[step] = calling_others(run_paoli, name, paoli_step=step)
    return LOOPS[step]

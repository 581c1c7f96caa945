"""Kernel of the compiled loop: many steps of a mechanism with their record."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..compiled import kernel, record
from ..constraints.mechanism_rows import MOST_ROWS
from ..schemes.centered_kernel import centered_step
from ..schemes.mechanism_steps import DONE, MechanismStep, moreau_jean_step, paoli_step
from .recorder import RECENT, record_depth

Array = np.ndarray

# the schemes
PAOLI, MOREAU_JEAN, CENTERED, CENTERED_PROJECTED = range(4)
# what `run_steps` returns beside the codes of a step: a body is swift; an impact must be recorded
SWIFT, IMPACT = 5, 6


@record(
    "f8[::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1], i8[::1], i8[:,::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1],"
    " f8[::1]"
)
class LoopRecord(NamedTuple):
    """The states of a run, and the rows of its last steps.

    Attributes
    ----------
    t, q, v, penetration, residual : ndarray, shape (n, ...)
        Those of the recorder.
    recent : ndarray of int, shape (RECENT,)
        How many rows each of the last steps had; -1 where there was no step. Step i is at place i mod RECENT.
    number, percussion : ndarray, shape (RECENT, MOST_ROWS)
        Their constraints and percussions.
    point, rates : ndarray, shapes (MOST_ROWS, 3) and (4 MOST_ROWS,)
        Contact points of the last step's rows, and their rates one after the other.
    lever : ndarray, shape (c,)
        As of `record_depth`.
    before : ndarray, shape (4 MOST_ROWS,)
        Room for the percussions at the beginning of a step.
    """

    t: Array
    q: Array
    v: Array
    penetration: Array
    residual: Array
    recent: Array
    number: Array
    percussion: Array
    point: Array
    rates: Array
    lever: Array
    before: Array


@kernel("i8(MechanismStep, i8, f8, f8[::1], f8[::1], f8)")
def scheme_step(s: MechanismStep, scheme: int, t: float, q: Array, v: Array, h: float) -> int:
    """Write the state after a step of a scheme; return its code."""
    if scheme == PAOLI:
        return paoli_step(s, t, q, v, h)
    if scheme == MOREAU_JEAN:
        return moreau_jean_step(s, t, q, v, h)
    return centered_step(s, t, q, v, h, scheme == CENTERED_PROJECTED)


@kernel("Tuple((i8, i8, i8))(MechanismStep, LoopRecord, i8, f8[::1], f8[::1], f8, f8, i8, i8, i8, i8, i8, f8, f8)")
def run_steps(
    s: MechanismStep, log: LoopRecord, scheme: int, q: Array, v: Array, t0: float, h: float, first: int, end: int,
    total: int, every: int, count: int, limit: float, still: float,
) -> tuple[int, int, int]:  # fmt: skip
    """Take the steps number `first` to `end` - 1, or up to one that is left to Python.

    Parameters
    ----------
    s : MechanismStep
        What steps.
    log : LoopRecord
        Receives the states.
    scheme : int
        Which scheme.
    q, v : ndarray, shapes (nq,) and (nv,)
        The state before the first step; receives that after the last.
    t0, h : float
        Time at the start of the run, and length of a step [s].
    first, end, total, every, count : int
        Numbers of the first step, of that after the last, of the run's last step; one state in `every` is recorded, and
        the last one; number of states recorded before.
    limit : float
        v . v below which no body passes through another.
    still : float
        As of `record_depth`.

    Returns
    -------
    next : int
        Number of the step that was not taken.
    count : int
        How many states are recorded.
    code : int
        Why it was not taken: a code of the step, `SWIFT` or `IMPACT`; `DONE` if it is `end`.
    """
    rows, memory = s.rows, s.memory
    for i in range(first, end):
        size = memory.size[0], memory.size[1], memory.size[2]
        for a in range(size[0]):
            log.before[a] = memory.percussion[a]
        for a in range(size[1]):
            log.before[MOST_ROWS + a] = memory.start[a]
        code, t = scheme_step(s, scheme, t0 + (i - 1) * h, q, v, h), t0 + (i - 1) * h + h
        m, speed = rows.count[0], 0.0
        if code == DONE:
            for k in range(len(v)):
                speed += s.v[k] * s.v[k]
            # written so that a NaN counts as swift
            if not speed < limit:
                code = SWIFT
        if code == DONE and m == 0:
            log.penetration[count] = 0.0
        elif code == DONE:
            rates = s.rates[: 4 * m].reshape((4, m))
            if record_depth(
                count, rows.number[:m], rows.gap[:m], rates, s.residual[0], log.lever, still, log.penetration,
                log.residual,
            ):  # fmt: skip
                code = IMPACT
        if code != DONE:
            memory.size[0], memory.size[1], memory.size[2] = size
            for a in range(size[0]):
                memory.percussion[a] = log.before[a]
            for a in range(size[1]):
                memory.start[a] = log.before[MOST_ROWS + a]
            return i, count, code
        for k in range(len(q)):
            q[k] = s.q[k]
        for k in range(len(v)):
            v[k] = s.v[k]
        if i % every == 0 or i == total:
            log.t[count] = t
            for k in range(len(q)):
                log.q[count, k] = q[k]
            for k in range(len(v)):
                log.v[count, k] = v[k]
            count += 1
        place = i % RECENT
        log.recent[place] = m
        for a in range(m):
            log.number[place, a], log.percussion[place, a] = rows.number[a], s.rates[a]
            for c in range(3):
                log.point[a, c] = rows.point[a, c]
        for a in range(4 * m):
            log.rates[a] = s.rates[a]
    return end, count, DONE

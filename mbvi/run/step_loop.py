"""Kernel of the compiled loop: many steps of a mechanism with their record."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..compiled import kernel, record
from ..constraints.mechanism_tables import MOST_ROWS
from ..schemes.centered_kernel import centered_step
from ..schemes.mechanism_steps import DONE, MechanismStep, moreau_jean_step, paoli_step
from .recorder import RECENT, record_depth
from .tunnelling import RUNAWAY

Array = np.ndarray

# the schemes
PAOLI, MOREAU_JEAN, CENTERED, CENTERED_PROJECTED = range(4)
# what `run_steps` returns beside the codes of a step: a body is swift; an impact must be recorded
SWIFT, IMPACT = 5, 6


@record(
    "f8[::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1], i8[::1], i8[:,::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1],"
    " f8[::1], f8[::1], f8[:,::1]"
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
    share, shares : ndarray, shapes (nv,) and (nv, n)
        As of `TunnellingGuard.shares`.
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
    share: Array
    shares: Array


@kernel("b1(f8[::1], f8[::1], f8[::1], f8[:,::1], f8)")
def may_pass(v: Array, w: Array, share: Array, shares: Array, limit: float) -> bool:
    """Return whether a body may pass through another in a step, or a velocity runs away; see `TunnellingGuard`.

    Parameters
    ----------
    v, w : ndarray, shape (nv,)
        Velocities before and after the step.
    share, shares, limit
        As of `TunnellingGuard`, where these are both of `shares`, and `limit`.
    """
    n, pairs = shares.shape
    before = after = travel = 0.0
    for k in range(n):
        before += v[k] * v[k]
        after += w[k] * w[k]
        travel += share[k] * max(abs(v[k]), abs(w[k]))
    # written so that a NaN counts as swift
    if not after < RUNAWAY:
        return True
    if (before < limit and after < limit) or (travel < 1.0 and pairs > 0):
        return False
    for i in range(pairs):
        travel = 0.0
        for k in range(n):
            travel += shares[k, i] * max(abs(v[k]), abs(w[k]))
        if not travel < 1.0:
            return True
    return pairs == 0


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
        As of `may_pass`.
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
        t = t0 + (i - 1) * h
        if scheme == PAOLI:
            code = paoli_step(s, t, q, v, h)
        elif scheme == MOREAU_JEAN:
            code = moreau_jean_step(s, t, q, v, h)
        else:
            code = centered_step(s, t, q, v, h, scheme == CENTERED_PROJECTED)
        m = rows.count[0]
        if code == DONE and may_pass(v, s.v, log.share, log.shares, limit):
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
            log.t[count] = t + h
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

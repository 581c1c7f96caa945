"""What the compiled loop records in one call."""

from __future__ import annotations

from typing import NamedTuple

from ...compiled import record
from ...constraints.mechanism.ways import PairWays
from ...system.system import Array

# numbers of a row in the log: gap, e, contact point, normal, rates; and with friction mu, both tangents, slip;
# and with torsional or rolling friction that of rotations
PLAIN, ROUGH, TURNING = 12, 27, 39


@record(
    "f8[::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8[::1], i8[::1], i8[::1], b1[::1], i8[::1], f8[:,::1], f8[::1],"
    " i8, f8[::1], f8[::1], f8[:,::1], i8[::1], i8[::1], f8[::1], PairWays, f8, f8, f8[::1], f8[:,::1], f8[:,::1],"
    " f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], b1[::1]"
)
class LoopRecord(NamedTuple):
    """The states of a run, and the rows of the steps of one call.

    Attributes
    ----------
    t, q, v, penetration, violation, residual : ndarray, shape (n, ...)
        Those of the recorder.
    taken : ndarray of int, shape (1,)
        How many steps this call has taken.
    begin : ndarray of int, shape (k + 1,)
        Where the rows of each step of this call begin in the log.
    event : ndarray of bool, shape (k,)
        The steps that may have an impact.
    number, rows : ndarray, shapes (r,) and (r, PLAIN, ROUGH or TURNING)
        The log: constraints and numbers of rows.
    lever, limits : ndarray, shape (c,), and int
        See `record_depth`.
    before : ndarray, shape (4 MOST_ROWS,)
        Room for the percussions at the beginning of a step.
    share, shares : ndarray, shapes (nv,) and (nv, m)
        See `TunnellingGuard.shares`.
    family, member, thickness : ndarray, shape (m,)
        See `columns_of`.
    pairs : PairWays
        The same pairs.
    slow_speed : float
        See `TunnellingGuard`.
    jump : float
        See `Timing`.
    travel, ways : ndarray, shapes (m,) and (2, m)
        Room for the travel of pairs, and for how far they move relative to each other in both parts of a step.
    tangents, places : ndarray, shapes (3, nv) and (2, nq)
        Room for tangent vectors and configurations.
    correction : ndarray, shape (r, 6)
        The log of `Step.correction`; of no size where positions are not projected.
    q_before, v_before : ndarray, shapes (k + 1, nq) and (k + 1, nv)
        The states before the steps of this call, and after the last.
    at_end : ndarray of bool, shape (k,)
        `Step.at_end` of the steps of this call.
    """

    t: Array
    q: Array
    v: Array
    penetration: Array
    violation: Array
    residual: Array
    taken: Array
    begin: Array
    event: Array
    number: Array
    rows: Array
    lever: Array
    limits: int
    before: Array
    share: Array
    shares: Array
    family: Array
    member: Array
    thickness: Array
    pairs: PairWays
    slow_speed: float
    jump: float
    travel: Array
    ways: Array
    tangents: Array
    places: Array
    correction: Array
    q_before: Array
    v_before: Array
    at_end: Array

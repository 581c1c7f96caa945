"""Stages of a Runge-Kutta step of one mechanism in one kernel, in flight or with rows that stay closed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...compiled import held, kernel, record
from ...constraints.mechanism.held_rows import (
    DEPENDENT_ROW,
    UNKNOWN,
    HeldRows,
    RowParts,
    evaluate_row,
    force_margins,
    held_rows_of,
    hold,
    write_gaps_of,
    write_held,
)
from ...constraints.mechanism.pairs import PairShapes
from ...geometry.shapes.shape_table import Shapes  # noqa: F401  (a signature names it)
from ...projection.tree_factor import factor_mass, least_change, span_equalities, unwhiten, whiten
from ...system.mechanisms.by_address.pinocchio_address import retract
from ...system.mechanisms.chart import joint_chart_rates
from ...system.mechanisms.mechanism import Mechanism, evaluate_nonlinear_effects, place, weigh
from ...system.system import Array
from .rows.contact_rows import SmoothRows
from .rows.known_pairs import KnownPairs, write_distances
from .rows.known_rows import KnownRows

# most sets of closed rows whose records are kept
_MOST_SETS = 1000


@record("Mechanism, f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1]")
class SmoothMotion(NamedTuple):
    """A mechanism that moves smoothly under constant torques, with room; for one thread at a time.

    Attributes
    ----------
    mechanism : Mechanism
        What moves.
    torque : ndarray, shape (nv,)
        Torques [N, N m].
    q : ndarray, shape (nq,)
        The configuration of the last stage.
    v, change, rate, free, kept : ndarray, shape (nv,)
        Velocity of the last stage, its coordinates in the chart, the rate of these, accelerations without contact
        forces and with them.
    """

    mechanism: Mechanism
    torque: Array
    q: Array
    v: Array
    change: Array
    rate: Array
    free: Array
    kept: Array


def smooth_motion(mechanism: Mechanism, nq: int, nv: int) -> SmoothMotion:
    """Return the record of a mechanism."""
    return SmoothMotion(mechanism, np.zeros(nv), np.zeros(nq), *np.zeros((5, nv)))


@kernel("void(SmoothMotion, HeldRows, f8[::1], f8[::1])")
def accelerate(s: SmoothMotion, held: HeldRows, q: Array, v: Array) -> None:
    """Write the accelerations at (q, v); NaN where the mass matrix is not positive definite."""
    m, free, kept, L = s.mechanism, s.free, s.kept, held.L
    weigh(m, q)
    evaluate_nonlinear_effects(m, q, v)
    bad = factor_mass(m.mass, 0.0, m.damping, m.parent, L)
    for k in range(len(v)):
        free[k] = s.torque[k] - m.damping[k] * v[k] - m.effects[k] if bad == 0 else np.nan
    whiten(L, m.parent, free)
    unwhiten(L, m.parent, free)
    if len(held.kind) > 0:
        write_held(m, held)
        hold(m, held, free, kept)
    else:
        for k in range(len(v)):
            kept[k] = free[k]


@kernel(
    "void(SmoothMotion, HeldRows, f8[:,::1], f8, i8, i8, Array(f8, 1, 'C', True), Array(f8, 1, 'C', True), f8[:,::1])"
)
def take_stages(
    s: SmoothMotion, held: HeldRows, weights: Array, h: float, first: int, end: int, q: Array, v: Array, K: Array
) -> None:  # fmt: skip
    """Write rows `first` to `end` - 1 of K, the rates of these stages; see `RungeKuttaStep.rates`.

    Parameters
    ----------
    s, held
        What moves, and the rows that stay closed.
    weights : ndarray, shape (n, n)
        Those of the rates of all stages in each.
    h : float
        Length of the step [s].
    first, end : int
        Which stages.
    q, v : ndarray, shapes (nq,) and (nv,)
        The state at the start of the step.
    K : ndarray, shape (n, 2 nv) or (n, 3 nv)
        Rates of the stages before; receives those of these.
    """
    nv = len(v)
    for i in range(first, end):
        for k in range(nv):
            a = b = 0.0
            for j in range(i):
                w = weights[i, j]
                if w != 0.0:
                    a += w * K[j, k]
                    b += w * K[j, nv + k]
            s.change[k], s.v[k] = h * a, v[k] + h * b
        retract(s.mechanism.calls, q, s.change, s.q)
        joint_chart_rates(s.mechanism.tree, s.change, s.v, s.rate)
        accelerate(s, held, s.q, s.v)
        for k in range(nv):
            K[i, k], K[i, nv + k] = s.rate[k], s.kept[k]
            if K.shape[1] > 2 * nv:
                K[i, 2 * nv + k] = s.free[k]


@kernel("void(SmoothMotion, f8[:,:,::1], f8, f8, Array(f8, 1, 'C', True), Array(f8, 1, 'C', True))")
def state_at(s: SmoothMotion, dense: Array, h: float, share: float, q: Array, v: Array) -> None:
    """Write the state at a share of a step of length h from (q, v), by its dense output, to the room of `s`."""
    nv, degree = len(v), dense.shape[2]
    for k in range(nv):
        a = b = 0.0
        for d in range(degree - 1, -1, -1):
            a, b = (a + dense[0, k, d]) * share, (b + dense[1, k, d]) * share
        s.change[k], s.v[k] = h * a, v[k] + h * b
    retract(s.mechanism.calls, q, s.change, s.q)


@kernel(
    "void(SmoothMotion, HeldRows, f8[:,:,::1], f8, Array(f8, 1, 'C', True), Array(f8, 1, 'C', True),"
    " Array(f8, 1, 'C', True), f8, f8[:,::1])"
)
def margins_along(
    s: SmoothMotion, held: HeldRows, dense: Array, h: float, shares: Array, q: Array, v: Array, margin: float,
    out: Array,
) -> None:  # fmt: skip
    """Write `force_margins` at n shares of a step, shape (n, k); see `state_at`."""
    for i in range(len(shares)):
        state_at(s, dense, h, shares[i], q, v)
        accelerate(s, held, s.q, s.v)
        force_margins(held, s.free, margin, held.part, out[i])


@kernel(
    "void(SmoothMotion, RowParts, i8[::1], f8[:,:,::1], f8, Array(f8, 1, 'C', True), Array(f8, 1, 'C', True),"
    " Array(f8, 1, 'C', True), f8[:,::1])"
)
def gaps_along(
    s: SmoothMotion, rows: RowParts, index: Array, dense: Array, h: float, shares: Array, q: Array, v: Array, out: Array
) -> None:  # fmt: skip
    """Write the gaps of some rows, shape (k,), at n shares of a step, shape (n, k); see `state_at`."""
    for i in range(len(shares)):
        state_at(s, dense, h, shares[i], q, v)
        place(s.mechanism, s.q)
        write_gaps_of(s.mechanism, rows, index, s.q, out[i])


@kernel(
    "void(SmoothMotion, Tuple(Shapes), PairShapes, i8[::1], f8, f8[:,:,::1], f8, Array(f8, 1, 'C', True),"
    " Array(f8, 1, 'C', True), Array(f8, 1, 'C', True), f8[:,::1])"
)
def distances_along(
    s: SmoothMotion, tables: tuple[Array, ...], shapes: PairShapes, pairs: Array, near: float, dense: Array, h: float,
    shares: Array, q: Array, v: Array, out: Array,
) -> None:  # fmt: skip
    """Write the distances of some pairs, shape (k,), at n shares of a step; see `write_distances` and `state_at`."""
    for i in range(len(shares)):
        state_at(s, dense, h, shares[i], q, v)
        place(s.mechanism, s.q)
        write_distances(s.mechanism, tables, shapes, pairs, near, out[i])


@kernel("void(SmoothMotion, HeldRows, f8[::1], f8[::1], f8[::1])")
def remove_drift_of(s: SmoothMotion, held: HeldRows, q: Array, v: Array, gap: Array) -> None:
    """Move q so that the gaps of the rows vanish, by two steps of Newton's method, and v so that their rates vanish.

    The changes are least in the kinetic metric. `gap` receives the lesser gaps of both steps, shape (k,).
    """
    m, nv, L = s.mechanism, len(v), held.L
    for turn in range(3):
        weigh(m, q)
        factor_mass(m.mass, 0.0, m.damping, m.parent, L)
        for i in range(len(gap)):
            J, rate = held.rows[nv + i], 0.0
            missing = evaluate_row(m, held.kind[i], held.sides[i], held.parts[i], held.radius[i], q, held.room, J)
            for k in range(nv):
                rate += J[k] * v[k]
            held.part[i] = missing if turn < 2 else rate
            if turn < 2:
                gap[i] = missing if turn == 0 else min(gap[i], missing)
        span_equalities(held.rows, m.parent, DEPENDENT_ROW, L, held.R)
        least_change(L, m.parent, held.R, held.part, s.change)
        if turn < 2:
            retract(m.calls, q, s.change, s.q)
            for k in range(len(q)):
                q[k] = s.q[k]
        else:
            for k in range(nv):
                v[k] += s.change[k]


class MechanismStages:
    """The kernels of this module for one mechanism, with the records that they take.

    Parameters
    ----------
    kernels : KnownRows
        What moves, and the rows of its constraints.

    Attributes
    ----------
    motion : SmoothMotion
        What moves; the room has the results of the last call.
    rows : KnownRows
        Those that kernels know.
    """

    def __init__(self, kernels: KnownRows) -> None:
        system = kernels.system
        self._system, self.rows = system, kernels
        self.motion: SmoothMotion = held(smooth_motion(kernels.mechanism, system.nq, system.nv))
        self._sets: dict[bytes, HeldRows | None] = {}

    @property
    def unforced(self) -> bool:
        """Whether no torques act that change within a step; those that act are then written."""
        system = self._system
        if system.control is not None or system.springs:
            return False
        self.motion.torque[:] = system.applied
        return True

    def torque(self, t: float, q: Array, v: Array) -> Array:
        """Return the torques that act, shape (nv,) [N, N m]."""
        return self._system.torque(t, q, v)

    def gaps_along(self, way: tuple[Array, float, Array, Array, Array], index: Array) -> Array:
        """Return the gaps of some rows at n shares of a step, shape (n, k).

        `way` is the dense output, the length of the step, the shares, and q and v at its start.
        """
        found = np.empty((len(way[2]), len(index)))
        gaps_along(self.motion, self.rows.parts, index, *way, found)
        return found

    def distances_along(
        self, way: tuple[Array, float, Array, Array, Array], pairs: KnownPairs, index: Array, near: float
    ) -> Array:
        """Return the distances of some pairs at n shares of a step, shape (n, k); see `gaps_along`."""
        found = np.empty((len(way[2]), len(index)))
        distances_along(self.motion, pairs.tables, pairs.shapes, index, near, *way, found)
        return found

    def remove_drift(self, closed: Array, q: Array, v: Array) -> tuple[Array, Array, Array] | None:
        """Return q and v without the drift of closed rows, and their least gaps; None where kernels do not know one."""
        held = self.held(closed)
        if held is None:
            return None
        q, v, gap = q.copy(), v.copy(), np.empty(len(closed))
        remove_drift_of(self.motion, held, q, v, gap)
        # read-only, so that results computed for this array remain valid
        q.setflags(write=False)
        return q, v, gap

    def held(self, closed: Array) -> HeldRows | None:
        """Return the record of some closed rows, which the same rows share; None where kernels do not know one."""
        key = closed.tobytes()
        if key not in self._sets:
            if len(self._sets) >= _MOST_SETS:
                self._sets.clear()
            parts = self.rows.parts_of(closed)
            unknown = (parts.kind == UNKNOWN).any()
            self._sets[key] = None if unknown else held(held_rows_of(parts, self._system.nv))
        return self._sets[key]


def stages_of(rows: SmoothRows) -> MechanismStages | None:
    """Return the kernels for a system that moves as one mechanism of usual joints without equalities, else None."""
    return None if rows.kernels is None else MechanismStages(rows.kernels)

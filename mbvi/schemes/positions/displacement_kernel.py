"""Kernels of the least displacement that moves rows out of penetration; see `least_displacement`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...compiled import kernel, record
from ...constraints.mechanism.tables import FOUND, RowBuffer
from ...projection.coulomb.frictional_step import interleave
from ...projection.dense.fused_step import FEW
from ...projection.dense.orthonormal_rows import inner
from ...projection.dense.robot_step import solve_active_set
from ...projection.positions.held_rows import held_tangents, hold_rows, raises_near
from ...projection.positions.travel import MOST_LINEARISATIONS
from ...projection.tree import solve
from ...system.free.free_momentum import root_of
from ...system.mechanisms.mechanism import carry
from ...system.system import Array
from ..kernels.records import UNSOLVED, MechanismStep
from .nearby_kernel import copy_of, find_nearby, match_rows, nearby_rows

# what kernels return beside codes of a step: there is no such velocity or displacement
IMPOSSIBLE = -1


@record("f8[::1], f8[::1], b1[::1], f8[::1], f8[::1], f8[::1]")
class Sunk(NamedTuple):
    """Where a position projection starts, and what it leads to.

    Attributes
    ----------
    floor : ndarray, shape (m,)
        Lower bounds of the gaps of the active rows at the end of the step.
    margins : ndarray, shape (parts,)
        Of each part, gaps up to which rows take part in the projection [m].
    sticks : ndarray of bool, shape (k,) or (0,)
        The rows of the law that are held along their tangents; of no size where displacements need not hold any.
    moved : ndarray, shape (nv,)
        Receives the displacement.
    place : ndarray, shape (nq,)
        Receives the configuration that it leads to.
    residual : ndarray, shape (1,)
        Receives the relative residual of the last projection.
    """

    floor: Array
    margins: Array
    sticks: Array
    moved: Array
    place: Array
    residual: Array


@kernel("f8(MechanismStep, f8[:,::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8[::1], f8[:,::1])")
def project_moving(
    s: MechanismStep, J: Array, A: Array, W: Array, x: Array, lower: Array, w: Array, table: Array
) -> float:
    """Write argmin |w - x|_M with J w >= lower as `solve_active_set`, also where rows move nothing; return as that.

    A row without a gradient makes it impossible where its bound is positive, and does nothing elsewhere. What is
    impossible to within the residual of the run is inf.
    """
    m, n = J.shape
    memory, moving = s.memory, np.empty(m, np.bool_)
    count, least = 0, 0.0
    for a in range(m):
        moving[a] = inner(W[a], W[a]) > 0.0
        count += moving[a]
        least = max(least, 0.0 if moving[a] else lower[a])
    limit = 0.0 if m <= FEW else 1e-3 * s.scales.residual
    if count == m or least > 0.0:
        last = memory.percussion[: memory.size[0]]
        residual = -np.inf if least > 0.0 else solve_active_set(J, A, W, x, lower, last, limit, w, table)
    else:
        rows, solved, whitened = np.empty((count, n)), np.empty((count, n)), np.empty((count, n))
        bounds, part, i = np.empty(count), np.empty((3, count)), 0
        for a in range(m):
            if moving[a]:
                rows[i], solved[i], whitened[i], bounds[i] = J[a], A[a], W[a], lower[a]
                i += 1
        residual = solve_active_set(rows, solved, whitened, x, bounds, bounds[:0], limit, w, part)
        i = 0
        for a in range(m):
            table[0, a] = table[1, a] = table[2, a] = 0.0
            if moving[a]:
                for r in range(3):
                    table[r, a] = part[r, i]
                i += 1
    if 0.0 <= residual < np.inf:
        memory.size[0], i = count, 0
        for a in range(m):
            if moving[a]:
                memory.percussion[i] = table[0, a]
                i += 1
        return residual
    return residual if residual < -s.scales.residual else np.inf


@kernel("f8(MechanismStep, RowBuffer, f8[::1], f8[::1], b1[::1], f8[::1], f8[:,::1])")
def displace(
    s: MechanismStep, rows: RowBuffer, x: Array, lower: Array, sticks: Array, moved: Array, table: Array
) -> float:
    """Write the displacement nearest to another one that raises rows by given distances; return as `project_moving`.

    Parameters
    ----------
    s : MechanismStep
        With the factor of M where the law was applied, and the rows of the law at the end of the step (`middle`).
    rows : RowBuffer
        The rows.
    x : ndarray, shape (nv,)
        The other displacement.
    lower : ndarray, shape (m,)
        How far rows must rise.
    sticks : ndarray of bool, shape (k,) or (0,)
        See `Sunk`.
    moved, table
        Receive what `solve_active_set` writes.
    """
    m, nv, parent, L, holds = rows.size[0], len(s.v), s.mechanism.parent, s.room.L, len(sticks) > 0
    J, A, W = rows.J[:m], np.empty((m, nv)), np.empty((m, nv))
    if not holds:
        solve(L, parent, J, W, A)
        return project_moving(s, J, A, W, x, lower, moved, table)
    owner, held, every, count = np.empty(m, np.int64), np.empty(m, np.bool_), np.empty(m, np.bool_), 0
    match_rows(rows, s.middle, owner)
    for a in range(m):
        held[a], every[a] = owner[a] >= 0 and sticks[owner[a]], True
        count += held[a]
    wide, wide_W, wide_A = np.empty((3 * m, nv)), np.empty((3 * m, nv)), np.empty((3 * m, nv))
    interleave(J, rows.T[: 2 * m], wide)
    solve(L, parent, wide, wide_W, wide_A)
    most, left = 2 * count + 1, np.empty((m, nv))
    triangle, basis = np.empty((most, most)), np.empty((2 * most, nv))
    size = held_tangents(wide_W, every, held, triangle, basis)
    hold_rows(L, parent, wide_W, every, size, basis, left, A, W)
    residual = project_moving(s, left, A, W, x, lower, moved, table)
    if 0.0 <= residual < np.inf and not raises_near(L, wide, wide_W, every, moved, lower, s.scales.tolerance):
        return -np.inf
    return residual


@kernel("i8(MechanismStep, RowBuffer, Sunk)")
def least_displacement(s: MechanismStep, active: RowBuffer, sunk: Sunk) -> int:
    """Find the nearest configuration in which no gap is below its lower bound; return a code, or `IMPOSSIBLE`.

    Parameters
    ----------
    s : MechanismStep
        See `displace`, with the state at the end of the step.
    active : RowBuffer
        The active rows there.
    sunk : Sunk
        Where it starts; receives the answer. The rows there are then those of `find_nearby`.
    """
    near, moved, tolerance, n = copy_of(active), sunk.moved, s.scales.tolerance, len(s.v)
    bound, origin = sunk.floor.copy(), np.zeros(n)
    for k in range(n):
        moved[k] = 0.0
    for i in range(MOST_LINEARISATIONS):
        m = near.size[0]
        lower, table = np.empty(m), np.empty((3, m))
        for a in range(m):
            lower[a] = inner(near.J[a], moved) + bound[a] - near.gap[a]
        for k in range(n):
            # where linearisations alternate, each of the others adds to the displacement before
            origin[k] = 0.0 if 2 * i < MOST_LINEARISATIONS else moved[k]
        residual = displace(s, near, origin, lower, sunk.sticks, moved, table)
        # written so that a NaN is refused too
        if not 0.0 <= residual < np.inf:
            return IMPOSSIBLE if residual < 0.0 else UNSOLVED
        carry(s.mechanism, s.q, moved, sunk.place)
        code = find_nearby(s, sunk.place, sunk.margins)
        if code != FOUND:
            return code
        last, near, settled = near, nearby_rows(s), True
        m = near.size[0]
        owner, before, bound = np.empty(m, np.int64), np.empty(m, np.int64), np.empty(m)
        match_rows(near, active, owner)
        match_rows(near, last, before)
        for a in range(m):
            bound[a] = sunk.floor[owner[a]] if owner[a] >= 0 else 0.0
            excess = near.lever[a] * (near.gap[a] - bound[a])
            pushed = before[a] >= 0 and table[0, before[a]] > 0.0
            # a contact whose gap remained open would not be active, and its body would fall
            settled = settled and excess >= -tolerance and (excess <= tolerance or not pushed)
        if settled:
            sunk.residual[0] = residual
            return FOUND
    return IMPOSSIBLE


@kernel("void(f8[:,::1], i8[::1], i8[::1])")
def independent_groups(acts: Array, part: Array, group: Array) -> None:
    """Find which rows act on the same bodies as others, directly or not.

    Parameters
    ----------
    acts : ndarray, shape (m, nv)
        The rows.
    part : ndarray of int, shape (n,)
        Which mechanism or free body each of the first velocities belongs to; others connect nothing.
    group : ndarray of int, shape (m,)
        Receives of each row the first row of its group.
    """
    m, n = len(acts), len(part)
    first = np.full(part[n - 1] + 1, -1)
    for a in range(m):
        group[a] = a
    for a in range(m):
        for k in range(n):
            if acts[a, k] != 0.0:
                b = first[part[k]]
                if b < 0:
                    first[part[k]] = a
                else:
                    one, other = root_of(group, a), root_of(group, b)
                    group[max(one, other)] = min(one, other)
    for a in range(m):
        group[a] = root_of(group, a)


@kernel("i8(MechanismStep, RowBuffer, Sunk)")
def displacement_of_groups(s: MechanismStep, active: RowBuffer, sunk: Sunk) -> int:
    """Project independent groups of rows one by one, and of those that cannot be projected the joint limits.

    The arguments and the result are those of `least_displacement`, which has failed for all rows together.
    """
    m, n, residual, some = active.size[0], len(s.v), 0.0, False
    group, kept, bound, total = np.empty(m, np.int64), np.empty(m), np.empty(m), np.zeros(n)
    independent_groups(active.J[:m], s.scales.part, group)
    raised = others = 0
    for a in range(m):
        kept[a] = min(active.gap[a], 0.0)
        raised += sunk.floor[a] > kept[a]
    for first in range(m):
        if group[first] != first:
            continue
        # all rows of the group, unless these have failed, then its joint limits alone
        before = raised
        for limits in (False, True):
            others = 0
            for a in range(m):
                bound[a] = kept[a]
                if group[a] == first and (not limits or np.isnan(active.point[a, 0])) and sunk.floor[a] > kept[a]:
                    bound[a], others = sunk.floor[a], others + 1
            if others == 0 or others == before:
                continue
            before, part = (
                others,
                Sunk(bound, sunk.margins, sunk.sticks[:0], sunk.moved, sunk.place, sunk.residual),
            )
            code = least_displacement(s, active, part)
            if code == FOUND:
                # groups move different bodies
                for k in range(n):
                    total[k] += sunk.moved[k]
                residual, some = max(residual, sunk.residual[0]), True
                break
            if code != IMPOSSIBLE:
                return code
    if not some:
        return IMPOSSIBLE
    for k in range(n):
        sunk.moved[k] = total[k]
    sunk.residual[0] = residual
    carry(s.mechanism, s.q, sunk.moved, sunk.place)
    return find_nearby(s, sunk.place, sunk.margins)


@kernel("i8(MechanismStep, RowBuffer, Sunk)")
def raise_sunk(s: MechanismStep, active: RowBuffer, sunk: Sunk) -> int:
    """Find the displacement that raises rows, or as many as can be; arguments and result as of `least_displacement`."""
    code = least_displacement(s, active, sunk)
    free = Sunk(sunk.floor, sunk.margins, sunk.sticks[:0], sunk.moved, sunk.place, sunk.residual)
    if code == IMPOSSIBLE and len(sunk.sticks) > 0:
        # a body that landed tilted cannot turn about contacts that are all held
        code = least_displacement(s, active, free)
    if code == IMPOSSIBLE:
        code = displacement_of_groups(s, active, free)
    return code

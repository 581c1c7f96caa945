"""The velocities of a step of `StewartTrinkle` for a mechanism, in kernels; see `stewart_trinkle_kernel`."""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ...constraints.mechanism.tables import RowBuffer, copy_row
from ...projection.dense.fused_step import FEW
from ...projection.dense.robot_step import solve_active_set
from ...projection.row_speeds import row_speeds
from ...projection.tree import solve
from ...system.system import Array
from ..gap_bounds.reach import write_largest_of_groups
from ..step import STILL
from .joint_friction import bounded_coulomb, joints_with_friction
from .records import DONE, UNSOLVED, MechanismStep


@kernel("b1(MechanismStep, f8[::1], f8, b1[::1], f8[::1])")
def write_bounds(s: MechanismStep, v: Array, h: float, bound: Array, lower: Array) -> bool:
    """Write which rows have a bound, and the least rates; see `newton_bounds`; return whether some row may bounce.

    Parameters
    ----------
    s : MechanismStep
        With the rows, their groups (`room.owner`), and the free motion of v in its room.
    v : ndarray, shape (nv,)
        Velocity before.
    h : float
        Time step [s].
    bound, lower : ndarray, shape (k,)
        Receive the mask and the rates.
    """
    rows, free, k, some, bounces = s.rows, s.room.free, s.rows.size[0], False, False
    restitution, largest = np.zeros(k), np.empty(k)
    for a in range(k):
        before, slow = 0.0, STILL * s.scales.length / rows.lever[a]
        for j in range(len(v)):
            before += rows.J[a, j] * v[j]
            slow += 2.0 * abs(rows.J[a, j]) * abs(free[j] - v[j])
        touching, e = s.scales.tolerance / rows.lever[a], rows.e[a]
        impact = e > 0.0 and rows.gap[a] + h * before <= touching and before < -slow
        gap = max(rows.gap[a], 0.0)
        lower[a], bound[a] = -e * before if impact else -gap / h, not (e > 0.0 and not impact and gap > h * slow)
        s.room.near[a], s.room.change[a], bounces = impact, before, bounces or e > 0.0
        if impact:
            some, restitution[a] = True, e
    write_largest_of_groups(restitution, s.room.owner[:k], largest)
    for a in range(k if some else 0):
        if not s.room.near[a] and largest[a] > 0.0:
            gap = max(rows.gap[a], 0.0)
            # bodies that touch to within the tolerance pass impacts on without loss
            gap = gap if gap > s.scales.tolerance / rows.lever[a] else 0.0
            lower[a] = min(-gap / h, -largest[a] * s.room.change[a])
    return bounces


@kernel("i8(MechanismStep, RowBuffer, f8[::1], b1[::1], f8)")
def project_bounds_with_friction(s: MechanismStep, some: RowBuffer, least: Array, bound: Array, h: float) -> int:
    """Write the same by Coulomb's law, for the rows that have a bound and their least rates."""
    k, i = some.size[0], 0
    p = np.empty((k, 6))
    code = bounded_coulomb(s, some, s.room.free, least, h, s.scales.residual, s.v, p)
    if code != DONE:
        return code
    for a in range(s.rows.size[0]):
        if bound[a]:
            s.rates[a] = p[i, 0]
            if len(s.slip):
                s.slip[2 * a], s.slip[2 * a + 1] = p[i, 1], p[i, 2]
            for c in range(3 if len(s.turn) else 0):
                s.turn[3 * a + c] = p[i, 3 + c]
            i += 1
    return DONE


@kernel("i8(MechanismStep, b1[::1], f8[::1], f8)")
def project_bounds(s: MechanismStep, bound: Array, lower: Array, h: float) -> int:
    """Write the velocity nearest to the free motion, the percussions and the residual; return a code.

    Parameters
    ----------
    s : MechanismStep
        With the rows, the free motion and the factor of the mass matrix. Receives the velocity `s.v`, the percussions
        in the first places of `s.rates`, and with friction of `s.slip` and `s.turn`.
    bound : ndarray of bool, shape (k,)
        Which rows have a bound.
    lower : ndarray, shape (k,)
        Least rates of the gaps.
    h : float
        Time step [s].
    """
    rows, room, memory, rough, every = s.rows, s.room, s.memory, 0.0, True
    for a in range(rows.size[0]):
        s.rates[a], every = 0.0, every and bound[a]
        rough = max(rough, rows.mu[a] if bound[a] else 0.0)
    some, least = rows, lower
    if not every:
        some, least = s.middle, s.middle.gap
        some.size[0] = 0
        for a in range(rows.size[0]):
            if bound[a]:
                # these rows bear their bounds in place of their gaps
                copy_row(rows, a, some)
                least[some.size[0] - 1] = lower[a]
        least = least[: some.size[0]].copy()
    for i in range(2 * rows.size[0] if len(s.slip) else 0):
        s.slip[i] = 0.0
    for i in range(3 * rows.size[0] if len(s.turn) else 0):
        s.turn[i] = 0.0
    if rough > 0.0 or joints_with_friction(s.mechanism.friction) > 0:
        return project_bounds_with_friction(s, some, least, bound, h)
    k, x = some.size[0], room.free
    if k == 0:
        for j in range(len(x)):
            s.v[j] = x[j]
        s.residual[0] = 0.0
        return DONE
    J, W, A, table = some.J[:k], room.W[:k], room.A[:k], room.table[: 3 * k].reshape((3, k))
    solve(room.L, s.mechanism.parent, J, W, A)
    last, limit = memory.percussion[: memory.size[0]], 0.0 if k <= FEW else 1e-3 * s.scales.residual
    found = solve_active_set(J, A, W, x, least, last, limit, s.v, table)
    # written so that a NaN is refused too
    if not 0.0 <= found < np.inf:
        return UNSOLVED
    memory.size[0], s.residual[0], i = k, found, 0
    for a in range(rows.size[0]):
        if bound[a]:
            s.rates[a] = memory.percussion[i] = table[0, i]
            i += 1
    return DONE


@kernel("f8(MechanismStep, b1[::1], f8[::1], f8[::1])")
def open_the_gaps(s: MechanismStep, chosen: Array, lower: Array, w: Array) -> float:
    """Write the velocity w nearest to `s.v` with rates of the chosen rows of at least `lower`, without friction.

    Return the residual, NaN or infinite where it is not solved.
    """
    room, some = s.room, s.middle
    least = some.gap
    some.size[0] = 0
    for a in range(s.rows.size[0]):
        if chosen[a]:
            copy_row(s.rows, a, some)
            least[some.size[0] - 1] = lower[a]
    k = some.size[0]
    J, W, A, table = some.J[:k], room.W[:k], room.A[:k], room.table[: 3 * k].reshape((3, k))
    solve(room.L, s.mechanism.parent, J, W, A)
    found = solve_active_set(
        J, A, W, s.v, least[:k].copy(), lower[:0], 0.0 if k <= FEW else 1e-3 * s.scales.residual, w, table
    )  # fmt: skip
    return found if found >= 0.0 else np.inf


@kernel("void(MechanismStep, f8[::1], f8, f8[::1], f8[::1])")
def write_residual_depths(s: MechanismStep, v: Array, h: float, change: Array, left: Array) -> None:
    """Write the penetration that the residual of a projection of v may leave each row [m], and the tolerance; and J v.

    `v` has the shape (nv,), `change` and `left` have (k,). A group of rows (`room.owner`) has one value.
    """
    k, group = len(change), s.room.owner[: len(change)]
    size, nearest = np.empty(k), np.empty(k)
    row_speeds(s.rows.J, v, 1.0, change)
    for a in range(k):
        size[a] = abs(s.rows.gap[a])
    write_largest_of_groups(size, group, nearest)
    for a in range(k):
        size[a] = abs(change[a])
    write_largest_of_groups(size, group, left)
    for a in range(k):
        left[a] = 2.0 * h * s.scales.residual * (left[a] + nearest[a] / h) + s.scales.tolerance


@kernel("b1(MechanismStep, f8[::1], f8[::1], b1[::1])")
def mark_deep(s: MechanismStep, gap: Array, left: Array, deep: Array) -> bool:
    """Mark the groups in which some gap is below what is left, all shapes (k,); return whether there are any."""
    k, some = len(gap), False
    below, of_group = np.empty(k), np.empty(k)
    for a in range(k):
        below[a] = 1.0 if gap[a] < -left[a] else 0.0
        some = some or gap[a] < -left[a]
    write_largest_of_groups(below, s.room.owner[:k], of_group)
    for a in range(k):
        deep[a] = of_group[a] > 0.0
    return some


@kernel("Tuple((i8, b1, f8))(MechanismStep, f8[::1], f8, b1[::1], f8[::1])")
def displacing_velocity(s: MechanismStep, v: Array, h: float, bound: Array, lower: Array) -> tuple[int, bool, float]:
    """Write the velocity along which the configuration moves in the step, `s.room.tangent`.

    Parameters
    ----------
    s : MechanismStep
        With the rows, the free motion of v and the factor of the mass matrix.
    v : ndarray, shape (nv,)
        Velocity before.
    h : float
        Time step [s].
    bound, lower : ndarray, shape (k,)
        Receive which rows have a bound, and the least rates; see `newton_bounds`.

    Returns
    -------
    code : int
        See `project_bounds`.
    removes : bool
        Whether this velocity removes penetration; otherwise `s.v` is the velocity after the step.
    residual : float
        That of this velocity.
    """
    rows, room, k, w = s.rows, s.room, s.rows.size[0], s.room.tangent
    gap, change, left, deep = room.gap[:k], room.opened[:k], np.empty(k), np.empty(k, np.bool_)
    bounces = write_bounds(s, v, h, bound, lower)
    write_residual_depths(s, room.free, h, change, left)
    sunk = mark_deep(s, rows.gap[:k], left, deep) and not bounces
    for a in range(k):
        gap[a] = -rows.gap[a] / h if deep[a] else lower[a]
    code, residual = project_bounds(s, bound, gap if sunk else lower, h), s.residual[0]
    for j in range(len(v)):
        w[j] = s.v[j]
    if sunk or not bounces or code != DONE:
        return code, sunk, residual
    row_speeds(rows.J, w, h, change)
    for a in range(k):
        gap[a] = rows.gap[a] + change[a]
    closed = np.empty(k, np.bool_)
    if mark_deep(s, gap, left, closed):
        # a contact that bounces would close another one
        write_residual_depths(s, w, h, change, left)
        mark_deep(s, rows.gap[:k], left, deep)
        for a in range(k):
            gap[a] = -(rows.gap[a] if deep[a] else max(rows.gap[a], 0.0)) / h
        residual = open_the_gaps(s, closed, gap, w)
    return DONE if residual < np.inf else UNSOLVED, False, residual

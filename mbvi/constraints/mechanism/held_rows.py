"""Kernels of rows of one mechanism: gaps, gradients, (dJ/dt) v, and the accelerations that keep rows closed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...compiled import kernel, record
from ...projection.tree_factor import least_change, span_equalities, squared
from ...system.mechanisms.frames import cross_product
from ...system.mechanisms.joint_tree import JointTree
from ...system.mechanisms.mechanism import Mechanism
from ...system.mechanisms.separation import row
from ..features.feature_bias import slip_bias, turn_with_bodies, turning_bias
from ..features.feature_kernels import touch
from ..tangents import write_tangents_of

Array = np.ndarray

# beside the kinds of features: a limit of a joint, and what these kernels do not know
LIMIT, UNKNOWN = 3, -1
# part of a whitened row that others must leave of it; with less the row depends on them
DEPENDENT_ROW = 1e-5
# accelerations below this are denormal numbers and count as zero
_DENORMAL = 1e-290


@record("i8[::1], i8[:,::1], f8[:,:,:,::1], f8[::1], f8[::1]")
class RowParts(NamedTuple):
    """What k rows are.

    Attributes
    ----------
    kind : ndarray of int, shape (k,)
        A kind of features, `LIMIT` or `UNKNOWN`.
    sides : ndarray of int, shape (k, 2)
        Both bodies; of a limit where the joint stands in q and in v.
    parts : ndarray, shape (k, 2, 2, 3)
        See `FeatureRows`; of a limit the first numbers are the sign and the offset of its gap.
    radius : ndarray, shape (k,)
        See `touch`.
    shift : ndarray, shape (k,)
        See `slip_bias`.
    """

    kind: Array
    sides: Array
    parts: Array
    radius: Array
    shift: Array


@record("f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8[::1], f8[::1]")
class RowRoom(NamedTuple):
    """Room for the evaluation of one row after the other.

    Attributes
    ----------
    along, spin, turning, across : ndarray, shape (2, 3)
        Directions of the features that were evaluated last, angular velocities of both bodies, and rates; see
        `turning_bias`.
    axes : ndarray, shape (2, 3)
        Tangents.
    point, normal : ndarray, shape (3,)
        Where they touch.
    sliding, change : ndarray, shape (3,)
        See `slip_bias`.
    """

    along: Array
    spin: Array
    turning: Array
    across: Array
    axes: Array
    point: Array
    normal: Array
    sliding: Array
    change: Array


def row_room() -> RowRoom:
    """Return room."""
    return RowRoom(*np.zeros((5, 2, 3)), *np.zeros((4, 3)))


@record(
    "i8[::1], i8[:,::1], f8[:,:,:,::1], f8[::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1],"
    " f8[::1], f8[::1], RowRoom"
)
class HeldRows(NamedTuple):
    """Rows that stay closed, k of them, with room for results; for one thread at a time.

    Attributes
    ----------
    kind, sides, parts, radius
        See `RowParts`.
    rows : ndarray, shape (nv + k, nv)
        Gradients, behind rows that are not used: what `span_equalities` takes.
    L : ndarray, shape (nv + k, nv)
        The factor of M, and behind it an orthonormal basis of the whitened gradients.
    R, S : ndarray, shape (k, k)
        See `span_equalities`, and room.
    wanted, missing, force, part : ndarray, shape (k,)
        The values of J a that keep the rows closed, the same less those without forces, forces, and room.
    room : RowRoom
        Room.
    """

    kind: Array
    sides: Array
    parts: Array
    radius: Array
    rows: Array
    L: Array
    R: Array
    S: Array
    wanted: Array
    missing: Array
    force: Array
    part: Array
    room: RowRoom


def held_rows_of(parts: RowParts, nv: int) -> HeldRows:
    """Return the record of some rows of a mechanism with nv velocities."""
    k = len(parts.kind)
    (rows, L), (R, S) = np.zeros((2, nv + k, nv)), np.zeros((2, k, k))
    wanted, missing, force, part = np.zeros((4, k))
    return HeldRows(*parts[:4], rows, L, R, S, wanted, missing, force, part, row_room())


def unknown_parts(count: int) -> RowParts:
    """Return what some rows are of which kernels know nothing."""
    sides, parts = np.zeros((count, 2), np.int64), np.zeros((count, 2, 2, 3))
    return RowParts(np.full(count, UNKNOWN), sides, parts, *np.zeros((2, count)))


@kernel("void(Mechanism, RowParts, i8[::1], f8[::1], f8[:,::1], f8[:,::1], f8[::1])")
def write_each_gap(
    m: Mechanism, rows: RowParts, index: Array, q: Array, along: Array, both: Array, gap: Array
) -> None:  # fmt: skip
    """Write what `write_gaps_of` does; `along` and `both`, shapes (2, 3), are room. Loops without arrays are faster."""
    for i in range(len(index)):
        r = index[i]
        first, second, part = rows.sides[r, 0], rows.sides[r, 1], rows.parts[r]
        if rows.kind[r] == LIMIT:
            gap[i] = part[0, 0, 0] * q[first] + part[0, 0, 1]
        else:
            places = m.poses[first], m.poses[second]
            gap[i] = touch(rows.kind[r], part, rows.radius[r], places[0], places[1], along, both[0], both[1])


@kernel("void(Mechanism, RowParts, i8[::1], f8[::1], f8[::1])")
def write_gaps_of(m: Mechanism, rows: RowParts, index: Array, q: Array, gap: Array) -> None:
    """Write the gaps of some of the rows, shape (k,), at q, where the mechanism is placed."""
    along, both = np.empty((2, 3)), np.empty((2, 3))
    write_each_gap(m, rows, index, q, along, both, gap)


@kernel("UniTuple(f8, 6)(JointTree, i8, f8[::1])")
def point_motion(tree: JointTree, body: int, point: Array) -> tuple[float, float, float, float, float, float]:
    """Return velocity and acceleration of a point of a body, shape (3,) in the world; the joints do not accelerate.

    They are those of the last `write_effects`.
    """
    V, A, base, g = tree.twist[body], tree.rate[body], tree.base[body], tree.gravity
    x, y, z = point[0] - base[0], point[1] - base[1], point[2] - base[2]
    a, b, c = cross_product(V[3], V[4], V[5], x, y, z)
    d, e, f = cross_product(A[3], A[4], A[5], x, y, z)
    u, v, w = V[0] + a, V[1] + b, V[2] + c
    a, b, c = cross_product(V[3], V[4], V[5], u, v, w)
    return u, v, w, A[0] + g[0] + d + a, A[1] + g[1] + e + b, A[2] + g[2] + f + c


@kernel("f8(Mechanism, i8, i8[::1], f8[:,:,::1], f8, f8[::1], RowRoom, f8[::1])")
def evaluate_row(
    m: Mechanism, kind: int, sides: Array, parts: Array, radius: float, q: Array, room: RowRoom, J: Array
) -> float:  # fmt: skip
    """Write the gradient of a row, shape (nv,), at q, where the mechanism is placed; return its gap."""
    first, second = sides[0], sides[1]
    if kind == LIMIT:
        for k in range(len(J)):
            J[k] = 0.0
        J[second] = parts[0, 0, 0]
        return parts[0, 0, 0] * q[first] + parts[0, 0, 1]
    gap = touch(kind, parts, radius, m.poses[first], m.poses[second], room.along, room.point, room.normal)
    row(m.columns, m.support[first], m.support[second], room.point, room.normal, J)
    return gap


@kernel("f8(Mechanism, i8, i8[::1], f8[:,:,::1], f8, RowRoom, f8[::1])")
def write_row(
    m: Mechanism, kind: int, sides: Array, parts: Array, radius: float, room: RowRoom, J: Array
) -> float:  # fmt: skip
    """Write the gradient of a row, shape (nv,), and return (dJ/dt) v.

    The mechanism is weighed and its nonlinear effects are evaluated.
    """
    evaluate_row(m, kind, sides, parts, radius, m.placed, room, J)
    if kind == LIMIT:
        return 0.0
    first, second, n = sides[0], sides[1], room.normal
    a, b, c, d, e, f = point_motion(m.tree, first, room.point)
    u, v, w, x, y, z = point_motion(m.tree, second, room.point)
    for k in range(3):
        room.spin[0, k], room.spin[1, k] = m.tree.twist[first, 3 + k], m.tree.twist[second, 3 + k]
    turn_with_bodies(room.spin, room.along, n, room.turning, room.across)
    bias = (x - d) * n[0] + (y - e) * n[1] + (z - f) * n[2]
    return bias + turning_bias(kind, radius, n, room.along, room.turning, room.across, u - a, v - b, w - c)


@kernel("void(Mechanism, i8, i8[::1], f8, f8, RowRoom, f8[:,::1], f8[::1])")
def write_slip(
    m: Mechanism, kind: int, sides: Array, radius: float, shift: float, room: RowRoom, T: Array, bias: Array
) -> None:  # fmt: skip
    """Write the gradients T of the tangents of a row, shape (2, nv), and (dT/dt) v, shape (2,), after `write_row`."""
    first, second, n, axes = sides[0], sides[1], room.normal, room.axes
    for k in range(3):
        room.point[k] += shift * n[k]
    a, b, c, d, e, f = point_motion(m.tree, first, room.point)
    u, v, w, x, y, z = point_motion(m.tree, second, room.point)
    room.sliding[0], room.sliding[1], room.sliding[2] = u - a, v - b, w - c
    room.change[0], room.change[1], room.change[2] = x - d, y - e, z - f
    write_tangents_of(n, axes)
    for i in range(2):
        row(m.columns, m.support[first], m.support[second], room.point, axes[i], T[i])
    slip_bias(
        kind, radius, shift, n, room.along, room.spin, room.turning, room.across, axes, room.sliding, room.change, bias
    )


@kernel("void(Mechanism, HeldRows)")
def write_held(m: Mechanism, held: HeldRows) -> None:
    """Write gradients and `wanted` where the mechanism is weighed and its nonlinear effects are evaluated."""
    nv = len(m.parent)
    for i in range(len(held.kind)):
        J = held.rows[nv + i]
        held.wanted[i] = -write_row(m, held.kind[i], held.sides[i], held.parts[i], held.radius[i], held.room, J)


@kernel("void(Mechanism, HeldRows, f8[::1], f8[::1])")
def hold(m: Mechanism, held: HeldRows, free: Array, out: Array) -> None:
    """Write the acceleration nearest to `free` in the kinetic metric that keeps the rows closed, shapes (nv,).

    The rows are written and the factor of M is known; rows may depend on each other.
    """
    nv = len(free)
    span_equalities(held.rows, m.parent, DEPENDENT_ROW, held.L, held.R)
    for i in range(len(held.kind)):
        J, missing = held.rows[nv + i], held.wanted[i]
        for k in range(nv):
            missing -= J[k] * free[k]
        held.missing[i] = missing
        held.part[i] = -missing
    least_change(held.L, m.parent, held.R, held.part, out)
    for k in range(nv):
        out[k] += free[k]


@kernel("void(HeldRows)")
def write_forces(held: HeldRows) -> None:
    """Write the least forces that keep the rows closed, after `hold`."""
    R, S, z, p, k = held.R, held.S, held.part, held.force, len(held.kind)
    # J M^-1 J' = R R': first R z = missing, then the least p with R'p = z, which is R y with R'R y = z
    for i in range(k):
        z[i] = 0.0
        if R[i, i] > 0.0:
            z[i] = held.missing[i]
            for j in range(i):
                z[i] -= R[i, j] * z[j]
            z[i] /= R[i, i]
    independent = True
    for i in range(k):
        independent = independent and R[i, i] > 0.0
    if independent:
        for i in range(k - 1, -1, -1):
            p[i] = z[i]
            for j in range(i + 1, k):
                p[i] -= R[j, i] * p[j]
            p[i] /= R[i, i]
        return
    for i in range(k):
        for j in range(i + 1):
            S[i, j] = 0.0
            for a in range(i, k):
                S[i, j] += R[a, i] * R[a, j]
            for a in range(j):
                S[i, j] -= S[i, a] * S[j, a]
            if i == j:
                S[i, i] = np.sqrt(S[i, i]) if R[i, i] > 0.0 else 0.0
            else:
                S[i, j] = S[i, j] / S[j, j] if R[i, i] > 0.0 and R[j, j] > 0.0 else 0.0
    for i in range(k):
        if R[i, i] > 0.0:
            for j in range(i):
                z[i] -= S[i, j] * z[j]
            z[i] /= S[i, i]
    for i in range(k - 1, -1, -1):
        if R[i, i] > 0.0:
            for j in range(i + 1, k):
                z[i] -= S[j, i] * z[j]
            z[i] /= S[i, i]
    for i in range(k):
        p[i] = 0.0
        for j in range(i + 1):
            p[i] += R[i, j] * z[j]


@kernel("void(HeldRows, f8[::1], f8[::1])")
def write_scales(held: HeldRows, free: Array, scale: Array) -> None:
    """Write the size of the terms of J a - wanted, shape (k,), where `free` is the acceleration without forces."""
    nv = len(free)
    for i in range(len(scale)):
        scale[i] = abs(held.wanted[i]) + _DENORMAL
        for k in range(nv):
            scale[i] += abs(held.rows[nv + i, k]) * abs(free[k])


@kernel("void(HeldRows, f8[::1], f8, f8[::1], f8[::1])")
def force_margins(held: HeldRows, free: Array, margin: float, scale: Array, out: Array) -> None:
    """Write the least forces as accelerations, plus a margin relative to the terms of these, shapes (k,)."""
    write_forces(held)
    write_scales(held, free, scale)
    for i in range(len(out)):
        out[i] = held.force[i] * squared(held.R[i]) + margin * scale[i]

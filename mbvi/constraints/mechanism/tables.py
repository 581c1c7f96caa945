"""The constraints of one mechanism in arrays, as the kernels of the compiled loop take them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...compiled import kernel, record
from ...projection.warm_start import MOST_KEPT
from ..rows import Array

# most rows that the kernel finds, as many as percussions are kept of; more are left to Python
MOST_ROWS = MOST_KEPT
# what a family is; `GIVEN` are functions of the user, the last two are spheres and other shapes at a mesh
LIMITS, HALF_SPACES, PAIRS, BALLS, GIVEN, BALLS_AT_MESH, SHAPES_AT_MESH = range(7)
# what `active_rows` returns: the rows are known; they are too many; shapes must be measured
FOUND, TOO_MANY, UNRESOLVED = range(3)
# by how much ways are taken longer than they are, which is more than their rounding
ROUNDED_UP = 1.0 + 1e-9


@record(
    "i8[::1], i8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[:,:,::1],"
    " f8[:,::1], f8[:,::1]"
)
class RowBuffer(NamedTuple):
    """Room for rows.

    Attributes
    ----------
    size : ndarray of int, shape (1,)
        How many there are.
    number, gap, e, lever, mu : ndarray, shape (MOST_ROWS,)
        Constraint, gap [m or rad], restitution, the factor that makes a length of the gap, coefficient of friction.
    point, normal : ndarray, shape (MOST_ROWS, 3)
        Contact points [m] and normals.
    J, T : ndarray, shapes (MOST_ROWS, nv), (2 MOST_ROWS, nv)
        Gradients, and those along two tangents; the latter have no rows in problems without friction.
    axes : ndarray, shape (MOST_ROWS, 2, 3)
        The tangents.
    resistance, R : ndarray, shapes (MOST_ROWS, 2), (3 MOST_ROWS, nv)
        As `resistance` of `Tangents`, and gradients of the angular velocities about normals and tangents; without rows
        in problems without torsional and rolling friction.
    """

    size: Array
    number: Array
    gap: Array
    e: Array
    lever: Array
    mu: Array
    point: Array
    normal: Array
    J: Array
    T: Array
    axes: Array
    resistance: Array
    R: Array


@record("i8[::1], i8[::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1], b1[::1], f8[::1]")
class Clearances(NamedTuple):
    """The state of a `ClearanceCache`.

    Attributes
    ----------
    kind : ndarray of int, shape (m,)
        What each family is.
    slot : ndarray of int, shape (m,)
        Its row in the arrays of the cache; -1 for a family that is queried at every step.
    envelope, travel, clearance
        See `consume_clearance`; n families have a row there.
    q : ndarray, shape (nq,)
        The configuration of the last query.
    always : ndarray of bool, shape (n,)
        The families of which some candidates must be measured at every step.
    moved : ndarray, shape (nv,)
        Room for the displacement since then.
    """

    kind: Array
    slot: Array
    envelope: Array
    travel: Array
    clearance: Array
    q: Array
    always: Array
    moved: Array


@record("f8[::1], f8[::1], f8[::1], i8[::1], i8[::1], f8[::1], i8[::1], i8[::1]")
class Limits(NamedTuple):
    """Joint limits of all mechanisms.

    Attributes
    ----------
    sign, offset, lever, position, velocity, e : ndarray, shape (m,)
        See `JointLimits`.
    number : ndarray of int, shape (m,)
        The constraints.
    begin : ndarray of int, shape (families + 1,)
        Where the limits of each family begin; others have none.
    """

    sign: Array
    offset: Array
    lever: Array
    position: Array
    velocity: Array
    e: Array
    number: Array
    begin: Array


@record(
    "f8[:,::1], f8[::1], i8[::1], i8[::1], i8[::1], i8[:,::1], f8[::1], f8[::1], f8[:,::1], i8[::1], i8[::1], f8[::1]"
)
class PairFamily(NamedTuple):
    """Pairs of shapes.

    Attributes
    ----------
    reach, clearance, candidates
        See `list_candidates`, shapes (nv, n), (n,) and (n,).
    listed : ndarray of int, shape (2,)
        How many candidates there are, and at how many queries in a row one of them had no row.
    number : ndarray of int, shape (n,)
        The constraints.
    bodies : ndarray of int, shape (2, n)
        The first and the second body of each pair.
    e, mu : ndarray, shape (n,)
        Restitution and friction.
    resistance : ndarray, shape (n, 2) or (0, 2)
        Lengths of torsional and rolling friction [m].
    begin, velocity, lever : ndarray, shapes (n + 1,), (k,) and (k,)
        The velocities that move each pair, and the entries of `reach` for these, pair after pair.
    """

    reach: Array
    clearance: Array
    candidates: Array
    listed: Array
    number: Array
    bodies: Array
    e: Array
    mu: Array
    resistance: Array
    begin: Array
    velocity: Array
    lever: Array


@kernel("f8(PairFamily, f8[::1], i8)")
def way_of(family: PairFamily, travel: Array, pair: int) -> float:
    """Return by how much the gap of a pair may have fallen over a travel, shape (nv,) [m]."""
    way = 0.0
    for i in range(family.begin[pair], family.begin[pair + 1]):
        way += travel[family.velocity[i]] * family.lever[i]
    return way


@kernel("b1(PairFamily, i8, f8, f8)")
def has_clearance(family: PairFamily, pair: int, way: float, tolerance: float) -> bool:
    """Return whether the gap of a pair is above a tolerance after a way since the candidates were listed [m]."""
    return family.clearance[pair] - ROUNDED_UP * way > tolerance


@kernel("RowBuffer(i8, RowBuffer)")
def rows_for(count: int, like: RowBuffer) -> RowBuffer:
    """Return room for some rows like others."""
    nv, turning = like.J.shape[1], count if len(like.R) > 0 else 0
    gap, e, lever, mu = np.zeros(count), np.zeros(count), np.zeros(count), np.zeros(count)
    point, normal, axes = np.zeros((count, 3)), np.zeros((count, 3)), np.zeros((count, 2, 3))
    J, T = np.zeros((count, nv)), np.zeros((2 * count if len(like.T) > 0 else 0, nv))
    size, number, resistance, R = (
        np.zeros(1, np.int64),
        np.zeros(count, np.int64),
        np.zeros((turning, 2)),
        np.zeros((3 * turning, nv)),
    )
    return RowBuffer(size, number, gap, e, lever, mu, point, normal, J, T, axes, resistance, R)


@kernel("void(RowBuffer, i8, RowBuffer)")
def copy_row(rows: RowBuffer, a: int, others: RowBuffer) -> None:
    """Append row a of some rows to others."""
    m, nv = others.size[0], rows.J.shape[1]
    others.number[m], others.gap[m], others.e[m] = rows.number[a], rows.gap[a], rows.e[a]
    others.lever[m], others.mu[m] = rows.lever[a], rows.mu[a]
    for c in range(3):
        others.point[m, c], others.normal[m, c] = rows.point[a, c], rows.normal[a, c]
    for k in range(nv):
        others.J[m, k] = rows.J[a, k]
    if len(rows.T) > 0:
        for c in range(2):
            for k in range(3):
                others.axes[m, c, k] = rows.axes[a, c, k]
            for k in range(nv):
                others.T[2 * m + c, k] = rows.T[2 * a + c, k]
    if len(rows.R) > 0:
        others.resistance[m, 0], others.resistance[m, 1] = rows.resistance[a, 0], rows.resistance[a, 1]
        for c in range(3):
            for k in range(nv):
                others.R[3 * m + c, k] = rows.R[3 * a + c, k]
    others.size[0] = m + 1

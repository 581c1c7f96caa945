"""Kernels of the position projection where gaps are linear in the displacement: the law at closed contacts included."""

from __future__ import annotations

import numpy as np

from ..compiled import kernel
from .metric import Array
from .robot_step import solve_active_set

# most linearisations of the constraints within a step
MOST_LINEARISATIONS = 20
# rows whose gap is below this part of the penetration take part in the projection
NEARBY = 0.1
# what `settle_positions` found
NO_PENETRATION, PROJECTED, UNDECIDED = 0, 1, 2


@kernel("f8(f8[:,::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1], b1[::1], f8, f8[::1], f8[:,::1])")
def project_some(
    J: Array, A: Array, W: Array, x: Array, lower: Array, some: Array, limit: float, w: Array, table: Array
) -> float:
    """Write argmin |w - x|_M with J w >= lower for the rows of a mask.

    Parameters
    ----------
    J, A, W, x, lower, limit, w
        As of `solve_active_set`; W is not changed.
    some : ndarray of bool, shape (m,)
        The rows that count.
    table : ndarray, shape (3, m)
        Receives percussions, J x and J w; of all rows the last two.

    Returns
    -------
    float
        As of `solve_active_set`.
    """
    m, n = J.shape
    count = 0
    for a in range(m):
        count += some[a]
    rows, solved, whitened = np.empty((count, n)), np.empty((count, n)), np.empty((count, n))
    bounds, part, i = np.empty(count), np.empty((3, count)), 0
    for a in range(m):
        if some[a]:
            for k in range(n):
                rows[i, k], solved[i, k], whitened[i, k] = J[a, k], A[a, k], W[a, k]
            bounds[i] = lower[a]
            i += 1
    residual = solve_active_set(rows, solved, whitened, x, bounds, bounds[:0], limit, w, part)
    i = 0
    for a in range(m):
        table[0, a] = table[1, a] = table[2, a] = 0.0
        for k in range(n):
            table[1, a] += J[a, k] * x[k]
            table[2, a] += J[a, k] * w[k]
        if some[a]:
            table[0, a] = part[0, i]
            i += 1
    return residual


@kernel("f8(f8[:,::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8[::1], b1[::1], f8, f8, f8, f8[::1])")
def raise_gaps(
    J: Array, A: Array, W: Array, gap: Array, lever: Array, bound: Array, near: Array, tolerance: float, depth: float,
    limit: float, moved: Array,
) -> float:  # fmt: skip
    """Write the smallest displacement, in the kinetic metric, after which no linear gap is below its lower bound.

    Parameters
    ----------
    J, A, W, limit
        As of `project_some`.
    gap, lever : ndarray, shape (m,)
        Gaps before the displacement, and the factors that make lengths of them.
    bound : ndarray, shape (m,)
        Lower bounds of gaps after it.
    near : ndarray of bool, shape (m,)
        The rows of the first projection; receives those of the last.
    tolerance, depth : float
        To which bounds are met, and the largest distance by which a gap must rise [m].
    moved : ndarray, shape (nv,)
        Receives the displacement.

    Returns
    -------
    float
        The relative KKT residual of the last projection; inf if there is no such displacement, or none is found.
    """
    m, n = J.shape
    still, lower, table, pushed = np.zeros(n), np.empty(m), np.empty((3, m)), np.empty(m, np.bool_)
    for _ in range(MOST_LINEARISATIONS):
        for a in range(m):
            lower[a] = bound[a] - gap[a]
        residual = project_some(J, A, W, still, lower, near, limit, moved, table)
        # written so that a NaN is refused too
        if not 0.0 <= residual < np.inf:
            return np.inf
        settled = True
        for a in range(m):
            pushed[a] = near[a] and table[0, a] > 0.0
            place = gap[a] + table[2, a]
            near[a] = lever[a] * place <= tolerance + NEARBY * depth
            if near[a]:
                above = lever[a] * (place - bound[a])
                settled = settled and above >= -tolerance and (above <= tolerance or not pushed[a])
        if settled:
            return residual
    return np.inf


@kernel("f8(f8[:,::1], f8[::1])")
def largest_travel(squares: Array, displacement: Array) -> float:
    """Return the largest displacement of a body, as of `ClearanceCache.travel`; squares of shape (families, nv)."""
    families, n = squares.shape
    most = 0.0
    for i in range(families):
        travel = 0.0
        for k in range(n):
            travel += squares[i, k] * displacement[k] * displacement[k]
        most = max(most, travel)
    return np.sqrt(most)


@kernel("b1(f8[::1], f8[::1], f8[::1], b1[::1], f8[:,::1], f8, f8, f8, b1[::1])")
def find_closed(
    gap: Array, lever: Array, e: Array, law: Array, rates: Array, h: float, drift: float, tolerance: float,
    closed: Array,
) -> bool:  # fmt: skip
    """Find the closed contacts among the rows of the law; see `project_positions`.

    Parameters
    ----------
    gap, lever, e, law, rates, h, drift, tolerance
        As of `settle_positions`.
    closed : ndarray of bool, shape (m,)
        Receives which rows are closed.

    Returns
    -------
    bool
        False where another contact bounces: rates alone do not tell then which rows are closed.
    """
    restitution = bounces = some = False
    for a in range(len(gap)):
        closed[a] = False
        if law[a]:
            closed[a] = h * lever[a] * abs(rates[2, a]) <= tolerance
            some = some or closed[a]
            restitution = restitution or e[a] > 0.0
            # its gap where the law acts
            sunk = lever[a] * (gap[a] - drift * rates[3, a]) < -tolerance
            bounces = bounces or (not closed[a] and (rates[0, a] > 0.0 or sunk))
    return not (restitution and bounces and some)


@kernel("i8(i8[::1], f8[:,::1], i8, b1[::1])")
def nearest_row(number: Array, point: Array, a: int, some: Array) -> int:
    """Return the row of the same constraint, of those in a mask, whose point is nearest to that of row a; -1 for none.

    Points have shape (m, 3); distances that are NaN, as of joint limits, count as zero.
    """
    nearest, least = -1, np.inf
    for b in range(len(number)):
        if some[b] and number[b] == number[a]:
            apart = 0.0
            for axis in range(3):
                apart += (point[a, axis] - point[b, axis]) ** 2
            if np.isnan(apart):
                apart = 0.0
            if apart < least:
                nearest, least = b, apart
    return nearest


@kernel("i8(i8[::1], f8[:,::1], i8, b1[::1], b1[::1])")
def moved_from(number: Array, point: Array, a: int, near: Array, law: Array) -> int:
    """Return the row of the law whose contact has moved to row a; -1 if there is none.

    It is of the same constraint, and each of the two is the nearest to the other: a among those of the law, which it
    does not belong to, the other among the rows of the mask `near`, which a belongs to.
    """
    b = nearest_row(number, point, a, law)
    return b if b >= 0 and nearest_row(number, point, b, near) == a else -1


@kernel("void(i8[::1], f8[:,::1], f8[:,::1], f8[::1], b1[::1], b1[::1], b1[::1], f8[:,::1])")
def follow_contacts(
    number: Array, point: Array, J: Array, v: Array, near: Array, law: Array, closed: Array, rates: Array
) -> None:
    """Put the rows to which contacts have moved in the place of the law's; see `moved_from` and `settle_positions`."""
    m, n = J.shape
    before = law.copy()
    for a in range(m):
        if near[a] and not before[a]:
            b = moved_from(number, point, a, near, before)
            if b >= 0:
                law[a], law[b], closed[a], rates[0, a] = True, False, closed[b], rates[0, b]
                rates[3, a] = 0.0
                for k in range(n):
                    rates[3, a] += J[a, k] * v[k]


@kernel(
    "f8(i8[::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8[::1], f8[::1], b1[::1], f8[:,::1], f8, f8, f8, b1[::1], "
    "f8[::1], f8[::1], b1[::1])"
)
def find_sunk(
    number: Array, point: Array, J: Array, gap: Array, lever: Array, e: Array, displacement: Array, law: Array,
    rates: Array, h: float, drift: float, tolerance: float, closed: Array, end: Array, bound: Array, near: Array,
) -> float:  # fmt: skip
    """Return the largest distance by which a closed contact must rise [m], 0 for none; -1 where a contact bounces.

    Parameters
    ----------
    number, point, J, gap, lever, e, displacement, law, rates, h, drift, tolerance
        As of `settle_positions`.
    closed : ndarray of bool, shape (m,)
        Receives which rows are closed, and the active ones that take the place of a closed row of their constraint.
    end, bound : ndarray, shape (m,)
        Receive the gaps at the end of the step, and the lower bounds that a position projection must keep.
    near : ndarray of bool, shape (m,)
        Receives which rows are active there.
    """
    if not find_closed(gap, lever, e, law, rates, h, drift, tolerance, closed):
        return -1.0
    m, n = J.shape
    depth = 0.0
    for a in range(m):
        end[a] = gap[a]
        for k in range(n):
            end[a] += J[a, k] * displacement[k]
        near[a] = lever[a] * end[a] <= tolerance
    for a in range(m):
        length = lever[a] * end[a]
        if near[a] and not law[a]:
            b = moved_from(number, point, a, near, law)
            closed[a] = b >= 0 and closed[b]
        # bounds below zero by no more than the tolerance stay: they would contradict each other by their rounding
        sunk = near[a] and closed[a] and length < -tolerance
        bound[a] = 0.0 if sunk or not near[a] else min(end[a], 0.0)
        if sunk:
            depth = max(depth, -length)
    return depth if depth > tolerance else 0.0


@kernel(
    "f8(f8[:,::1], f8[:,::1], f8[:,::1], f8[::1], b1[::1], b1[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8, f8, "
    "f8[:,::1])"
)
def join_rows(
    J: Array, A: Array, W: Array, e: Array, joining: Array, law: Array, x: Array, v: Array, w: Array, open_by: Array,
    drift: float, limit: float, rates: Array,
) -> float:  # fmt: skip
    """Add rows that became active to those of the law, and apply it again; return the residual as of `project_some`.

    Parameters
    ----------
    J, A, W, e, law, x, v, w, drift, limit, rates
        As of `settle_positions`.
    joining : ndarray of bool, shape (m,)
        The rows to be added.
    open_by : ndarray, shape (m,)
        Gaps of rows where the law acts: these may close by the end of the step, so that a row that is open there bears
        no load. 0 for the first rows of the law; those of rows that join are given.
    """
    m, n = J.shape
    lower, table = np.empty(m), np.empty((3, m))
    for a in range(m):
        law[a] = law[a] or joining[a]
        rates[3, a] = 0.0
        for k in range(n):
            rates[3, a] += J[a, k] * v[k]
        lower[a] = min(-e[a] * rates[3, a], -open_by[a] / drift)
    residual = project_some(J, A, W, x, lower, law, limit, w, table)
    for a in range(m):
        rates[0, a], rates[1, a], rates[2, a] = table[0, a], table[1, a], table[2, a]
    return residual


@kernel(
    "f8(f8[:,::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8[::1], b1[::1], b1[::1], b1[::1], f8[::1], f8, f8, f8, "
    "f8[::1], f8[:,::1])"
)
def tangent_velocity(
    J: Array, A: Array, W: Array, end: Array, lever: Array, e: Array, near: Array, closed: Array, law: Array,
    x: Array, rest: float, tolerance: float, limit: float, tangent: Array, rates: Array,
) -> float:  # fmt: skip
    """Write the velocity that is tangent to the closed contacts; return the residual as of `project_some`.

    Parameters
    ----------
    J, A, W, lever, e, law, x, tolerance, limit, tangent, rates
        As of `settle_positions`.
    end : ndarray, shape (m,)
        Gaps after the position projection.
    near, closed : ndarray of bool, shape (m,)
        The rows of that projection, and the closed ones.
    rest : float
        Time from the end of the step to the next law [s].
    """
    m = len(end)
    lower, table = np.empty(m), np.empty((3, m))
    for a in range(m):
        if near[a] and closed[a]:
            # the projection changed the gradients of closed contacts: that must not make them bounce
            e[a] = 0.0
        lower[a] = -e[a] * rates[3, a]
        # a gap that the projection left open may close until the next law: otherwise its body would fall freely
        if near[a] and (closed[a] or rates[0, a] == 0.0) and lever[a] * end[a] > tolerance:
            lower[a] = -end[a] / rest
    residual = project_some(J, A, W, x, lower, law, limit, tangent, table)
    for a in range(m):
        rates[0, a], rates[1, a], rates[2, a] = table[0, a], table[1, a], table[2, a]
    return residual


@kernel(
    "Tuple((i8, f8))(i8[::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8[::1], f8[:,::1], "
    "f8[::1], f8[::1], f8[::1], f8[::1], b1[::1], b1[::1], f8[:,::1], f8[::1], f8[::1], f8, f8, f8, f8, f8, f8)"
)
def settle_positions(
    number: Array, point: Array, J: Array, A: Array, W: Array, gap: Array, lever: Array, e: Array, squares: Array,
    x: Array, v: Array, w: Array, displacement: Array, law: Array, near: Array, rates: Array, moved: Array,
    tangent: Array, h: float, drift: float, tolerance: float, reach: float, margin: float, limit: float,
) -> tuple[int, float]:  # fmt: skip
    """Project closed contacts out of penetration where gaps are linear; see `project_positions`.

    Parameters
    ----------
    number, point : ndarray, shapes (m,) and (m, 3)
        The constraint and the contact point of each row.
    J, A, W : ndarray, shape (m, nv)
        Gradients of all rows that can take part, M^-1 times each, and each whitened.
    gap, lever, e : ndarray, shape (m,)
        Gaps at the end of the step at the velocity before it, factors that make lengths of them, and restitution; e of
        closed contacts that are projected becomes 0, and gaps those at the end.
    squares : ndarray, shape (families, nv)
        As of `largest_travel`.
    x, v : ndarray, shape (nv,)
        The free motion and the velocity before the law.
    w : ndarray, shape (nv,)
        The velocity after the law; overwritten where rows join the law.
    displacement : ndarray, shape (nv,)
        From where the gaps are known to the end of the step; changes with w.
    law : ndarray of bool, shape (m,)
        The rows of the law; rows that join are added, and rows to which contacts moved take the place of others.
    near : ndarray of bool, shape (m,)
        Receives the rows of the last position projection.
    rates : ndarray, shape (4, m)
        Percussions and rates of the law's rows, as of `Step`; overwritten by those of the last law.
    moved, tangent : ndarray, shape (nv,)
        Receive the displacement that removes penetration, and the velocity tangent to the closed contacts after it.
    h, drift : float
        Length of the step, and the time from the law to its end [s].
    tolerance : float
        Activation tolerance [m].
    reach, margin : float
        Travel up to which gaps are linear, and how far beyond the tolerance the rows are known [m].
    limit : float
        Residual that is accepted.

    Returns
    -------
    code : int
        NO_PENETRATION: nothing closed has sunk; w, rates and law are good. PROJECTED: all is good. UNDECIDED: another
        way must be taken, from what was given.
    residual : float
        Relative KKT residual, -1 where no projection was solved.
    """
    m, n = J.shape
    closed, joining, bound, open_by = np.empty(m, np.bool_), np.empty(m, np.bool_), np.empty(m), np.zeros(m)
    end, total, residual, raised, joins = np.empty(m), np.empty(n), -1.0, 0.0, True
    for _ in range(MOST_LINEARISATIONS):
        depth = find_sunk(
            number, point, J, gap, lever, e, displacement, law, rates, h, drift, tolerance, closed, end, bound, near
        )
        if depth < 0.0 or largest_travel(squares, displacement) > reach:
            return UNDECIDED, residual
        if depth == 0.0:
            for a in range(m):
                gap[a] = end[a]
            return NO_PENETRATION, residual
        raised = raise_gaps(J, A, W, end, lever, bound, near, tolerance, depth, limit, moved)
        for k in range(n):
            total[k] = displacement[k] + moved[k]
        travel = largest_travel(squares, total)
        if raised == np.inf or travel > reach or NEARBY * depth + travel > margin:
            return UNDECIDED, residual
        joins = False
        for a in range(m):
            joining[a] = near[a] and not law[a] and moved_from(number, point, a, near, law) < 0
            joins = joins or joining[a]
            change = ahead = 0.0
            for k in range(n):
                change += J[a, k] * moved[k]
                ahead += J[a, k] * w[k]
            if joining[a]:
                open_by[a] = max(end[a] - drift * ahead, 0.0)
            end[a] += change
        if not joins:
            break
        for k in range(n):
            displacement[k] -= drift * w[k]
        residual = join_rows(J, A, W, e, joining, law, x, v, w, open_by, drift, limit, rates)
        # written so that a NaN is refused too
        if not 0.0 <= residual < np.inf:
            return UNDECIDED, residual
        for k in range(n):
            displacement[k] += drift * w[k]
    if joins:
        return UNDECIDED, residual
    for a in range(m):
        gap[a] = end[a]
    follow_contacts(number, point, J, v, near, law, closed, rates)
    residual = tangent_velocity(
        J, A, W, end, lever, e, near, closed, law, x, h - drift, tolerance, limit, tangent, rates
    )
    return PROJECTED if 0.0 <= residual < np.inf else UNDECIDED, max(residual, raised)

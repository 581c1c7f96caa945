"""The kernel of the position projection where gaps are linear in the displacement, with the law at what it closes."""

from __future__ import annotations

import numpy as np

from ..compiled import kernel
from .closed_contacts import find_sunk, follow_contacts, moved_from
from .metric import Array
from .raise_gaps import MOST_LINEARISATIONS, NEARBY, largest_travel, project_some, raise_gaps

# what `settle_positions` found
NO_PENETRATION, PROJECTED, UNDECIDED = 0, 1, 2


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
    J, A, W : ndarray, shape (m, nv)
        `law_J`, `law_A`, `law_W` of `settle_positions`.
    e, law, x, v, w, drift, limit, rates
        As of `settle_positions`.
    joining : ndarray of bool, shape (m,)
        The rows to be added.
    open_by : ndarray, shape (m,)
        Gaps of rows where the law acts: these may close by the end of the step, so that a row that is open there bears
        no load. 0 for rows that are closed there.
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


@kernel("void(f8[:,::1], b1[::1], f8[:,::1], b1[::1], f8[::1], f8[::1], f8[::1])")
def start_of_tangent(A: Array, law: Array, rates: Array, free: Array, x: Array, w: Array, start: Array) -> None:
    """Write the free motion, of free bodies the velocity after the law less its percussions at the rows of the end.

    What the percussions of the tangent velocity differ by from those of the law is then an impulse at these rows. The
    arguments are those of `settle_positions`; `start` has shape (nv,).
    """
    for k in range(len(x)):
        start[k] = x[k]
        if free[k]:
            start[k] = w[k]
            for a in range(len(law)):
                if law[a]:
                    start[k] -= rates[0, a] * A[a, k]


@kernel(
    "f8(f8[:,::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8[::1], b1[::1], b1[::1], b1[::1], f8[::1], f8[::1], "
    "f8[::1], f8, f8, f8, f8[::1], f8[:,::1])"
)
def tangent_velocity(
    J: Array, A: Array, W: Array, end: Array, lever: Array, e: Array, near: Array, closed: Array, law: Array,
    x: Array, start: Array, v: Array, rest: float, tolerance: float, limit: float, tangent: Array, rates: Array,
) -> float:  # fmt: skip
    """Write the velocity that is tangent to the closed contacts; return the residual as of `project_some`.

    Parameters
    ----------
    J, A, W, lever, e, law, x, v, tolerance, limit, tangent, rates
        As of `settle_positions`.
    start : ndarray, shape (nv,)
        The velocity to which percussions are added, as of `start_of_tangent`.
    end : ndarray, shape (m,)
        Gaps after the position projection.
    near, closed : ndarray of bool, shape (m,)
        The rows of that projection, and the closed ones.
    rest : float
        Time from the end of the step to the next law [s].
    """
    m, n = J.shape
    lower, table = np.empty(m), np.empty((3, m))
    for a in range(m):
        rates[3, a] = 0.0
        if law[a]:
            for k in range(n):
                rates[3, a] += J[a, k] * v[k]
        if near[a] and closed[a]:
            # the projection changed the gradients of closed contacts: that must not make them bounce
            e[a] = 0.0
        lower[a] = -e[a] * rates[3, a]
        # a gap that the projection left open may close until the next law: otherwise its body would fall freely;
        # a contact that bounces leaves by Newton's law
        if lever[a] * end[a] > tolerance and (closed[a] or rates[0, a] == 0.0):
            lower[a] = -end[a] / rest if near[a] else min(lower[a], -end[a] / rest)
    residual = project_some(J, A, W, start, lower, law, limit, tangent, table)
    for a in range(m):
        rates[0, a], rates[1, a], rates[2, a] = table[0, a], 0.0, table[2, a]
        for k in range(n):
            rates[1, a] += J[a, k] * x[k]
    return residual


@kernel(
    "Tuple((i8, f8))(i8[::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[::1], "
    "f8[::1], f8[::1], f8[::1], f8[:,::1], f8[::1], f8[::1], f8[::1], f8[::1], b1[::1], b1[::1], f8[:,::1], f8[::1], "
    "f8[::1], b1[::1], f8, f8, f8, f8, f8, f8)",
    apart=True,
)
def settle_positions(
    number: Array, point: Array, J: Array, A: Array, W: Array, law_J: Array, law_A: Array, law_W: Array, gap: Array,
    lever: Array, e: Array, opened: Array, squares: Array, x: Array, v: Array, w: Array, displacement: Array,
    law: Array, near: Array, rates: Array, moved: Array, tangent: Array, free: Array, h: float, drift: float,
    tolerance: float, reach: float, margin: float, limit: float,
) -> tuple[int, float]:  # fmt: skip
    """Project closed contacts out of penetration where gaps are linear; see `project_positions`.

    Parameters
    ----------
    number, point : ndarray, shapes (m,) and (m, 3)
        The constraint and the contact point of each row.
    J, A, W : ndarray, shape (m, nv)
        Gradients at the end of the step of all rows that can take part, M^-1 times each, and each whitened.
    law_J, law_A, law_W : ndarray, shape (m, nv)
        The same where the law acts; rows that are not known there have the gradients of the end.
    gap, lever, e : ndarray, shape (m,)
        Gaps at the end of the step at the velocity before it, factors that make lengths of them, and restitution; e of
        closed contacts that are projected becomes 0, and gaps those at the end.
    opened : ndarray, shape (m,)
        Speeds at which rows that are open where the law acts may close there, 0 of others.
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
    free : ndarray of bool, shape (nv,)
        Which velocities are those of free bodies; rows that join the law of these are left to another way, because
        their gradients must be those where the law acts.
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
    start, some_free = np.empty(n), free.any()
    closed, joining, bound, open_by = np.empty(m, np.bool_), np.empty(m, np.bool_), np.empty(m), np.empty(m)
    for a in range(m):
        open_by[a] = drift * opened[a]
    end, total, residual, raised, joins = np.empty(m), np.empty(n), -1.0, 0.0, True
    for _ in range(MOST_LINEARISATIONS):
        depth = find_sunk(
            number, point, J, gap, lever, e, v, w, displacement, law, rates, h, drift, tolerance, closed, end, bound,
            near,
        )  # fmt: skip
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
        if some_free:
            return UNDECIDED, residual
        for k in range(n):
            displacement[k] -= drift * w[k]
        residual = join_rows(law_J, law_A, law_W, e, joining, law, x, v, w, open_by, drift, limit, rates)
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
    start_of_tangent(A, law, rates, free, x, w, start)
    residual = tangent_velocity(
        J, A, W, end, lever, e, near, closed, law, x, start, v, h - drift, tolerance, limit, tangent, rates
    )
    return PROJECTED if 0.0 <= residual < np.inf else UNDECIDED, max(residual, raised)

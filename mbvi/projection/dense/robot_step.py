"""Kernels of the fused step: one mechanism with a few rows, its active set guessed, solved, refined and checked.

An answer counts if its own KKT residual is at rounding; otherwise other solvers are tried.
"""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ..metric import Array
from ..row_speeds import row_speeds
from ..tree import advance_by, factor_again, solve
from .goldfarb_idnani import LAST_DIGITS, goldfarb_idnani, start_from
from .orthonormal_rows import solve_lower, solve_upper
from .scaled_qp import FAR
from .shared_percussions import share

# a violation below this share of the sum of its terms is rounding
ROUNDING = 1e-13
# part of the residual that the active set is found to
_MARGIN = 0.5
_REFINEMENTS = 2
# rows contradict each other if a sum of theirs vanishes to the first part, and demands this part of their bounds
_VANISHES, _DEMANDS = 1e-12, 1e-6


@kernel("UniTuple(f8, 2)(f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8[:,::1], f8[::1], f8[::1])")
def scale_rows(
    J: Array, W: Array, x: Array, lower: Array, table: Array, lengths: Array, d: Array
) -> tuple[float, float]:
    """Scale whitened rows to unit length, and write their lengths and violations.

    Parameters
    ----------
    J, W, x, lower, table
        See `solve_active_set`; J x is known.
    lengths, d : ndarray, shape (m,)
        Receive the lengths in the metric and the scaled violations.

    Returns
    -------
    largest : float
        The largest scaled speed, the unit of residuals; -1 where a row has no length. Rows that are far open do not
        count; see `FAR`.
    most_terms : float
        The largest sum of the magnitudes of which a scaled violation of these rows is the sum.
    """
    m, n = J.shape
    largest = most_terms = violated = widest = 0.0
    for a in range(m):
        length = 0.0
        for k in range(n):
            length += W[a, k] * W[a, k]
        if not length > 0.0:
            return -1.0, 0.0
        length = np.sqrt(length)
        terms = abs(lower[a])
        for k in range(n):
            W[a, k] /= length
            terms += abs(J[a, k] * x[k])
        lengths[a], d[a] = length, (lower[a] - table[1, a]) / length
        speed = (abs(table[1, a]) + abs(lower[a])) / length
        largest, most_terms, widest = max(largest, speed), max(most_terms, terms / length), max(widest, -d[a])
        if d[a] > 0.0:
            violated = max(violated, speed)
    if violated == 0.0 or not widest > FAR * violated:
        return largest, most_terms
    largest = most_terms = 0.0
    for a in range(m):
        if -d[a] <= FAR * violated:
            terms = abs(lower[a])
            for k in range(n):
                terms += abs(J[a, k] * x[k])
            largest = max(largest, (abs(table[1, a]) + abs(lower[a])) / lengths[a])
            most_terms = max(most_terms, terms / lengths[a])
    return largest, most_terms


@kernel("f8(f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8[::1], f8[::1], f8, f8[::1], f8[::1], f8[:,::1])")
def natural_residual(
    J: Array, A: Array, x: Array, lower: Array, lengths: Array, u: Array, largest: float, slack: Array, w: Array,
    table: Array,
) -> float:  # fmt: skip
    """Write the velocity x + A' p that scaled percussions bring about; return max |min(u, slack)| / largest.

    Parameters
    ----------
    J, A, x, lower, w, table
        See `solve_active_set`.
    lengths, largest
        See `scale_rows`.
    u, slack : ndarray, shape (m,)
        Scaled percussions; receives the scaled slacks J w - lower.
    """
    m, n = J.shape
    for k in range(n):
        w[k] = x[k]
    for a in range(m):
        table[0, a] = u[a] / lengths[a]
        if u[a] != 0.0:
            for k in range(n):
                w[k] += table[0, a] * A[a, k]
    residual = 0.0
    row_speeds(J, w, 1.0, table[2])
    for a in range(m):
        slack[a] = (table[2, a] - lower[a]) / lengths[a]
        off = abs(min(u[a], slack[a])) / largest
        # written so that a NaN stays
        if not off <= residual and residual == residual:
            residual = off
    return residual


@kernel("i8(f8[:,::1], f8[::1], f8[::1], i8[::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1])")
def first_set(W: Array, d: Array, last: Array, S: Array, L: Array, Q: Array, part: Array, z: Array) -> int:
    """Start the dual active-set method from the violated rows or from those of the last projection; return how many.

    Parameters
    ----------
    W, d, S, L, Q, part, z
        See `goldfarb_idnani`.
    last
        See `solve_active_set`.
    """
    m = len(d)
    chosen, differs = np.empty(m, np.bool_), False
    for a in range(m):
        chosen[a] = d[a] > 0.0
    size = start_from(W, d, chosen, S, L, Q, part, z)
    if size == 0 and len(last) == m:
        for a in range(m):
            differs = differs or chosen[a] != (last[a] > 0.0)
            chosen[a] = last[a] > 0.0
        if differs:
            size = start_from(W, d, chosen, S, L, Q, part, z)
    return size


@kernel("f8(f8[:,::1], f8[::1], i8[::1], i8, f8[::1])")
def least_violation(W: Array, d: Array, S: Array, size: int, u: Array) -> float:
    """Return the least violation that some row has at every z, if percussions prove that there is one; 0 otherwise.

    If W_S' u = 0 and d_S . u > 0 for u >= 0, no z has W z >= d (Farkas' lemma). The arguments are those of
    `goldfarb_idnani`, whose u becomes huge where rows contradict each other to within their rounding.
    """
    largest = most = demanded = bounds = total = 0.0
    for k in range(W.shape[1]):
        left = terms = 0.0
        for i in range(size):
            left += u[i] * W[S[i], k]
            terms += abs(u[i] * W[S[i], k])
        largest, most = max(largest, abs(left)), max(most, terms)
    for i in range(size):
        demanded += u[i] * d[S[i]]
        bounds += u[i] * abs(d[S[i]])
        total += u[i]
    contradict = largest <= _VANISHES * most and demanded > _DEMANDS * bounds
    return demanded / total if contradict else 0.0


@kernel("f8(f8[:,::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8[::1], f8, f8[::1], f8[:,::1])", apart=True)
def solve_active_set(
    J: Array, A: Array, W: Array, x: Array, lower: Array, last: Array, limit: float, w: Array, table: Array
) -> float:
    """Write argmin |w - x|_M with J w >= lower.

    Parameters
    ----------
    J, A, W : ndarray, shape (m, nv)
        Gradients, M^-1 times each of them, and each of them whitened; the last is scaled to unit rows.
    x, w : ndarray, shape (nv,)
        The velocity to project and the result.
    lower : ndarray, shape (m,)
        Least rates.
    last : ndarray, shape (m,) or (0,)
        Percussions of the same rows in the last projection, if any.
    limit : float
        The residual that is accepted; where it is below rounding, one at rounding is.
    table : ndarray, shape (3, m)
        Receives percussions, J x and J w.

    Returns
    -------
    float
        The relative KKT residual of what was written, if it is accepted; else inf, and that is no answer. Where rows
        contradict each other, minus the least relative violation of some row that every velocity has.
    """
    m, n = J.shape
    violated = False
    for a in range(m):
        speed, terms = 0.0, abs(lower[a])
        for k in range(n):
            term = J[a, k] * x[k]
            speed += term
            terms += abs(term)
        table[0, a], table[1, a], table[2, a] = 0.0, speed, speed
        violated = violated or not lower[a] - speed <= ROUNDING * terms
    for k in range(n):
        w[k] = x[k]
    if not violated:
        return 0.0
    # one array instead of ten: each costs as much as the projection of a row
    most = min(m, n) + 1
    room, k = np.empty(4 * m + most * (2 + most + n) + n), 4 * m
    lengths, d, u, slack = room[:m], room[m : 2 * m], room[2 * m : 3 * m], room[3 * m : k]
    part, correction, z = room[k : k + most], room[k + most : k + 2 * most], room[k + 2 * most : k + 2 * most + n]
    k += 2 * most + n
    L, Q = room[k : k + most * most].reshape((most, most)), room[k + most * most :].reshape((most, n))
    largest, most_terms = scale_rows(J, W, x, lower, table, lengths, d)
    if largest < 0.0:
        return np.inf
    enough = max(ROUNDING, LAST_DIGITS * most_terms / largest)
    S = np.empty(most, np.int64)
    size = first_set(W, d, last, S, L, Q, part, z)
    tight = _MARGIN * enough * largest
    size, contradiction = goldfarb_idnani(W, d, tight, size, S, L, Q, part, z, slack)
    if size < 0:
        return -contradiction / largest
    shared = share(W, slack, tight, S, size, L, Q, z, last, u)
    while True:
        if not shared:
            for a in range(m):
                u[a] = 0.0
            for i in range(size):
                u[S[i]] = part[i]
        residual = np.inf
        for _ in range(1 + _REFINEMENTS):
            residual = natural_residual(J, A, x, lower, lengths, u, largest, slack, w, table)
            if residual <= enough:
                break
            for i in range(size):
                correction[i] = -slack[S[i]]
            solve_lower(L, size, correction)
            solve_upper(L, size, correction)
            for i in range(size):
                u[S[i]] += correction[i]
        if residual <= max(enough, limit):
            for a in range(m):
                table[0, a] = max(table[0, a], 0.0)
            return residual
        if not shared:
            violation = least_violation(W, d, S, size, part)
            return -violation / largest if violation > 0.0 else np.inf
        shared = False


@kernel("void(f8[:,::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[:,::1])")
def newton_law(J: Array, v: Array, e: Array, opened: Array, lower: Array, rates: Array) -> None:
    """Write the least rates after an impact, -e J v and less for rows that stay open, and the rates before.

    Parameters
    ----------
    J, v : ndarray, shapes (m, nv), (nv,)
        Gradients, and the velocity before.
    e, lower : ndarray, shape (m,)
        Restitution of each row, and the least rates.
    opened : ndarray, shape (m,) or (0,)
        Speeds at which rows that are open may close, 0 of others.
    rates : ndarray, shape (4, m)
        Receives J v in its last row.
    """
    row_speeds(J, v, 1.0, rates[3])
    for a in range(len(J)):
        speed = rates[3, a]
        lower[a] = -e[a] * speed
        # what closes within the step by its own speed has its impact now
        if len(opened) and opened[a] > 0.0 and speed > -opened[a]:
            lower[a] = min(lower[a], -opened[a])


@kernel(
    "f8(f8[:,::1], i8[::1], f8[::1], f8[::1], f8[:,::1], f8[::1], f8[::1], f8[::1], f8, f8[::1], f8[:,::1])", apart=True
)
def law_of_rows(
    L: Array, parent: Array, x: Array, v: Array, J: Array, e: Array, opened: Array, last: Array, limit: float,
    w: Array, rates: Array,
) -> float:  # fmt: skip
    """Write the velocity after the impact law of `newton_law`, given the free motion x and the factor of M.

    `e`, `opened` and `rates` are those of `newton_law`, and the others, as the result, those of `solve_active_set`.
    """
    m, n = J.shape
    room = np.empty(m + 2 * m * n)
    lower, A, W = room[:m], room[m : m + m * n].reshape((m, n)), room[m + m * n :].reshape((m, n))
    solve(L, parent, J, W, A)
    newton_law(J, v, e, opened, lower, rates)
    return solve_active_set(J, A, W, x, lower, last, limit, w, rates)


@kernel(
    "f8(f8[:,::1], f8[::1], i8[::1], f8[::1], f8, f8[::1], f8[::1], b1, f8[:,::1], f8[::1], f8[::1], f8[::1], f8, "
    "f8[::1], f8[:,::1])"
)
def tree_law(
    mass: Array, damping: Array, parent: Array, v: Array, h: float, torque: Array, effects: Array, twice: bool,
    J: Array, e: Array, opened: Array, last: Array, limit: float, w: Array, rates: Array,
) -> float:  # fmt: skip
    """Write the velocity that `law_of_rows` gives for one mechanism in free motion; see `TreeFreeMotion`.

    The first arguments are those of `advance_by`, the others, as the result, those of `law_of_rows`; the result is inf
    too where M is not positive definite.
    """
    L, x = np.empty(mass.shape), np.empty(len(v))
    if advance_by(mass, damping, parent, v, h, torque, effects, twice, L[:0], L, np.empty((2, len(v))), x):
        return np.inf
    if factor_again(mass, damping, parent, twice, L):
        return np.inf
    return law_of_rows(L, parent, x, v, J, e, opened, last, limit, w, rates)

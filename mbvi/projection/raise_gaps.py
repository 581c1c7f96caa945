"""Kernels that raise gaps by the smallest displacement in the kinetic metric, where gaps are linear in it."""

from __future__ import annotations

import numpy as np

from ..compiled import kernel
from .metric import Array
from .robot_step import solve_active_set

# most linearisations of the constraints within a step
MOST_LINEARISATIONS = 20
# rows whose gap is below this part of the penetration take part in the projection
NEARBY = 0.1


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


@kernel("f8(f8[:,::1], f8[::1])")
def largest_bend(squares: Array, displacement: Array) -> float:
    """Return about the second-order part of a gap, as of `ClearanceCache.bend`; its squares, shape (families, nv)."""
    families, n = squares.shape
    most = 0.0
    for i in range(families):
        travel = angle = 0.0
        for k in range(n):
            square = displacement[k] * displacement[k]
            travel += squares[i, k] * square
            if squares[i, k] > 0.0:
                angle += square
        most = max(most, travel * angle)
    return np.sqrt(most)

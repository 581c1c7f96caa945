"""Solver for the sparse rows of many bodies: a working set, island by island, by projected conjugate gradients."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...errors import InfeasibleError
from ..acceptance import OF_MECHANISMS
from ..dense.dual_active_set import DualActiveSet
from ..dense.fused_step import MOST_FUSED, FusedStep
from ..dense.scaled_qp import Candidate, ScaledQP, WarmStart
from ..metric import Array, DiagonalMetric
from ..warm_start import LastPercussions
from .sparse_islands import _SMALL
from .working_set import solve_working_set

# islands are solved to this share of the tolerance: the check uses products with A, which round unlike those with G
_MARGIN = 0.9
# residual that small islands are solved to, relative to the largest speed
_ROUNDED = 1e-10
# most rows of an island that the dense solvers solve if it fails
_MOST_DENSE = 400
# how often violated rows join the working set until all rows do
_MOST_ENLARGED = 10
# how often all rows are solved again after some were refined, and to which part of the residual before
_ROUNDS, _FINER = 8, 0.3
# size of the working set relative to the violated and active rows; a set of at least this share of all rows is enlarged
# to all
_WORKING, _ALL = 1.5, 0.5


@dataclass(frozen=True)
class SparsePCG:
    """Accelerated sweeps, then projected conjugate gradients, on the sparse dual, for thousands of rows.

    A working set is solved: the violated rows, those active in the last projection, and the nearest others. Rows that
    the answer violates join it. Rows that share a body, directly or through other rows, form an island; islands have no
    body in common and are solved one by one. A small island is solved to rounding by the compiled dual active-set
    method. A large one keeps the last percussions if they still fit; otherwise accelerated sweeps of projected
    Gauss-Seidel start from them. Where these do not reach the residual, the Delassus matrix G = A' A of the island is
    formed: two rows have an entry only if they share a body. Conjugate gradients with an incomplete Cholesky factor
    then solve the equations of the active rows, cut off where a percussion would turn negative. An island whose
    residual stays too large, for instance because masses differ by many powers of ten, is solved by the dense solvers.
    Percussions of a large island are scaled so that they do no work beyond that of their bounds.

    Notes
    -----
    J. J. More and G. Toraldo, SIAM Journal on Optimization 1 (1991), 93-113, for conjugate gradients on faces.
    """

    def solve(self, qp: ScaledQP, start: WarmStart | None) -> Candidate | None:
        """Return percussions to the residual of the QP, as far as it is reached; see `Solver`."""
        m = len(qp.d)
        u = np.zeros(m) if start is None else start.u.copy()
        rounding = min(qp.tolerance, _ROUNDED * qp.largest)
        working, solved_densely = _working_set(qp.d, u), set[int]()
        label, enlarged = None, 0
        while True:
            if label is None:
                label = _solve_working_set(qp, working, u)
                is_small = np.bincount(label + 1)[label + 1] <= _SMALL
                allowed = np.where(is_small, rounding, qp.tolerance)
            z = qp.combine(u)
            slack = qp.slack(z)
            residual = np.abs(np.minimum(u, slack))
            violated = ~working & (slack < 0.0)
            if violated.any() and residual[violated].max() > allowed[label >= 0].max(initial=0.0):
                # each time the set is solved anew; rows that join one by one would take as many times as there are rows
                enlarged += 1
                working, label = working | violated | (enlarged > _MOST_ENLARGED), None
                continue
            failed = (residual > allowed) & (label >= 0)
            failed_islands = set(label[failed].tolist()) - solved_densely if failed.any() else None
            if not failed_islands:
                return Candidate(z, u, stationary=True)
            for island in failed_islands:
                _solve_densely(qp, np.flatnonzero(label == island), u)
            solved_densely |= failed_islands


def _working_set(d: Array, u: Array) -> Array:
    """Return the rows that may be active: the violated and the last active ones, and half as many with the next d."""
    working = (d > 0.0) | (u > 0.0)
    count = int(_WORKING * np.count_nonzero(working))
    if count >= _ALL * len(d):
        return np.ones(len(d), bool)
    return working | (d >= np.partition(d, len(d) - count)[len(d) - count])


def _solve_working_set(qp: ScaledQP, working: Array, u: Array) -> Array:
    """Solve for the working set; return the island of each row, -1 of others and of rows that repeat another."""
    label = np.empty(len(qp.d), np.int64)
    solve_working_set(*qp.parts, len(qp.x), qp.d, working, _MARGIN * qp.tolerance, label, u)
    return label


def refine(qp: ScaledQP, found: Candidate, rows: Array) -> Candidate:
    """Solve some rows of an answer to rounding, unless they are exact enough, while percussions of the others stay.

    The others then need not have the residual of the QP any more: all are solved to a smaller one, and the rows again,
    a few times at most.

    Parameters
    ----------
    qp : ScaledQP
        The problem.
    found : Candidate
        Its solution to the residual of the QP.
    rows : ndarray of int, shape (k,)
        The rows.
    """
    asked, off = qp.relative_tolerance, np.abs(np.minimum(found.u, qp.slack(found.z)))
    if off[rows].max() <= OF_MECHANISMS * np.abs(qp.d[rows]).max():
        return found
    for _ in range(_ROUNDS):
        u = found.u.copy()
        _solve_densely(qp, rows, u)
        refined = Candidate(qp.combine(u), u, stationary=True)
        if qp.residual(refined) <= asked * qp.largest:
            qp.relative_tolerance = asked
            return refined
        qp.relative_tolerance *= _FINER
        better = SparsePCG().solve(qp, WarmStart(u))
        found = found if better is None else better
    qp.relative_tolerance = asked
    return found


def _solve_densely(qp: ScaledQP, rows: Array, u: Array) -> None:
    """Solve rows by the dense solvers, for the percussions of others; some use A and not G, which can lose digits."""
    if len(rows) > _MOST_DENSE:
        return
    part, others = qp.rows[rows], u.copy()
    others[rows] = 0.0
    touched = np.unique(part.indices)
    J = np.ascontiguousarray(part[:, touched].toarray())
    # others touch the same bodies only where the rows are not a whole island
    x, metric = qp.combine(others)[touched], DiagonalMetric(np.ones(len(touched)))
    last = LastPercussions()
    # the rows that are active in the approximate answer are a good guess
    last.percussion = u[rows]
    if len(rows) <= MOST_FUSED:
        try:
            exact = FusedStep(last, 0.1 * qp.relative_tolerance).project(x, metric, J, qp.d[rows])
        except InfeasibleError:
            # the residual of the whole problem says so
            return
        if exact is not None:
            u[rows] = exact.percussion
            return
    island = ScaledQP(x, metric, J, qp.d[rows], 0.1 * qp.relative_tolerance)
    found = DualActiveSet().solve(island, None)
    # otherwise the island keeps its percussions, and the residual of the whole problem decides
    if found is not None and island.residual(found) <= island.tolerance:
        u[rows] = island.result(found, 0.0).percussion

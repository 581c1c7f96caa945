"""Solver for the sparse rows of many bodies: a working set, island by island, by projected conjugate gradients."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .cascade import FEW, dense_solvers, first_good_enough
from .fused_step import FusedStep
from .gram import gram, islands
from .metric import Array, DiagonalMetric
from .scaled_qp import Candidate, ScaledQP, WarmStart
from .sparse_islands import _SMALL, _solve_islands
from .warm_start import LastPercussions

# unit rows with a product above this are the same
_SAME = 1.0 - 1e-13
# the share of the tolerance that an island is solved to: products with A and with G round differently
_MARGIN = 0.9
# the residual of a small island, relative to the largest speed
_ROUNDED = 1e-10
# rows up to which an island that fails is solved by the dense solvers
_MOST_DENSE = 400
# the part of the last percussions that a large island is started from where they no longer fit: all of them would keep
# percussions that balance each other among dependent rows and grow from step to step
_CARRIED = 0.8
# entries of the Delassus matrix a row that there is room for at first
_ROOM = 128
# size of the working set relative to the violated and active rows, and the share of all rows from which on it is all
_WORKING, _ALL = 1.5, 0.5


@dataclass(frozen=True)
class SparsePCG:
    """Projected preconditioned conjugate gradients on the sparse dual, for thousands of rows.

    G = A' A is sparse: two rows meet only where they share a body. A working set of the violated rows, those active in
    the last projection and the nearest others is solved; rows that the answer violates join it. Rows that share no
    body, directly or through others, form islands, which are solved one by one. A small island is solved to rounding by
    the compiled dual active-set method. A large one keeps the last percussions if they still fit; otherwise sweeps of
    projected Gauss-Seidel find its active rows, and conjugate gradients with an incomplete Cholesky factor solve the
    equations of these, cut off where a percussion would turn negative. An island that misses the residual, as where
    masses differ by many powers of ten, is solved by the dense solvers.

    Notes
    -----
    J. J. More and G. Toraldo, SIAM Journal on Optimization 1 (1991), 93-113, for conjugate gradients on faces.
    """

    def solve(self, qp: ScaledQP, start: WarmStart | None) -> Candidate | None:
        """Return percussions to the residual of the QP, as far as it is reached; see `Solver`."""
        m = len(qp.d)
        u = np.zeros(m) if start is None else start.u.copy()
        carried = 1.0 if start is not None and start.same_velocity else _CARRIED
        small = min(qp.tolerance, _ROUNDED * qp.largest)
        working, tried = _working_set(qp.d, u), set[int]()
        label = None
        while True:
            if label is None:
                label = _solve_working_set(qp, working, carried, u)
                carried = 1.0
                few = np.bincount(label + 1)[label + 1] <= _SMALL
                enough = np.where(few, small, qp.tolerance)
            z = qp.combine(u)
            slack = qp.slack(z)
            off = np.abs(np.minimum(u, slack))
            violated = ~working & (slack < 0.0)
            if violated.any() and off[violated].max() > enough[label >= 0].max(initial=0.0):
                working, label = working | violated, None
                continue
            failed = (off > enough) & (label >= 0)
            bad = set(label[failed].tolist()) - tried if failed.any() else None
            if not bad:
                return Candidate(z, u, stationary=True)
            for island in bad:
                _solve_densely(qp, np.flatnonzero(label == island), u)
            tried |= bad


def _working_set(d: Array, u: Array) -> Array:
    """Return the rows that may be active: the violated and the last active ones, and half as many that come next."""
    working = (d > 0.0) | (u > 0.0)
    count = int(_WORKING * np.count_nonzero(working))
    if count >= _ALL * len(d):
        return np.ones(len(d), bool)
    return working | (d >= np.partition(d, len(d) - count)[len(d) - count])


def _solve_working_set(qp: ScaledQP, working: Array, carried: float, u: Array) -> Array:
    """Solve for the working set; return the island of each row, -1 of others and of rows that repeat another."""
    here = np.flatnonzero(working)
    data, columns, starts = qp.rows.data, qp.rows.indices.astype(np.uint32), qp.rows.indptr.astype(np.uint32)
    n, d = len(qp.x), qp.d[here]
    if len(here) < len(qp.d):
        sizes = np.diff(starts)
        entries = np.repeat(working, sizes)
        data, columns = data[entries], columns[entries]
        starts = np.concatenate([[0], np.cumsum(sizes[here])]).astype(np.uint32)
    rows, others, G = _gram(data, columns, starts, n)
    kept, part = ~_repeated(rows, others, G, d), u[here]
    label, within = np.full(len(qp.d), -1), np.empty(len(here), np.int64)
    count = islands(columns, starts, n, kept, within)
    target = _MARGIN * qp.tolerance
    _solve_islands(rows, others, G, d, within, count, target, carried, part)
    u[:] = 0.0
    u[here], label[here] = part, within
    return label


def _solve_densely(qp: ScaledQP, rows: Array, u: Array) -> None:
    """Solve one island by the dense solvers, which do not form G alone: it may have lost the digits that count."""
    if len(rows) > _MOST_DENSE:
        return
    part = qp.rows[rows]
    touched = np.unique(part.indices)
    J = np.ascontiguousarray(part[:, touched].toarray())
    x, metric = np.zeros(len(touched)), DiagonalMetric(np.ones(len(touched)))
    last = LastPercussions()
    # the rows that are active in the approximate answer are a good guess
    last.percussion = u[rows]
    if len(rows) <= FEW:
        exact = FusedStep(last).project(x, metric, J, qp.d[rows])
        if exact is not None:
            u[rows] = exact.percussion
            return
    island = ScaledQP(x, metric, J, qp.d[rows], 0.1 * qp.relative_tolerance)
    found, residual = first_good_enough(island, dense_solvers(len(rows)), last.start(island, None))
    # one that fails is judged with all others
    if found is not None and residual <= island.tolerance:
        u[rows] = island.result(found, residual).percussion


def _gram(data: Array, columns: Array, starts: Array, n: int) -> tuple[Array, Array, Array]:
    """Return the Delassus matrix row after row: starts, columns, values."""
    m = len(starts) - 1
    rows, room = np.empty(m + 1, np.uint32), min(m, _ROOM) * m
    while True:
        # what is not written to takes no memory
        others, G = np.empty(room, np.uint32), np.empty(room)
        count = gram(data, columns, starts, n, rows, others, G)
        if count <= room:
            return rows, others[:count], G[:count]
        room = count


def _repeated(starts: Array, columns: Array, G: Array, d: Array) -> Array:
    """Return which rows equal another that demands as much or more, shape (m,)."""
    repeated, same = np.zeros(len(d), bool), np.flatnonzero(G >= _SAME)
    if len(same) == len(d):
        # each equals itself only
        return repeated
    a, b = np.searchsorted(starts, same, "right") - 1, columns[same].astype(np.int64)
    other = a != b
    a, b = a[other], b[other]
    repeated[a[(d[b] > d[a]) | ((d[b] == d[a]) & (b < a))]] = True
    return repeated

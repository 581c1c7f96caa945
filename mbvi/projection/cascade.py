"""The order in which solvers are tried, and the choice of the first answer that is good enough."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from .active_set import GuessedSet
from .dual_active_set import DualActiveSet
from .fused_step import FEW
from .proxqp import RefinedProxQP
from .scaled_qp import ROUNDING, Candidate, ScaledQP, Solver, WarmStart

# rows up to which the solvers are tried that form G = A' A: their work grows with the cube of the rows
MOST_CUBIC = 500


def dense_solvers(rows: int) -> Iterable[Solver]:
    """Return the solvers for dense rows that the fused step left, the cheapest first and the most robust last."""
    if rows <= MOST_CUBIC:
        yield GuessedSet()
        yield RefinedProxQP()
    yield DualActiveSet()


def good_enough(qp: ScaledQP, candidate: Candidate) -> float:
    """Return the residual at which no further solver is tried.

    It is stricter than `qp.tolerance`, which the best answer of all solvers must meet.
    """
    if len(qp.d) > FEW:
        return 1e-3 * qp.relative_tolerance
    # rounding grows with z; but a huge z may be wrong, so that the bound grows to a thousandfold only
    return ROUNDING * min(1.0 + float(np.abs(candidate.z).max()), 1e3)


def first_good_enough(
    qp: ScaledQP, solvers: Iterable[Solver], start: WarmStart | None
) -> tuple[Candidate | None, float]:
    """Try solvers in order until one is good enough; return the best answer of those tried, and its residual."""
    best, smallest = None, np.inf
    for solver in solvers:
        candidate = solver.solve(qp, start)
        if candidate is None:
            continue
        residual = qp.residual(candidate)
        if residual < smallest:
            best, smallest = candidate, residual
        if residual <= good_enough(qp, candidate):
            break
    return best, smallest

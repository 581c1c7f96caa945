"""The order in which solvers are tried, and the choice of the first answer that is good enough."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from .active_set import GuessedSet
from .dual_active_set import DualActiveSet
from .nonnegative_least_squares import NonnegativeLeastSquares
from .proxqp import RefinedProxQP
from .scaled_qp import ROUNDING, Candidate, ScaledQP, Solver, WarmStart

# up to so many rows an answer must be at rounding to end the search; beyond, a thousandth of the allowed residual does
FEW = 32
# up to so many rows nonnegative least squares, a compiled dual active-set method, is faster than ProxQP
_MOST_NONNEGATIVE = 64


def dense_solvers(rows: int) -> Iterable[Solver]:
    """Return the solvers for so many dense rows, the cheapest first and the most robust last."""
    yield GuessedSet()
    if rows <= _MOST_NONNEGATIVE:
        yield NonnegativeLeastSquares()
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

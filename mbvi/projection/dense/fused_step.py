"""The first solver that is tried: a projection on dense rows, or a whole step of one mechanism, in one kernel."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...compiled import plain_array
from ...errors import InfeasibleError
from ..free_motion import FreeMotion
from ..metric import Array, Metric
from ..tree import TreeFreeMotion, TreeMetric, solve
from ..warm_start import LastPercussions
from .robot_step import ROUNDING, newton_law, solve_active_set, tree_law
from .scaled_qp import Projection

# up to so many rows an answer must be at rounding to end the search; beyond, a thousandth of the allowed residual does
FEW = 32
# most rows of the fused step
MOST_FUSED = 1000


class FusedStep:
    """Mass matrix factor, free motion, active set, percussions and residual in one compiled function.

    With a few rows, the overhead of numpy calls exceeds the time of the projection itself; one compiled call avoids it.
    A dual active-set method starts from the violated rows, or else from the rows active in the last projection. Where
    these depend on each other or have a negative percussion, it starts from none. If tight rows depend on each other,
    they share their percussions. If the KKT residual of the answer is too large, the caller solves by
    `DualActiveSet`.

    Parameters
    ----------
    last : LastPercussions
        Percussions of the last projection; updated by each answer.
    residual : float
        The relative KKT residual that is allowed.

    Raises
    ------
    InfeasibleError
        If rows contradict each other by more than this.
    """

    __slots__ = ("_last", "_residual")

    def __init__(self, last: LastPercussions, residual: float) -> None:
        self._last, self._residual = last, residual

    def project(self, x: Array, metric: Metric, J: Array, lower: Array) -> Projection | None:
        """Return the projection, or None if its residual is too large; see `mbvi.project`."""
        x, J, lower = plain_array(x), plain_array(J), plain_array(lower)
        velocity, rates = np.empty(len(x)), np.empty((3, len(lower)))
        found = self._solve(x, metric, J, lower, velocity, rates)
        if self._refused(found):
            if not self._met(found, x, metric, J, lower):
                return None
            velocity[:], rates[0], found = x, 0.0, 0.0
        self._last.keep(rates[0], None)
        return Projection(velocity, rates[0], found)

    def law(
        self, v: Array, motion: TreeFreeMotion | FreeMotion, J: Array, e: Array, opened: Array
    ) -> tuple[Array, Array, float] | None:
        """Return the same as `Projector.law`, or None if the residual is too large."""
        velocity, rates, last, lower = np.empty(len(v)), np.empty((4, len(e))), self._last, np.empty(len(e))
        if type(motion) is TreeFreeMotion:
            limit = self._limit(len(e))
            found = tree_law(*motion.kernel_arguments, J, e, opened, last.percussion, limit, velocity, rates)
        else:
            newton_law(J, plain_array(v), e, opened, lower, rates)
            found = self._solve(plain_array(motion.free), motion.metric, J, lower, velocity, rates)
        if self._refused(found):
            newton_law(J, plain_array(v), e, opened, lower, rates)
            if not self._met(found, motion.free, motion.metric, J, lower):
                return None
            velocity[:], rates[0], rates[1:3], found = motion.free, 0.0, J @ motion.free, 0.0
        last.keep(rates[0], None)
        return velocity, rates, found

    def _solve(self, x: Array, metric: Metric, J: Array, lower: Array, velocity: Array, rates: Array) -> float:
        A, W = _solved(metric, J)
        return solve_active_set(J, A, W, x, lower, self._last.percussion, self._limit(len(lower)), velocity, rates)

    def _limit(self, rows: int) -> float:
        return 0.0 if rows <= FEW else 1e-3 * self._residual

    @staticmethod
    def _refused(found: float) -> bool:
        # written so that a NaN is refused too
        return not 0.0 <= found < np.inf

    def _met(self, found: float, x: Array, metric: Metric, J: Array, lower: Array) -> bool:
        """Return whether rows that contradict each other are met by x to within its own rounding."""
        if not found < -self._residual:
            return False
        M = metric.dense()
        # equalities may leave of the terms of J x far less than the rounding of x
        lengths = np.linalg.norm(np.linalg.solve(np.linalg.cholesky(M), J.T), axis=0)
        if (lower - J @ x > ROUNDING * np.sqrt(x @ M @ x) * lengths).any():
            raise contradiction({"x": x, "M": M, "J": J, "lower": lower})
        return True


def _solved(metric: Metric, J: Array) -> tuple[Array, Array]:
    """Return M^-1 times each row of J, and each row whitened, shapes (m, nv)."""
    if type(metric) is TreeMetric:
        A, W = np.empty(J.shape), np.empty(J.shape)
        solve(metric.lower, metric.parent, J, W, A)
        return A, W
    W = plain_array(metric.whiten(J.T).T)
    return plain_array(metric.unwhiten(W.T).T), W


def contradiction(problem: dict[str, Any]) -> InfeasibleError:
    """Return the error of rows that no velocity meets."""
    return InfeasibleError("no velocity w meets J w >= lower: two or more rows contradict each other", problem)

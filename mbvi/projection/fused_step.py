"""The first solver that is tried: a projection on dense rows, or a whole step of one mechanism, in one kernel."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..compiled import plain_array
from ..errors import InfeasibleError
from .closed_contacts import find_sunk
from .free_motion import FreeMotion
from .metric import Array, Metric
from .raise_gaps import largest_travel
from .robot_step import newton_law, solve_active_set, tree_law
from .scaled_qp import Projection
from .settle_positions import PROJECTED, UNDECIDED, settle_positions
from .tree import TreeFreeMotion, TreeMetric, solve
from .warm_start import LastPercussions

# up to so many rows an answer must be at rounding to end the search; beyond, a thousandth of the allowed residual does
FEW = 32
# most rows of the fused step
MOST_FUSED = 1000


class LinearGaps(NamedTuple):
    """Rows whose gaps are linear near a configuration, with the velocities and lengths of a step.

    Attributes
    ----------
    number, point, jacobian, gap, lever, e, opened
        Of each row its constraint, contact point, gradient, gap, the factor that makes a length of it, restitution, and
        the speed at which it may close in the law if it is open there.
    law_jacobian : ndarray, shape (m, nv)
        Gradients where the law acts.
    squares : ndarray, shape (families, nv)
        As of `ClearanceCache.travel`.
    v : ndarray, shape (nv,)
        The velocity before the law.
    h, drift : float
        Length of the step, and the time from the law to its end [s].
    tolerance : float
        Activation tolerance [m].
    reach, margin : float
        Travel up to which gaps are linear, and how far beyond the tolerance the rows are known [m].
    free : ndarray of bool, shape (nv,)
        Which velocities are those of free bodies.
    """

    number: Array
    point: Array
    jacobian: Array
    law_jacobian: Array
    gap: Array
    lever: Array
    e: Array
    opened: Array
    squares: Array
    v: Array
    h: float
    drift: float
    tolerance: float
    reach: float
    margin: float
    free: Array


class Settled(NamedTuple):
    """What `FusedStep.settle` returns, of all rows of a `LinearGaps`.

    Attributes
    ----------
    gap, e : ndarray, shape (m,)
        Gaps at the end of the step, and restitution; that of closed contacts that were raised is 0.
    law, near : ndarray of bool, shape (m,)
        The rows of the law, and those of the position projection.
    rates : ndarray, shape (4, m)
        Of the law's rows; as of `Step`.
    w, tangent : ndarray, shape (nv,)
        The velocity after the law, and that after the position projection.
    moved : ndarray, shape (nv,), or None
        The displacement that removes penetration; None if there is none to remove.
    residual : float
        The relative KKT residual; -1 where nothing was projected.
    """

    gap: Array
    e: Array
    law: Array
    near: Array
    rates: Array
    w: Array
    tangent: Array
    moved: Array | None
    residual: float


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
            self._check(found, x, metric, J, lower)
            return None
        self._last.percussion, self._last.keys = rates[0], None
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
            self._check(found, motion.free, motion.metric, J, lower)
            return None
        last.percussion, last.keys = rates[0], None
        return velocity, rates, found

    def settle(
        self, motion: TreeFreeMotion | FreeMotion, gaps: LinearGaps, w: Array, displacement: Array, law: Array,
        rates: Array,
    ) -> Settled | None:  # fmt: skip
        """Project closed contacts out of penetration, or return None if that takes more; see `settle_positions`.

        Parameters
        ----------
        motion
            The free motion.
        gaps : LinearGaps
            The rows; not changed.
        w : ndarray, shape (nv,)
            The velocity after the law.
        displacement : ndarray, shape (nv,)
            From where the gaps are known to the end of the step.
        law : ndarray of bool, shape (m,)
            The rows of the law.
        rates : ndarray, shape (4, number of rows of the law)
            Their percussions and rates.
        """
        J, v, m = plain_array(gaps.jacobian), plain_array(gaps.v), len(gaps.gap)
        w, law, near, gap, e = w.copy(), law.copy(), np.zeros(m, bool), gaps.gap.copy(), gaps.e.copy()
        moved, tangent, known, end = np.empty(len(w)), np.empty(len(w)), np.zeros((4, m)), np.empty(m)
        known[:, law] = rates
        if largest_travel(gaps.squares, displacement) > gaps.reach:
            return None
        depth = find_sunk(
            gaps.number, gaps.point, J, gap, gaps.lever, e, v, w, displacement, law, known, gaps.h, gaps.drift,
            gaps.tolerance, np.empty(m, bool), end, np.empty(m), near,
        )  # fmt: skip
        if depth == 0.0:
            return Settled(end, e, law, near, known, w, w, None, -1.0)
        if depth < 0.0:
            return None
        law_rows = plain_array(gaps.law_jacobian)
        code, residual = settle_positions(
            gaps.number, gaps.point, J, *_solved(motion.metric, J), law_rows, *_solved(motion.metric, law_rows), gap,
            gaps.lever, e, gaps.opened, gaps.squares, plain_array(motion.free), v, w, displacement, law, near, known,
            moved, tangent, gaps.free, gaps.h, gaps.drift, gaps.tolerance, gaps.reach, gaps.margin, self._limit(m),
        )  # fmt: skip
        if code == UNDECIDED:
            return None
        if residual >= 0.0:
            self._last.percussion, self._last.keys = known[0, law], None
        return Settled(gap, e, law, near, known, w, tangent, moved if code == PROJECTED else None, residual)

    def _solve(self, x: Array, metric: Metric, J: Array, lower: Array, velocity: Array, rates: Array) -> float:
        A, W = _solved(metric, J)
        return solve_active_set(J, A, W, x, lower, self._last.percussion, self._limit(len(lower)), velocity, rates)

    def _limit(self, rows: int) -> float:
        return 0.0 if rows <= FEW else 1e-3 * self._residual

    @staticmethod
    def _refused(found: float) -> bool:
        # written so that a NaN is refused too
        return not 0.0 <= found < np.inf

    def _check(self, found: float, x: Array, metric: Metric, J: Array, lower: Array) -> None:
        if found < -self._residual:
            raise contradiction({"x": x, "M": metric.dense(), "J": J, "lower": lower})


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

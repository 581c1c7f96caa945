"""First stage of the cascade: the step of one mechanism, or of a few dense rows, in one compiled call."""

from __future__ import annotations

import numpy as np

from ..compiled import plain_array
from .free_motion import FreeMotion
from .metric import Array, Metric
from .robot_step import newton_law, solve_active_set, tree_law
from .scaled_qp import Projection
from .tree import TreeFreeMotion
from .warm_start import LastPercussions


class FusedStep:
    """Mass matrix factor, free motion, Delassus matrix, active set and residual in one compiled function.

    A robot with a few rows spends more time between numpy calls than on its projection, so that one call takes the
    place of all. The method is that of an active set: the violated rows, then those active in the last projection, then
    the set that a dual active-set method on G finds. Each is solved for its equations, refined twice, and judged by its
    own KKT residual. No answer is given unless that is at rounding: then the solvers that follow in the cascade are
    tried.

    Parameters
    ----------
    last : LastPercussions
        Where the percussions are read and kept.
    """

    __slots__ = ("_last",)

    def __init__(self, last: LastPercussions) -> None:
        self._last = last

    def project(self, x: Array, metric: Metric, J: Array, lower: Array) -> Projection | None:
        """Return the projection, or None if it is not at rounding; see `mbvi.project`."""
        x, J, lower = plain_array(x), plain_array(J), plain_array(lower)
        velocity, rates, last = np.empty(len(x)), np.empty((3, len(lower))), self._last
        A = plain_array(metric.solve_rows(J))
        residual = solve_active_set(J, A, x, lower, last.percussion, velocity, rates)
        if not residual < np.inf:
            return None
        last.percussion, last.keys = rates[0], None
        return Projection(velocity, last.percussion, residual)

    def law(
        self, v: Array, motion: TreeFreeMotion | FreeMotion, J: Array, e: Array
    ) -> tuple[Array, Array, float] | None:
        """Return what `Projector.law` does, or None if it is not at rounding."""
        velocity, rates, last = np.empty(len(v)), np.empty((4, len(e))), self._last
        if type(motion) is TreeFreeMotion:
            residual = tree_law(*motion.kernel_arguments, J, e, last.percussion, velocity, rates)
        else:
            A = plain_array(motion.metric.solve_rows(J))
            lower = np.empty(len(e))
            newton_law(J, plain_array(v), e, lower, rates)
            residual = solve_active_set(J, A, plain_array(motion.free), lower, last.percussion, velocity, rates)
        if not residual < np.inf:
            return None
        last.percussion, last.keys = rates[0], None
        return velocity, rates, residual

"""The first solver that is tried: a projection on a few dense rows, or a whole step of one mechanism, in one kernel."""

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

    With a few rows, the overhead of numpy calls exceeds the time of the projection itself; one compiled call avoids it.
    Three active sets are tried: the violated rows, the rows active in the last projection, and the set that a dual
    active-set method on G finds. The equations of each set are solved and refined. The first answer whose KKT residual
    is at rounding is returned. If there is none, the caller tries the solvers of the cascade.

    Parameters
    ----------
    last : LastPercussions
        Percussions of the last projection; updated by each answer.
    """

    __slots__ = ("_last",)

    def __init__(self, last: LastPercussions) -> None:
        self._last = last

    def project(self, x: Array, metric: Metric, J: Array, lower: Array) -> Projection | None:
        """Return the projection, or None if its residual is not at rounding; see `mbvi.project`."""
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
        """Return the same as `Projector.law`, or None if the residual is not at rounding."""
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

"""A scheme that looks ahead: half a drift, the law for what would close by the end, half a drift."""

from __future__ import annotations

import numpy as np

from ..arguments import boolean
from ..constraints import Rows
from ..constraints.rows import chosen, owners, stacked
from ..problem import Problem
from ..projection import Projector
from ..system.system import Array
from .position_projection import Applied, settled
from .scheme import Scheme, Timing
from .step import Step, advance_gaps, law

_NONE = np.zeros((4, 0))


class Centered(Scheme):
    """Drift by h v_i / 2, the law there for all that v_i would close within the step, drift by h v_{i+1} / 2.

    q_m = q_i + h v_i / 2; v_{i+1} = argmin |w - v_i - h M^-1 g|_M subject to J w >= -e J v_i, with M, g and J at q_m,
    the rows those of the constraints with f_a(q_i + h v_i) <= 0; q_{i+1} = q_m + h v_{i+1} / 2, drifts along the
    retraction. Forces that change with v are those half a step on, at v_i + h M^-1 g / 2; of a control, those at v_i.

    Parameters
    ----------
    project_positions : bool
        Lift closed contacts out of each other after the step. Off as in every scheme: it costs more detections.

    Notes
    -----
    Order 1 across impacts, 2 in flight (1 with a control). Velocity level; any e in [0, 1], one
    per constraint; several constraints at once by one projection. An impact is taken up to half a step before or after
    it is due, so that its penetration, or the gap it leaves at e = 0, is at most h |v-| / 2; on concave walls it adds
    up unless positions are projected. A step takes M once and g once or, where it changes
    with v, twice; in free flight the gaps once; where something is
    active the gaps twice, ahead and in the middle, and the gradients once more than they are used.
    """

    timing = Timing(jump=0.5)

    def __init__(self, *, project_positions: bool = False) -> None:
        self.project_positions = boolean(project_positions, "project_positions")

    def step(self, problem: Problem, t: float, q: Array, v: Array, h: float, projector: Projector) -> Step:
        """Return the state at t + h; see `Scheme`."""
        system, end, half = problem.system, t + h, 0.5 * h
        ahead = problem.constraints.active(end, system.integrate(q, h * v), problem.tolerance)
        t, middle = t + half, system.integrate(q, half * v)
        at = 0.5 * (v + system.free_velocity(t, middle, v, h)) if system.velocity_dependent else v
        if not ahead.gap.size:
            w = system.free_velocity(t, middle, at, h)
            w = w if at is v else v + (w - at)
            return Step(end, system.integrate(middle, half * w), w, ahead, _NONE, 0.0)
        applied = Applied(t, middle, v, h, at)
        active = _in_the_middle(problem, t, middle, ahead, half * ahead.speeds(v))
        w, rates, residual = law(projector, v, applied.free_motion(system), active)
        step = Step(end, system.integrate(middle, half * w), w, active, rates, residual)
        return settled(problem, applied, step, projector) if self.project_positions else advance_gaps(step, half)


def _in_the_middle(problem: Problem, t: float, q: Array, ahead: Rows, approach: Array) -> Rows:
    """Return the rows at q of the constraints that are active ahead, of each contact the nearest point to its own.

    Parameters
    ----------
    t, q
        Time and configuration in the middle of the step.
    ahead : Rows
        The active rows at its end.
    approach : ndarray, shape (k,)
        By how much they will have risen since [m or rad].
    """
    # twice what they need, for the gradients change on the way
    reach = problem.tolerance + 2.0 * float((np.abs(ahead.gap) + np.abs(approach)).max())
    here = problem.constraints.active(t, q, reach)
    owner = owners(ahead, here)
    found = chosen(here, np.unique(owner[owner >= 0]))
    # what lies farther back than a straight way tells keeps the gradient it will have
    lost = owner < 0
    return stacked([found, chosen(ahead, lost)]) if lost.any() else found

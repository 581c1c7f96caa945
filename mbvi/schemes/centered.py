"""The centered scheme: half a drift, the law for all contacts that would close within the step, half a drift."""

from __future__ import annotations

import numpy as np

from ..arguments import boolean
from ..constraints import Rows
from ..constraints.rows import chosen, owners, stacked
from ..problem import Problem
from ..projection import Projector
from ..system.system import Array
from .position_projection import Applied, project_positions
from .scheme import Scheme, Timing
from .step import Step, advance_gaps, law

_NONE = np.zeros((4, 0))


class Centered(Scheme):
    """Drift by h v_i / 2, the law there for all contacts that v_i would close within the step, drift by h v_{i+1} / 2.

    q_m = q_i + h v_i / 2; v_{i+1} = argmin |w - v_i - h M^-1 g|_M subject to J w >= -e J v_i, with M, g and J at q_m,
    the rows those of the constraints with f_a(q_i + h v_i) <= 0; q_{i+1} = q_m + h v_{i+1} / 2. Both drifts follow the
    retraction. Forces that change with v are evaluated half a step later, at v_i + h M^-1 g / 2; controls at v_i.

    Parameters
    ----------
    project_positions : bool
        Project closed contacts out of penetration after the step. Off by default: it costs more contact detections.

    Notes
    -----
    Order 1 across impacts, 2 in flight (1 with a control). Velocity level; any e in [0, 1], one per constraint; several
    constraints at once by one projection. An impact happens up to half a step too early or too late. Its penetration,
    or the gap it leaves at e = 0, is therefore at most h |v-| / 2. On concave walls penetration adds up unless
    positions are projected. A step evaluates M once, and g once or, where g changes with v, twice. It evaluates the
    gaps once in free flight, and with active constraints twice, at the end and in the middle of the step.
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
        return (
            project_positions(problem, applied, step, projector) if self.project_positions else advance_gaps(step, half)
        )


def _in_the_middle(problem: Problem, t: float, q: Array, ahead: Rows, approach: Array) -> Rows:
    """Return the rows at q of the constraints that are active at the end, each at the nearest contact point.

    Parameters
    ----------
    t, q
        Time and configuration in the middle of the step.
    ahead : Rows
        The active rows at its end.
    approach : ndarray, shape (k,)
        By how much their gaps rise from the middle to the end [m or rad].
    """
    # twice the linear estimate, because the gradients change within the step
    reach = problem.tolerance + 2.0 * float((np.abs(ahead.gap) + np.abs(approach)).max())
    here = problem.constraints.active(t, q, reach)
    owner = owners(ahead, here)
    found = chosen(here, np.unique(owner[owner >= 0]))
    # rows that are not found in the middle keep the gradient they have at the end
    lost = owner < 0
    return stacked([found, chosen(ahead, lost)]) if lost.any() else found

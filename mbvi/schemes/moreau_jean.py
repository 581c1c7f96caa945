"""The time-stepping scheme of J. J. Moreau and M. Jean, with explicit forces."""

from __future__ import annotations

from typing import Any

from ..arguments import between, boolean
from ..constraints.rows import take
from ..problem import Problem
from ..projection import Projector
from ..system.system import Array
from .kernels.moreau_jean import moreau_jean_step
from .positions.closed_contacts import Applied
from .positions.nearby_rows import NearbyRows
from .positions.position_projection import project_positions
from .scheme import Scheme, Timing
from .step import NO_RATES, Step, advance_gaps, closing_speeds, joining, law, near_margins


class MoreauJean(Scheme):
    """Drift by (1 - theta) h v_i, the law on velocities there, drift by theta h v_{i+1}.

    q_m = q_i + (1 - theta) h v_i; v_{i+1} = argmin |w - v_i - h M^-1 g|_M subject to J w >= -e J v_i, with M, g and the
    constraints f_a <= 0 at q_m; q_{i+1} = q_m + theta h v_{i+1}, both drifts along the retraction, so that
    q_{i+1} = q_i + h ((1 - theta) v_i + theta v_{i+1}) in R^d.

    Parameters
    ----------
    theta : float
        In [0, 1]: 1/2 is Moreau's midpoint, 0 is `Paoli`.
    project_positions : bool
        Project closed contacts out of penetration after the step. Off by default, as in the published scheme.

    Raises
    ------
    InputError
        If theta is outside [0, 1].

    Notes
    -----
    Order 1 across impacts, 2 in flight with theta = 1/2 where forces do not depend on velocities. Velocity level;
    any e in [0, 1], one per constraint; several constraints at once by one projection. The penetration of an impact is
    up to max(theta, 1 - theta) h |v-|. Unless positions are projected it remains at e = 0 and adds up on concave walls.
    A step evaluates M, g, the gaps and the gradients of active constraints once, in free flight no gradients. Forces
    are explicit; Jean's own scheme evaluates them implicitly at theta.
    Moreau, Unilateral contact and dry friction in finite freedom dynamics (1988); Jean, The non-smooth contact dynamics
    method (1999).
    """

    def __init__(self, theta: float = 0.5, *, project_positions: bool = False) -> None:
        self.theta = between(theta, "theta", 0.0, 1.0)
        self.project_positions = boolean(project_positions, "project_positions")
        self.timing = Timing(jump=1.0 - self.theta)

    @property
    def step_kernel(self) -> Any:
        """The kernel of the step without position projection; see `Scheme`."""
        return None if self.project_positions else moreau_jean_step

    def step(self, problem: Problem, t: float, q: Array, v: Array, h: float, projector: Projector) -> Step:
        """Return the state at t + h; see `Scheme`."""
        system, end = problem.system, t + h
        before = self.timing.jump * h
        margins = near_margins(problem, self.project_positions, before * v, t, q, h)
        t += before
        middle = system.integrate(q, before * v)
        active = problem.constraints.active(t, middle, problem.tolerance + margins.largest.max())
        if self.project_positions:
            active = take(active, joining(problem, active, margins, before * active.speeds(v)))
        if not active.gap.size:
            w = system.free_velocity(t, middle, v, h)
            return Step(end, system.integrate(middle, self.theta * h * w), w, active, NO_RATES, 0.0)
        motion = system.free_motion(t, middle, v, h)
        opened = closing_speeds(problem, active, h) if self.project_positions else None
        w, rates, residual, slip, active = law(projector, v, motion, active, opened)
        step = Step(end, system.integrate(middle, self.theta * h * w), w, active, rates, residual, slip)
        if self.project_positions:
            applied = Applied(t, middle, v, h, motion, opened)
            return project_positions(problem, applied, step, projector, NearbyRows(problem, end, linear=False))
        return advance_gaps(step, self.theta * h)

"""The proximal-like scheme of L. Paoli, equations (10)-(11)."""

from __future__ import annotations

from typing import Any

from ..arguments import boolean
from ..constraints.rows import take
from ..problem import Problem
from ..projection import Projector
from ..system.system import Array
from .kernels.paoli import paoli_step
from .positions.closed_contacts import Applied
from .positions.nearby_rows import NearbyRows
from .positions.position_projection import project_positions
from .scheme import Scheme, Timing
from .step import NO_RATES, Step, closing_speeds, joining, law, near_margins


class Paoli(Scheme):
    """q_{i+1} = q_i + h v_i, then the law (8) at q_{i+1} on v_i + h M^-1 g.

    v_{i+1} = -e v_i + (1 + e) Proj_M(T_K(q_{i+1}), v_i + h / (1 + e) M^-1 g(t_{i+1}, q_{i+1}, v_i)), computed as
    argmin |w - v_i - h M^-1 g|_M subject to J w >= -e J v_i. Both are the same because T_K is a cone; the second form
    also allows one e per constraint.

    Parameters
    ----------
    project_positions : bool
        Project closed contacts out of penetration after the step. Off by default, as in the paper.

    Notes
    -----
    Order 1; velocity level; any e in [0, 1]; several constraints at once. A step evaluates M, g and the active
    gradients once, in free flight no gradients. A step may end up to h |v-| inside a constraint. This penetration
    remains where the velocity is then tangent to the constraint, unless positions are projected.
    """

    timing = Timing(jump=1.0)

    def __init__(self, *, project_positions: bool = False) -> None:
        self.project_positions = boolean(project_positions, "project_positions")

    @property
    def step_kernel(self) -> Any:
        """The kernel of the step without position projection; see `Scheme`."""
        return None if self.project_positions else paoli_step

    def step(self, problem: Problem, t: float, q: Array, v: Array, h: float, projector: Projector) -> Step:
        """Return the state at t + h; see `Scheme`."""
        system, drift, origin = problem.system, h * v, q
        margins = near_margins(problem, self.project_positions, drift, t, q, h)
        t, q = t + h, system.integrate(q, drift)
        active = problem.constraints.active(t, q, problem.tolerance + margins.largest.max(), origin, drift)
        if self.project_positions:
            active = take(active, joining(problem, active, margins, h * active.speeds(v)))
        if not active.gap.size:
            return Step(t, q, system.free_velocity(t, q, v, h), active, NO_RATES, 0.0)
        motion = system.free_motion(t, q, v, h)
        opened = closing_speeds(problem, active, h) if self.project_positions else None
        velocity, rates, residual, slip, active = law(projector, v, motion, active, opened)
        step = Step(t, q, velocity, active, rates, residual, slip)
        if not self.project_positions:
            return step
        applied = Applied(t, q, v, h, motion, opened)
        return project_positions(problem, applied, step, projector, NearbyRows(problem, t, linear=False))

"""The centered scheme: half a drift, the law for all contacts that would close within the step, half a drift."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..arguments import boolean
from ..constraints import Rows
from ..constraints.carried import Place, carried_along
from ..constraints.rows import concatenate, match_contacts, points_going_on, take
from ..problem import Problem
from ..projection import Projector, in_flight
from ..projection.positions.travel import largest_of_parts, largest_of_rows
from ..system.mechanisms.loop_margin import with_equalities
from ..system.system import Array
from .kernels.centered import centered_step
from .positions.closed_contacts import Applied
from .positions.least_displacement import independent_groups
from .positions.nearby_rows import NearbyRows
from .positions.position_projection import project_positions
from .scheme import Scheme, Timing
from .step import NO_RATES, Step, advance_gaps, closing_speeds, coasted, joining, law, near_margins
from .tangent_velocity import along_equalities, with_tangent_velocity


class Centered(Scheme):
    """Drift by h v_i / 2, the law there for all contacts that v_i would close within the step, drift by h v_{i+1} / 2.

    q_m = q_i + h v_i / 2; v_{i+1} = argmin |w - v_i - h M^-1 g|_M subject to J w >= -e J v_i, with M, g and J at q_m,
    the rows those of the constraints with f_a(q_i + h v_i) <= 0; q_{i+1} = q_m + h v_{i+1} / 2. Both drifts follow the
    retraction. Forces that change with v are evaluated half a step later, at v_i + h M^-1 g / 2; controls at v_i.
    Free bodies move as nothing acts on them in both drifts, which has their gyroscopic torques: the law holds for the
    velocities that v_i and v_{i+1} are in the middle, and both momenta in the world change by what acts there.
    Joint damping D takes part in the free velocity, which is the same in flight and in contact: with the other forces F
    and E(w) = w + (M + h D / 2)^-1 h (F - D w) / 2 it is x = 2 E^3(v_i) - E^4(v_i), without damping v_i + h M^-1 F.
    Dry friction of joints changes the damping of each by the ratio of its speeds E(v_i) with and without that friction.

    Parameters
    ----------
    project_positions : bool
        Project closed contacts out of penetration after the step, and make the velocity tangent to them there. Off by
        default.

    Notes
    -----
    Order 1 across impacts, 2 in flight (1 with a control). Velocity level; any e in [0, 1], one per constraint; several
    constraints at once by one projection. An impact happens up to half a step too early or too late. Its penetration,
    or the gap it leaves at e = 0, is therefore at most h |v-| / 2. On concave walls penetration adds up unless
    positions are projected. A step evaluates M once, and g once or, where g changes with v, twice. It evaluates the
    gaps once in free flight, and with active constraints twice, at the end and in the middle of the step. With
    projected positions it evaluates them once more only where bodies have moved too far for gaps to be linear.

    With projected positions a contact that is about to close joins the law with a bound of its own: open by a gap f, it
    may approach at 2 f / h, so that it lands at the end of the step. Its rate after the law is then below -e times that
    before, and its rebound follows in the next step.
    """

    timing = Timing(jump=0.5, coasts=True)

    def __init__(self, *, project_positions: bool = False) -> None:
        self.project_positions = boolean(project_positions, "project_positions")

    @property
    def step_kernel(self) -> Any:
        """The kernel of the step; see `Scheme`."""
        return centered_step

    def step(self, problem: Problem, t: float, q: Array, v: Array, h: float, projector: Projector) -> Step:
        """Return the state at t + h; see `Scheme`."""
        problem.system.share_closings(True)
        try:
            return self._step(problem, t, q, v, h, projector)
        finally:
            problem.system.share_closings(False)

    def _step(self, problem: Problem, t: float, q: Array, v: Array, h: float, projector: Projector) -> Step:
        system, end, half = problem.system, t + h, 0.5 * h
        nearby = NearbyRows(problem, end, linear=self.project_positions)
        ahead = self.rows_ahead(problem, nearby, q, v, h)
        displacement, v = system.coast(v, half)
        # from here on v is the velocity before the law
        t, middle = t + half, system.integrate(q, displacement)
        # the velocity at which forces are evaluated
        force_velocity = system.force_velocity(t, middle, v, half)
        motion = system.centered_motion(t, middle, v, h, force_velocity)
        if not ahead.gap.size:
            w = in_flight(motion)
            flown = coasted(system, Step(end, middle, w, ahead, NO_RATES, 0.0), half)
            return with_tangent_velocity(system, flown, motion)
        change = half * ahead.speeds(v)
        # a scheme derived from this one may have changed e
        along = carried_along(problem.constraints, ahead, Place(end, nearby.place), Place(t, middle))
        active = _rows_in_the_middle(problem, t, middle, along, change)
        active = active._replace(restitution=ahead.restitution)
        bouncing = opened = None
        if self.project_positions:
            bouncing = parts_that_bounce(problem, ahead, change)
            # gaps that lead to those of the end, which the position projection takes to be linear
            change = half * active.speeds(v)
            bounces = largest_of_parts(ahead.jacobian, problem.constraints.part, bouncing) > 0.0
            active = active._replace(gap=np.where(bounces, active.gap, ahead.gap - change))
            # one that closes until the end bounces, also if its gap is not linear; elsewhere rounding would decide
            elastic = bounces & (active.restitution >= 1.0)
            change = np.where(elastic, np.minimum(change, ahead.gap - active.gap), change)
            opened = closing_speeds(problem, active, half, change)
        across = None
        if with_equalities(system):
            motion, v, across = along_equalities(motion, v)
        w, rates, residual, slip, found = law(projector, v, motion, *self.rows_of_law(active, v, opened))
        w = w if across is None else w + across
        active = active._replace(restitution=found.restitution)
        step = Step(end, middle, w, active, rates, residual, slip)
        if not self.project_positions:
            return with_tangent_velocity(system, coasted(system, advance_gaps(step, half), half), motion)
        applied = Applied(t, middle, v, h, motion, opened, ahead, bouncing, across, coasts=True)
        step = step._replace(q=applied.end(system, w, half)[0])
        step = project_positions(problem, applied, step, projector, nearby)
        return with_tangent_velocity(system, step, motion)

    def rows_ahead(self, problem: Problem, nearby: NearbyRows, q: Array, v: Array, h: float) -> Rows:
        """Return the rows of the law of a step of length h: those that v would close within it, or nearly."""
        displacement, _ = problem.system.coast(v, h)
        margins = near_margins(problem, self.project_positions, displacement, nearby.t - h, q, h)
        ahead = nearby.at(problem.system.integrate(q, displacement), margins.largest)
        if self.project_positions and len(ahead.gap):
            ahead = nearby.only(joining(problem, ahead, margins, h * ahead.speeds(displacement / h)))
        return ahead

    def rows_of_law(self, rows: Rows, v: Array, opened: Array | None) -> tuple[Rows, Array | None]:
        """Return the rows of the law in the middle of a step, and how fast they may close: those given.

        v is the velocity before the law.
        """
        return rows, opened


def parts_that_bounce(problem: Problem, ahead: Rows, change: Array) -> Array:
    """Return 1 for each part that some row connects with one that may bounce, and 0 for others, shape (parts,).

    Their rows keep their gaps, which must be those of the middle. `change`, shape (k,), is as of `_rows_in_the_middle`.
    """
    rebound = -2.0 * ahead.restitution * change * problem.constraints.levers(ahead.constraint)
    bounces = (ahead.restitution > 0.0) & ((rebound > problem.tolerance) | (ahead.restitution >= 1.0))
    part = problem.constraints.part
    if not bounces.any():
        return np.zeros(part[-1] + 1)
    group = independent_groups(ahead.jacobian, part)
    return largest_of_rows(ahead.jacobian, part, np.isin(group, group[bounces]).astype(float))


def _rows_in_the_middle(problem: Problem, t: float, q: Array, ahead: Rows, change: Array) -> Rows:
    """Return the rows in the middle of a step that correspond to rows active at its end, in the same order.

    The law acts there: arms and axes of the end would turn its percussions.

    Parameters
    ----------
    t, q
        Time and configuration in the middle of the step.
    ahead : Rows
        The rows that are active at its end, with points that bodies have carried to the middle.
    change : ndarray, shape (k,)
        Change of their gaps from the middle to the end at the velocity before the step [m or rad].
    """
    # twice the linear estimate, because the gradients change within the step
    lengths = problem.constraints.levers(ahead.constraint) * (np.abs(ahead.gap) + np.abs(change))
    reach = problem.tolerance + 2.0 * float(lengths.max())
    here = problem.constraints.active(t, q, reach)
    owner = match_contacts(ahead, here)
    found = owner >= 0
    if found.all():
        return here if np.array_equal(owner, np.arange(len(here.gap))) else take(here, owner)
    # a contact without a counterpart in the middle is taken at the place where it is at the end, or where one that goes
    # on from it is, as before the joint of two tiles
    rest = take(ahead._replace(gap=ahead.gap - change), ~found)
    rest = problem.constraints.at_places(t, q, rest._replace(point=points_going_on(rest, here, owner, reach)))
    order = np.argsort(np.concatenate([np.flatnonzero(found), np.flatnonzero(~found)]))
    return take(concatenate([take(here, owner[found]), rest]), order)

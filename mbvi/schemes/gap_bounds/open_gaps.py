"""Velocities with which no gap is negative at the end of a step, with and without restitution."""

from __future__ import annotations

import numpy as np

from ...constraints import Rows
from ...constraints.rows import take
from ...errors import ProjectionError
from ...problem import Problem
from ...projection import FreeMotion, Projector, TreeFreeMotion, in_flight, without_friction
from ...system.system import Array
from ..row_projection import RowProjection, project_rows
from .newton_bounds import newton_bounds
from .reach import groups, largest_of_groups


def open_gaps(
    rows: Rows, h: float, projector: Projector, free_motion: FreeMotion | TreeFreeMotion, most: Array | float
) -> RowProjection:
    """Return the velocity with which no gap of the rows is negative after a step.

    Of each penetration at most `most` is removed, one for all or shape (k,) [m or rad].
    """
    if not rows.gap.size:
        return RowProjection(in_flight(free_motion), np.zeros(0), 0.0)
    lower = -np.maximum(rows.gap, -most) / h
    if rows.rate is not None:
        lower -= rows.rate
    return project_rows(projector, free_motion.free, free_motion.metric, rows, lower, h)


def displacing_velocity(
    problem: Problem, rows: Rows, h: float, projector: Projector, free_motion: FreeMotion | TreeFreeMotion
) -> tuple[RowProjection, bool]:
    """Return the velocity along which the configuration moves in a step, and whether it removes penetration.

    It does in those groups of rows where some penetration is more than the residual explains.
    """
    group = groups(problem, rows)
    deep = rows.gap < -_residual_depth(rows, h, projector, free_motion, group) - problem.tolerance
    if deep.any():
        sunk = largest_of_groups(deep, group) > 0.0
        try:
            return open_gaps(rows, h, projector, free_motion, np.where(sunk, np.inf, 0.0)), True
        except ProjectionError:
            # where contacts contradict each other penetration remains, and the run records it
            pass
    return open_gaps(rows, h, projector, free_motion, 0.0), False


def bouncing_velocities(
    problem: Problem,
    rows: Rows,
    v: Array,
    h: float,
    projector: Projector,
    free_motion: FreeMotion | TreeFreeMotion,
    allowed: float,
) -> tuple[RowProjection, RowProjection]:
    """Return the velocity along which the configuration moves, and the velocity after the step, where some e > 0.

    The first is the nearest to the second with which no gap is negative at the end. They differ where an impact lets a
    body approach another one within the step, deeper than `allowed` [m].
    """
    group = groups(problem, rows)
    bounds = newton_bounds(problem, rows, v, h, free_motion, group)
    lower, bound, percussion = bounds.lower, np.flatnonzero(~bounds.open), np.zeros(len(rows.gap))
    if rows.rate is not None:
        lower = lower - rows.rate
    found = project_rows(projector, free_motion.free, free_motion.metric, take(rows, bound), lower[bound], h)
    w, percussion[bound], residual, tangential = found
    if tangential is not None:
        wide = np.zeros((len(percussion), tangential.shape[1]))
        wide[bound] = tangential
        tangential = wide
    velocity, gap = RowProjection(w, percussion, residual, tangential), rows.gap + h * rows.speeds(w)
    left = np.maximum(allowed, _residual_depth(rows, h, projector, free_motion, group) + problem.tolerance)
    deep = gap < -left
    if not deep.any():
        return velocity, velocity
    # a projector of its own: its percussions are not those of the step
    moving = FreeMotion(w, without_friction(free_motion.metric))
    own = Projector(projector.residual, projector.solver, projector.accepted)
    # friction has acted in the first: the displacement is along the normals
    sunk = take(rows._replace(tangents=None), largest_of_groups(deep, group) > 0.0)
    return displacing_velocity(problem, sunk, h, own, moving)[0], velocity


def _residual_depth(
    rows: Rows, h: float, projector: Projector, free_motion: FreeMotion | TreeFreeMotion, group: Array
) -> Array | float:
    """Return the penetration that the residual of a projection may leave, that of each row or one for all [m].

    It is not removed, because that would cost a second projection in each step.
    """
    if projector.accepted is not None:
        return 0.5 * projector.accepted.depth
    speeds = largest_of_groups(np.abs(rows.speeds(free_motion.free)), group)
    return 2.0 * h * projector.residual * (speeds + largest_of_groups(np.abs(rows.gap), group) / h)

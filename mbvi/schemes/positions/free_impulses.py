"""Free bodies whose positions are projected: their percussions act where contacts are, and their momentum is kept."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from ...compiled import plain_array
from ...constraints import Rows
from ...problem import Problem
from ...projection import FreeMotion, TreeFreeMotion
from ...system.free.free_momentum import keep_momentum
from ...system.free.sparse_rows import sparse_parts
from ...system.system import Array
from ..step import Step


def with_gradients_at(problem: Problem, t: float, q: Array, rows: Rows) -> Rows:
    """Return rows found elsewhere with gradients at a configuration, where free bodies need all of them to be there."""
    if not len(problem.free_bodies.q):
        return rows
    return problem.constraints.at_places(t, q, rows)


def without_percussions(
    problem: Problem, motion: FreeMotion | TreeFreeMotion, step: Step, rows: Rows, owner: Array
) -> Array | None:
    """Return the free motion, of free bodies the velocity after the law less its percussions at the rows given.

    `owner`, shape (k,), are the rows of the law at the same contacts. None if there are no free bodies.
    """
    bodies, to_space = problem.free_bodies, problem.in_space
    if not len(bodies.q):
        return None
    impulse = rows.jacobian.T @ step.percussion[owner]
    if step.slip is not None and rows.tangents is not None:
        impulse = impulse + rows.tangents.jacobian.T @ step.slip[0][owner].ravel()
    start, free = step.v - motion.metric.solve_rows(impulse[None])[0], bodies.owner >= 0
    return np.where(free if to_space is None else abs(to_space).T @ free > 0.0, start, motion.free)


def with_momentum(problem: Problem, step: Step, place: Array, before: Array, w: Array) -> Step:
    """Return the step with velocities of free bodies that keep their momentum; see `keep_momentum`.

    Parameters
    ----------
    problem : Problem
        With the free bodies.
    step : Step
        The step after the position projection.
    place, before : ndarray, shape (nq,)
        The configuration of its gradients, and that before the projection.
    w : ndarray, shape (nv,)
        The velocity there.
    """
    bodies, to_space = problem.free_bodies, problem.in_space
    if not len(bodies.q):
        return step
    q, v, J = step.q.copy(), step.v.copy(), step.active.jacobian
    if to_space is not None:
        w, v, J = to_space @ w, to_space @ v, csr_array(J) @ to_space.T
    keep_momentum(bodies, *sparse_parts(J), plain_array(before), plain_array(w), plain_array(place), q, v)
    if to_space is not None:
        v = to_space.T @ v
    rates, slip = step.rates.copy(), step.slip
    rates[2] = step.active.speeds(v)
    if slip is not None and step.active.tangents is not None:
        slip = slip.copy()
        slip[2] = step.active.tangents.slip(v)
    return step._replace(q=q, v=v, rates=rates, slip=slip)

"""Free bodies whose positions are projected: their percussions act where contacts are, and their momentum is kept."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from ...compiled import kernel, plain_array
from ...constraints import Rows
from ...constraints.mechanism.tables import RowBuffer
from ...constraints.rows import concatenate, take
from ...constraints.tangents import along_axes
from ...problem import Problem
from ...projection import FreeMotion, TreeFreeMotion
from ...projection.tree import solve
from ...system.free.free_momentum import keep_momentum
from ...system.free.sparse_rows import sparse_parts
from ...system.system import Array
from ..kernels.records import MechanismStep
from ..step import Step


def _of_free_bodies(problem: Problem) -> Array:
    """Return which velocities move free bodies, shape (nv,)."""
    free, to_space = problem.free_bodies.owner >= 0, problem.in_space
    return np.asarray(free if to_space is None else abs(to_space).T @ free > 0.0)


def with_gradients_at(problem: Problem, t: float, q: Array, rows: Rows) -> Rows:
    """Return rows found elsewhere, those that act on free bodies with the gradients at a configuration."""
    acts = abs(rows.jacobian) @ _of_free_bodies(problem) > 0.0
    if not acts.any():
        return rows
    there = concatenate([problem.constraints.at_places(t, q, take(rows, acts)), take(rows, ~acts)])
    return take(there, np.argsort(np.argsort(~acts, kind="stable")))


@kernel("b1(MechanismStep, RowBuffer, i8)")
def acts_on_free_bodies(s: MechanismStep, rows: RowBuffer, a: int) -> bool:
    """Return whether row a acts on a free body."""
    for k in range(len(s.v)):
        if rows.J[a, k] != 0.0 and s.bodies.owner[k] >= 0:
            return True
    return False


def without_percussions(
    problem: Problem, motion: FreeMotion | TreeFreeMotion, step: Step, rows: Rows, owner: Array
) -> Array | None:
    """Return the free motion, of free bodies the velocity after the law less its percussions at the rows given.

    `owner`, shape (k,), are the rows of the law at the same contacts. None if there are no free bodies.
    """
    if not len(problem.free_bodies.q):
        return None
    impulse = rows.jacobian.T @ step.percussion[owner]
    before, tangents = step.active.tangents, rows.tangents
    if step.slip is not None and before is not None and tangents is not None:
        friction = along_axes(step.slip[0][owner], before.axes[owner], tangents.axes)
        impulse = impulse + tangents.jacobian.T @ friction.ravel()
    start = step.v - motion.metric.solve_rows(impulse[None])[0]
    return np.where(_of_free_bodies(problem), start, motion.free)


@kernel("void(MechanismStep, RowBuffer, i8[::1], f8[::1], f8[::1], f8[::1])")
def start_of_tangent_law(
    s: MechanismStep, there: RowBuffer, order: Array, slip: Array, turn: Array, start: Array
) -> None:  # fmt: skip
    """Write the free motion, of free bodies the velocity at the end less percussions of the law at rows as they are.

    What the percussions of the tangent velocity differ by from those of the law is then an impulse at these rows.
    `order`, shape (k,), says which row of the law each was; `slip` and `turn` are those of the law along the axes of
    these rows; `start` has shape (nv,). `s.v` is the velocity after the law, and `room.after` that at the end.
    """
    n = len(start)
    impulse, whitened, change = np.zeros((1, n)), np.empty((1, n)), np.zeros((1, n))
    if len(s.bodies.mass) > 0:
        for i in range(there.size[0]):
            a = order[i]
            for j in range(n):
                impulse[0, j] += s.rates[a] * there.J[i, j]
                for c in range(2 if len(there.T) > 0 else 0):
                    impulse[0, j] += slip[2 * i + c] * there.T[2 * i + c, j]
                for c in range(3 if len(there.R) > 0 else 0):
                    impulse[0, j] += turn[3 * i + c] * there.R[3 * i + c, j]
        solve(s.room.L, s.mechanism.parent, impulse, whitened, change)
    for j in range(n):
        # bodies that loops hold turn freely until the end of the step, too
        coasts = s.room.after[j] - s.v[j]
        start[j] = s.room.after[j] - change[0, j] if s.bodies.owner[j] >= 0 else s.room.free[j] + coasts


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

"""Contacts that are closed at the ends of steps: which they are, and how a state returns to them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.linalg import lstsq

from ...constraints import Rows
from ...constraints.rows import match_contacts, take
from ...problem import Problem
from ...projection import Metric
from ...system.free.sparse_rows import dense
from ...system.system import Array
from ..positions.corrections import wrenches
from .doubling import LARGEST
from .measure import Measure

# most linearisations of a return, and the gap at which it ends in activation tolerances
_MOST, _ENOUGH = 4, 0.1
# singular values of a Delassus matrix below this part of the largest are rounding
_DEPENDENT = 1e-10
# slip that has no direction [m/s]
_NO_SLIP = 1e-300


class Near(NamedTuple):
    """The rows at a state.

    Attributes
    ----------
    resting : Rows
        Closed contacts that neither close nor open.
    striking : bool
        Whether another closed contact closes: an impact.
    """

    resting: Rows
    striking: bool


def near_rows(problem: Problem, measure: Measure, t: float, q: Array, v: Array) -> Near:
    """Return the closed contacts at a state."""
    rows = problem.constraints.active(t, q, measure.gap)
    if not len(rows.gap):
        return Near(rows, False)
    speeds, rest = rows.speeds(v), measure.rest(rows.constraint, measure.size(v))
    return Near(take(rows, np.abs(speeds) <= rest), bool((speeds < -rest).any()))


class Returned(NamedTuple):
    """A state whose contacts are closed.

    Attributes
    ----------
    q, v : ndarray, shapes (nq,) and (nv,)
        The state, its velocity tangent to the contacts.
    metric : Metric
        M.
    normals, held : ndarray, shapes (k, nv) and (m, nv)
        Gradients of the contacts, and these followed by the tangents of those that stick.
    pushes : ndarray, shape (m, nv)
        Directions in which the contacts act: `held`, where a contact slips with its friction.
    wrench : ndarray, shape (k, 6)
        What the return of the velocity takes from each contact, as `Step.correction` [N s, N m s].
    """

    q: Array
    v: Array
    metric: Metric
    normals: Array
    held: Array
    pushes: Array
    wrench: Array

    def along(self, displacement: Array, change: Array) -> tuple[Array, Array]:
        """Return what a displacement and a change of velocity, both of shape (nv,), have along the contacts."""
        return (
            displacement - _least(self.metric, self.normals, self.normals, self.normals @ displacement),
            change - _least(self.metric, self.held, self.pushes, self.held @ change),
        )


def returned(
    problem: Problem, t: float, q: Array, v: Array, closed: Rows, sticks: Array, reach: float
) -> Returned | None:
    """Return the nearest state in the kinetic metric at which contacts are closed and velocities tangent to them.

    Parameters
    ----------
    t, q, v
        The state before.
    closed : Rows
        The contacts, as they are somewhere near.
    sticks : ndarray of bool, shape (k,)
        Which of them have no velocity along their tangents either.
    reach : float
        Gap up to which they are looked for [m].

    Returns
    -------
    Returned or None
        The state; None if a contact is not found, they contradict each other, or there are none or too many.
    """
    system, constraints, count = problem.system, problem.constraints, len(closed.gap)
    if not 0 < count <= LARGEST:
        return None
    for attempt in range(_MOST):
        near = constraints.active(t, q, reach)
        owner = match_contacts(closed, near)
        if (owner < 0).any():
            return None
        rows, metric = take(near, owner), system.metric(q)
        open_by = float(np.abs(rows.gap * constraints.levers(rows.constraint)).max())
        if open_by <= _ENOUGH * problem.tolerance:
            break
        if attempt == _MOST - 1:
            return None
        normals = dense(rows.jacobian)
        q = system.integrate(q, _least(metric, normals, normals, -rows.gap))
    normals = dense(rows.jacobian)
    J, pushes, speeds, slipping = normals, normals, rows.speeds(v), None
    if rows.tangents is not None:
        along, slip = dense(rows.tangents.sliding().jacobian).reshape(count, 2, -1), rows.tangents.slip(v)[:, :2]
        # a contact that slips pushes against its slip, too: the velocity returns as an impact would let it
        slip[sticks] = 0.0
        direction = slip / np.maximum(np.sqrt((slip * slip).sum(axis=1)), _NO_SLIP)[:, None]
        slipping = -rows.tangents.friction[:, None] * direction
        J = np.concatenate([normals, along[sticks].reshape(-1, system.nv)])
        pushes = np.concatenate(
            [normals + np.einsum("kj,kjn->kn", slipping, along), along[sticks].reshape(-1, system.nv)]
        )
        speeds = np.concatenate([speeds, rows.tangents.slip(v)[sticks, :2].ravel()])
    impulses, solved = _impulses(metric, J, pushes, -speeds)
    if slipping is not None:
        slipping = impulses[:count, None] * slipping
        slipping[sticks] = impulses[count:].reshape(-1, 2)
    wrench = wrenches(rows, np.arange(count), impulses[:count], slipping)
    return Returned(q, v + impulses @ solved, metric, normals, J, pushes, wrench)


def _least(metric: Metric, J: Array, pushes: Array, change: Array) -> Array:
    """Return a tangent vector w with J w = change, M w a sum of pushes; where rows depend on each other, nearly."""
    impulses, solved = _impulses(metric, J, pushes, change)
    return np.asarray(impulses @ solved)


def _impulses(metric: Metric, J: Array, pushes: Array, change: Array) -> tuple[Array, Array]:
    """Return the factors of the pushes in the sum that is M w, and M^-1 times each; see `_least`."""
    solved = metric.solve_rows(pushes)
    return lstsq(J @ solved.T, change, rcond=_DEPENDENT)[0], solved

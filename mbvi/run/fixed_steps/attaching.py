"""The impact by which bodies are attached to each other, and joints coupled."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ...problem import Problem
from ...results.loop_forces import Place, placed_equalities, rows_in_world, without_equalities
from ...results.run_data import Array, Impact
from ...schemes import Step
from ...system.mechanisms.equalities import PointRows

# changes of v, and percussions, that are rounding
_ROUNDING = 1e-12
# rows of a weld, which has no common point
_WELD = 6
_NO_POINT = np.full(3, np.nan)


class _Row(NamedTuple):
    """One row of the impact; see `Impact`."""

    name: str
    percussion: float
    before: float
    after: float
    point: Array
    normal: Array
    slip: Array


def attaching(problem: Problem, names: list[str], before: Step, after: Array) -> Impact | None:
    """Return the impact of connections that are switched on; None if the velocity does not jump.

    Each has a row for its percussion at the common point, of a weld at its second body, and one without a point for the
    moment about it. Directions and rates are those of the second body relative to the first. A coupling has one row
    without a point, the percussion on its first joint and the rate of that joint less what it follows.

    Parameters
    ----------
    problem : Problem
        With the connections.
    names : list of str
        Those that are switched on.
    before : Step
        The state before.
    after : ndarray, shape (nv,)
        The velocity after.
    """
    jump = after - before.v
    if not names or np.abs(jump).max() <= _ROUNDING * np.abs(before.v).max(initial=0.0):
        return None
    reaction = without_equalities(problem.system).metric(before.q).apply(jump)
    places = placed_equalities(problem.system)
    # joints that are locked are held already
    held = [places[name] for name in names if name in places]
    rows = [row for place in held for row in _rows(place, before, after, reaction, problem.length)]
    if not rows:
        return None
    constraints, percussion, approach, apart, point, normal, slip = (np.array(each) for each in zip(*rows, strict=True))
    still, more = np.zeros_like(slip), tuple[Any, ...]()
    if problem.constraints.frictional:
        turning = None if problem.constraints.resistance is None else still.copy()
        more = still, slip, still.copy(), ("stick",) * len(rows), np.zeros(len(rows)), turning
    energy = 0.5 * float(reaction @ (after + before.v))
    return Impact(before.t, tuple(constraints.tolist()), percussion, approach, apart, point, normal, energy, *more)


def _rows(place: Place, before: Step, after: Array, reaction: Array, length: float) -> list[_Row]:
    """Return the rows of one connection; `reaction` is M times the jump of the velocity, without equalities in M."""
    part, one = place.system, place.equality
    q, v, begin = before.q[place.q : place.q + part.nq], slice(place.v, place.v + part.nv), place.begin
    gradients = part.equality_gradients(q)
    percussions = np.linalg.lstsq(gradients.T, reaction[v])[0]
    if not isinstance(one, PointRows):
        push = float(percussions[begin])
        if abs(push) <= _ROUNDING * np.abs(reaction[v]).max():
            return []
        approach, apart = (float(np.sign(push) * (gradients[begin] @ each[v])) for each in (before.v, after))
        return [_Row(one.name, abs(push), approach, apart, _NO_POINT, _NO_POINT, np.zeros(3))]
    own = slice(begin, begin + len(one.normals))
    percussions = percussions[own]
    points, normals = rows_in_world(place, q)
    point = points[0]
    if len(normals) == _WELD:
        point = part.kinematics(q).poses[one.second or one.first, 3].copy()
    arms = np.concatenate([normals, np.cross(points - point, normals)], axis=1)
    # percussion and moment, and velocities in space of the second body relative to the first, those that it leaves zero
    pushed = percussions @ arms
    rates = [np.linalg.lstsq(arms, gradients[own] @ each[v])[0] for each in (before.v, after)]
    found, least = list[_Row](), _ROUNDING * max(length * np.abs(pushed[:3]).max(), np.abs(pushed[3:]).max())
    for k, lever, where in ((slice(0, 3), length, point), (slice(3, 6), 1.0, _NO_POINT)):
        size = float(np.linalg.norm(pushed[k]))
        if lever * size > least:
            normal = pushed[k] / size
            approach, apart = (float(rate[k] @ normal) for rate in rates)
            slip = rates[0][k] - approach * normal if k.start == 0 else np.zeros(3)
            direction = normal if k.start == 0 else _NO_POINT
            found.append(_Row(one.name, size, approach, apart, where, direction, slip))
    return found

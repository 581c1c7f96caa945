"""Takes away the kinetic energy that a position projection adds because M changes along its displacement."""

from __future__ import annotations

import numpy as np

from ..compiled import kernel
from ..problem import Problem
from ..projection.tree import TreeMetric, tree_energies
from ..system.mechanism import place
from ..system.pinocchio_address import retract
from ..system.system import Array, System
from .mechanism_steps import MechanismStep
from .position_projection import Applied
from .step import Step

# relative differences of an energy below this are rounding
_ROUNDING = 1e-13


def without_added_energy(problem: Problem, applied: Applied, step: Step) -> Step:
    """Return a step with projected positions whose velocity has no more kinetic energy than without the projection.

    The velocity is kept while the displacement changes M. Where that raises the kinetic energy of a mechanism, its
    velocity is shortened: it stays tangent to the closed contacts, and no contact that sticks slips.

    Parameters
    ----------
    problem : Problem
        System and constraints.
    applied : Applied
        Where the law was applied.
    step : Step
        The step; where a wall moves it is returned as it is, because walls do work.

    Notes
    -----
    What a projection changes beside is the potential energy: see `Trajectory.projection_energy`.
    """
    system, rows = problem.system, step.active
    reached = system.integrate(applied.q, (step.t - applied.t) * step.v)
    if rows.rate is not None or np.array_equal(reached, step.q):
        return step
    v = step.v.copy()
    for part, q, k, _ in system.located_parts():
        # M of free bodies is constant
        if not part.free_bodies:
            here = slice(k, k + part.nv)
            v[here] *= _shares(part, reached[q : q + part.nq], step.q[q : q + part.nq], v[here])
    if np.array_equal(v, step.v):
        return step
    rates, slip = step.rates.copy(), step.slip
    rates[2] = rows.speeds(v)
    if slip is not None and rows.tangents is not None:
        slip = slip.copy()
        slip[2] = rows.tangents.slip(v)
    return step._replace(v=v, rates=rates, slip=slip)


def _shares(system: System, before: Array, after: Array, v: Array) -> Array | float:
    """Return what part of v, shape (nv,), has the energy at a configuration `after` that v has `before`, at most 1."""
    energy, roots = [], np.zeros(system.nv, np.int64)
    for q in (before, after):
        metric = system.metric(q)
        if isinstance(metric, TreeMetric):
            square = (metric.lower @ v) ** 2
            for i, parent in enumerate(metric.parent):
                roots[i] = i if parent < 0 else roots[parent]
            energy.append(np.bincount(roots, square, system.nv)[roots])
        else:
            energy.append(np.full(system.nv, v @ metric.apply(v)))
    least, most = energy
    return np.sqrt(np.where(most > (1.0 + _ROUNDING) * least, least / np.where(most > 0.0, most, 1.0), 1.0))


@kernel("void(MechanismStep, f8[::1], f8[::1], f8)")
def lose_added_energy(s: MechanismStep, q: Array, v: Array, half: float) -> None:
    """Do what `without_added_energy` does after a step of `Centered` from q, v; `half` is half its length [s]."""
    room, mech, n, k, same = s.room, s.mechanism, len(v), s.rows.size[0], True
    for j in range(n):
        room.drift[j] = half * v[j]
    retract(mech.calls, q, room.drift, room.middle)
    for j in range(n):
        room.drift[j] = half * s.v[j]
    retract(mech.calls, room.middle, room.drift, room.end)
    for j in range(len(q)):
        same = same and room.end[j] == s.q[j]
    if same:
        return
    before, after, change = room.displacement, room.tangent, room.moved
    place(mech, room.end)
    tree_energies(mech.mass, mech.parent, s.v, before)
    place(mech, s.q)
    tree_energies(mech.mass, mech.parent, s.v, after)
    for j in range(n):
        share = np.sqrt(before[j] / after[j]) if after[j] > (1.0 + _ROUNDING) * before[j] else 1.0
        change[j] = (share - 1.0) * s.v[j]
        s.v[j] += change[j]
    for a in range(k):
        for j in range(n):
            s.rates[2 * k + a] += s.rows.J[a, j] * change[j]
            if len(s.slip) > 0:
                for c in range(2):
                    s.slip[2 * (2 * k + a) + c] += s.rows.T[2 * a + c, j] * change[j]

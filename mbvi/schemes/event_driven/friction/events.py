"""Finds the first end of a mode within a step: a stop, a load on the edge of the cone, a release."""

from __future__ import annotations

import numpy as np

from ....system.system import Array
from ..finding.release_events import OPENS, first_end
from ..finding.root_finding import first_root
from ..runge_kutta import RungeKuttaStep
from .decision import decide
from .modes import ContactModes


def first_mode_end(modes: ContactModes, step: RungeKuttaStep, closed: Array, share: float) -> float:
    """Return the share of a step at which the first mode of a closed contact ends; 1 if none does before `share`."""
    modes.stopped = -1
    if not closed.size:
        return 1.0
    system = modes.system

    def margins(x: float, of: Array) -> Array:
        return _margins(modes, step.t + x * share * step.h, *step.at(system, x * share), closed)[of]

    def stay(at: float) -> bool:
        return _stay(modes, step.t + at * step.h, *step.at(system, at), closed)

    k = len(closed)
    every = np.arange(3 * k)
    # dependent contacts may share their forces otherwise than least squares do: of these the law alone knows
    watched = every[(margins(0.0, every) >= 0.0) | (every >= 2 * k)]

    def along(x: Array, of: Array) -> Array:
        return np.array([margins(each, watched[of]) for each in x.tolist()])

    x, which = first_root(along, np.full(len(watched), np.inf))
    if x < 1.0 and watched[which] >= 2 * k:
        modes.stopped, share = int(watched[which]) - 2 * k, x * share
        found = share
    else:
        found = first_end(stay, x * share, share) if x < 1.0 else 1.0
    if len(watched) < len(every):
        other = first_end(stay, 0.0, share)
        modes.stopped = -1 if other < found else modes.stopped
        found = min(found, other)
    return found


def _margins(modes: ContactModes, t: float, q: Array, v: Array, closed: Array) -> Array:
    """Return what becomes negative where a mode ends, shape (3 k,): normal forces, loads below the cone, slips.

    Forces have a margin for rounding.
    """
    equations, found = modes.forces(t, q, v, closed)
    rough, J = equations.mu > 0.0, equations.normals.J
    margin = OPENS * equations.normals.scale / np.vecdot(J, equations.normals.metric.solve_rows(J))
    below = np.ones(len(closed))
    edge = (equations.mu * (found.normal + margin) + margin) ** 2 - (found.tangential**2).sum(axis=1)
    below[modes.sticks] = edge[modes.sticks]
    slips = np.where(~modes.sticks & rough, np.vecdot(equations.slip, modes.kept_way(equations)), 1.0)
    return np.concatenate([found.normal + margin, below, slips])


def _stay(modes: ContactModes, t: float, q: Array, v: Array, closed: Array) -> bool:
    """Return whether the law on accelerations leaves every closed contact in its mode."""
    equations = modes.equations(t, q, v, closed)
    found = decide(equations, ~modes.sticks)
    return found is not None and bool((found.opening <= 0.5 * OPENS).all() and (found.sticks >= modes.sticks).all())

"""Finds which closed contacts open, by complementarity of forces and accelerations, and when the first one opens."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from ....projection import Projector
from ....system.system import Array
from ..runge_kutta import Flow, RungeKuttaStep
from .interpolants import COARSE, FEW_NODES, all_stay_positive
from .root_finding import first_root

# relative acceleration above which a closed contact opens, and below which a contact without a force stays closed; the
# second is smaller, because otherwise a contact that has just opened could be closed again
OPENS, STAYS = 1e-9, 1e-10
# share of a step after which a release is certain, and number of places at which dependent contacts are checked
_LATER, _CHECKS = 1e-7, 17
# share of a step to which bisection finds a release
_BISECTED = 1e-13


def complementarity(flow: Flow, projector: Projector, t: float, q: Array, v: Array, rest: Array) -> tuple[Array, Array]:
    """Return the forces of resting contacts, and the accelerations of their gaps relative to the terms of these."""
    free, metric, J, wanted, scale = flow.contact_equations(t, q, v, rest)
    solved = projector.project(free, metric, J, wanted)
    opening = J @ solved.velocity - wanted
    return solved.percussion, opening / scale


def first_release(flow: Flow, projector: Projector, step: RungeKuttaStep, closed: Array, share: float) -> float:
    """Return the share of a step at which a closed contact is released; 1 if none is released before `share`."""
    if not closed.size:
        return 1.0

    def forces(x: Array, of: Array) -> Array:
        return flow.force_margins(step, closed, share * x, OPENS)[:, of]

    known = flow.force_margins(step, closed, share * FEW_NODES, OPENS)
    if all_stay_positive(COARSE.last, COARSE.grid, known):
        return 1.0
    x, _ = first_root(forces, np.full(len(closed), np.inf), known)
    if x == 1.0:
        return 1.0
    return first_end(partial(_all_stay, flow, projector, step, closed), x * share, share)


def first_end(stay: Callable[[float], bool], low: float, share: float) -> float:
    """Return the first share of a step at which contacts do not stay as they are; 1 if there is none before `share`.

    Parameters
    ----------
    stay : callable
        Whether they stay at a share of the step.
    low : float
        Where least-squares forces say first that they do not.
    share : float
        Where the search ends.
    """
    later = min(low + _LATER, share)
    if not stay(later):
        # where all forces on a contact vanish at one instant, it opens only after that
        return later if stay(low) else low
    # contacts whose rows depend on each other may stay closed although their least-squares forces are negative; the
    # first of some places where they do not all stay, then bisection
    for high in np.linspace(low, share, _CHECKS)[1:].tolist():
        if stay(high):
            low = high
            continue
        while high - low > _BISECTED:
            middle = 0.5 * (low + high)
            low, high = (middle, high) if stay(middle) else (low, middle)
        return float(high)
    return 1.0


def _all_stay(flow: Flow, projector: Projector, step: RungeKuttaStep, closed: Array, share: float) -> bool:
    """Return whether every closed contact stays closed at a share of the step."""
    q, v = step.at(flow.system, share)
    _, opening = complementarity(flow, projector, step.t + share * step.h, q, v, closed)
    return bool((opening <= 0.5 * OPENS).all())

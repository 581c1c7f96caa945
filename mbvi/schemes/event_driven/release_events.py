"""Which closed contacts press and which open, and where along a step the first one lets go."""

from __future__ import annotations

import numpy as np

from ...projection import Projector
from ...system.system import Array
from .root_finding import first_root
from .runge_kutta import Flow, RungeKuttaStep, least_push

# relative acceleration at which a closed contact opens, and below which one stays without pressing: less, or what was
# just let go would be kept
_OPENS, STAYS = 1e-9, 1e-10
# how much later in a step a release is beyond doubt, and how often dependent contacts are looked at
_LATER, _LOOKS = 1e-7, 17
_SHORTEST = 1e-13
# accelerations below this have lost their digits: they are none
_DENORMAL = 1e-290


def complementarity(flow: Flow, projector: Projector, t: float, q: Array, v: Array, rest: Array) -> tuple[Array, Array]:
    """Return how resting contacts press, and their accelerations apart relative to the terms these consist of."""
    free, metric, J, wanted = flow.reactions(t, q, v, rest)
    solved = projector.project(free, metric, J, wanted)
    scale = np.abs(J) @ np.abs(free) + np.abs(wanted) + _DENORMAL
    opening = J @ solved.velocity - wanted
    return solved.percussion, opening / scale


def first_release(flow: Flow, projector: Projector, stride: RungeKuttaStep, closed: Array, share: float) -> float:
    """Return the share of a step at which a closed contact releases, 1 if none does before `share`."""
    if not closed.size:
        return 1.0
    x, _ = first_root(lambda x, of: _press(flow, stride, closed, x * share)[of], np.full(len(closed), np.inf))
    if x == 1.0:
        return 1.0
    later = min(x * share + _LATER, share)
    if not _all_hold(flow, projector, stride, closed, later):
        # where all forces on a contact vanish at once it opens only after that
        return later if _all_hold(flow, projector, stride, closed, x * share) else x * share
    # dependent ones may hold though the least of their forces would pull
    low = x * share
    for high in np.linspace(low, share, _LOOKS)[1:].tolist():
        if _all_hold(flow, projector, stride, closed, high):
            low = high
            continue
        while high - low > _SHORTEST:
            middle = 0.5 * (low + high)
            holds = _all_hold(flow, projector, stride, closed, middle)
            low, high = (middle, high) if holds else (low, middle)
        return float(high)
    return 1.0


def _press(flow: Flow, stride: RungeKuttaStep, closed: Array, share: float) -> Array:
    """Return how closed contacts press if none may open, as accelerations; above zero while pulling by rounding."""
    q, v = stride.at(flow.system, share)
    free, metric, J, wanted = flow.reactions(stride.t + share * stride.h, q, v, closed)
    G = J @ metric.solve_rows(J).T
    scale = np.abs(J) @ np.abs(free) + np.abs(wanted) + _DENORMAL
    return np.asarray(least_push(G, wanted - J @ free) * G.diagonal() + _OPENS * scale)


def _all_hold(flow: Flow, projector: Projector, stride: RungeKuttaStep, closed: Array, share: float) -> bool:
    """Tell whether every closed contact would stay so."""
    q, v = stride.at(flow.system, share)
    _, opening = complementarity(flow, projector, stride.t + share * stride.h, q, v, closed)
    return bool((opening <= 0.5 * _OPENS).all())
